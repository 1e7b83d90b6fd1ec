/*
 * Reference model. See ars_reference_model.h.
 *
 * The straight-line functions are CasADi expression graphs printed one operation a line. Arrays hold
 * x = [sideslip angle, yaw rate], u = [1/speed, front angle, rear angle, friction], curve and slope = [front tyre, rear tyre].
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_reference_model.h"

#include "ars_checksum.h"
#include "ars_constants.h"
#include "ars_sections.h"

#if ARS_CHECKSUM_BUILD != 0xC60F8B14u
#error "ars_checksum.h and this source come from different builds"
#endif
#if ARS_CONSTANTS_BUILD != 0xC60F8B14u
#error "ars_constants.h and this source come from different builds"
#endif
#if ARS_REFERENCE_MODEL_BUILD != 0xC60F8B14u
#error "ars_reference_model.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float model_speed_min = 1.0f; /* m/s, above zero because the step divides by the speed */
ARS_SECTION_CONST static const float model_rear_angle_max = 0.061086524f; /* rad */
ARS_SECTION_CONST static const float model_sideslip_max = 0.34906584f; /* rad */
ARS_SECTION_CONST static const float model_yaw_rate_max = 2.6179938f; /* rad/s */
ARS_SECTION_CONST static const float model_lateral_acceleration_max = 20.0f; /* m/s^2 */

/* Front tyre: the curve, and the compression of its argument. No calibration; the checksum covers them. */
enum { FRONT_CELLS = 64 };
ARS_SECTION_CONST static const float front_compression = 1.0f;
ARS_SECTION_CONST static const float front_values[FRONT_CELLS + 1] = {
    0.0f, 0.02063259f, 0.041915923f, 0.06386513f, 0.08649415f, 0.10981532f, 0.13383907f, 0.1585733f,
    0.18402292f, 0.21018913f, 0.23706873f, 0.26465324f, 0.29292795f, 0.32187095f, 0.35145187f, 0.3816308f,
    0.41235706f, 0.44356784f, 0.47518715f, 0.5071246f, 0.5392749f, 0.5715168f, 0.6037138f, 0.6357141f,
    0.667352f, 0.6984501f, 0.72882193f, 0.7582757f, 0.78661907f, 0.8136639f, 0.8392319f, 0.86316043f,
    0.88530743f, 0.9055564f, 0.9238201f, 0.94004285f, 0.95420194f, 0.96630704f, 0.9763985f, 0.9845446f,
    0.99083716f, 0.9953878f, 0.9983228f, 0.9997781f, 0.99989545f, 0.99881786f, 0.9966863f, 0.9936369f,
    0.989799f, 0.9852933f, 0.980231f, 0.9747132f, 0.96883094f, 0.9626653f, 0.9562877f, 0.94976044f,
    0.9431377f, 0.93646586f, 0.9297843f, 0.9231264f, 0.9165199f, 0.9099877f, 0.90354854f, 0.8972176f,
    0.8910065f
};

/* Rear tyre: the curve, and the compression of its argument. No calibration; the checksum covers them. */
enum { REAR_CELLS = 64 };
ARS_SECTION_CONST static const float rear_compression = 1.0f;
ARS_SECTION_CONST static const float rear_values[REAR_CELLS + 1] = {
    0.0f, 0.02063259f, 0.041915923f, 0.06386513f, 0.08649415f, 0.10981532f, 0.13383907f, 0.1585733f,
    0.18402292f, 0.21018913f, 0.23706873f, 0.26465324f, 0.29292795f, 0.32187095f, 0.35145187f, 0.3816308f,
    0.41235706f, 0.44356784f, 0.47518715f, 0.5071246f, 0.5392749f, 0.5715168f, 0.6037138f, 0.6357141f,
    0.667352f, 0.6984501f, 0.72882193f, 0.7582757f, 0.78661907f, 0.8136639f, 0.8392319f, 0.86316043f,
    0.88530743f, 0.9055564f, 0.9238201f, 0.94004285f, 0.95420194f, 0.96630704f, 0.9763985f, 0.9845446f,
    0.99083716f, 0.9953878f, 0.9983228f, 0.9997781f, 0.99989545f, 0.99881786f, 0.9966863f, 0.9936369f,
    0.989799f, 0.9852933f, 0.980231f, 0.9747132f, 0.96883094f, 0.9626653f, 0.9562877f, 0.94976044f,
    0.9431377f, 0.93646586f, 0.9297843f, 0.9231264f, 0.9165199f, 0.9099877f, 0.90354854f, 0.8972176f,
    0.8910065f
};

/* Return the number without its sign bit. Faster than a comparison: one instruction. */
ARS_SECTION_CODE static float magnitude(float value)
{
    union {
        float value;
        uint32_t bits;
    } number = { .value = value };

    number.bits &= 0x7FFFFFFFu;
    return number.value;
}

/* Return the value within +-largest. NaN gives +largest, so that it cannot enter the state. */
ARS_SECTION_CODE static float bounded(float value, float largest)
{
    float result = largest;

    if (magnitude(value) <= largest) {
        result = value;
    } else if (value < 0.0f) {
        result = -largest;
    } else {
        /* above, or NaN */
    }
    return result;
}

/* Value and slope of a tyre curve at one argument. */
typedef struct {
    float value;
    float slope;
} curve_t;

/* Value and slope of a tyre curve. The curve is odd; its table covers positive x in equal steps of x / (x + compression). The slope is
 * that of the table, but zero where the curve falls, because the time step is stable only for slopes that are not negative. */
ARS_SECTION_CODE static curve_t curve_at(const float curve[], uint32_t cells, float compression, float x)
{
    const float x_magnitude = magnitude(x);
    const float inverse = 1.0f / (x_magnitude + compression);
    const float position = (x_magnitude * inverse) * (float)cells;
    uint32_t index = cells - 1u; /* for NaN too */
    const float *cell_values;
    float cell_rise;
    curve_t result;

    if (position < (float)cells) {
        index = (uint32_t)position;
    }
    cell_values = &curve[index];
    cell_rise = cell_values[1] - cell_values[0];
    result.value = cell_values[0] + ((position - (float)index) * cell_rise);
    if (x < 0.0f) {
        result.value = -result.value;
    }
    result.slope = (cell_rise > 0.0f) ? (cell_rise * ((compression * (float)cells) * (inverse * inverse))) : 0.0f;
    return result;
}

ARS_SECTION_CODE static curve_t front_curve(float x)
{
    return curve_at(front_values, (uint32_t)FRONT_CELLS, front_compression, x);
}

ARS_SECTION_CODE static curve_t rear_curve(float x)
{
    return curve_at(rear_values, (uint32_t)REAR_CELLS, rear_compression, x);
}

/* Arguments of both tyre curves. */
ARS_SECTION_CODE static void arguments_of(const float x[2], const float u[4], float argument[2])
{
    const float t0 = x[1] * u[0];
    const float t1 = 1.574f * t0;
    const float t2 = x[0] + t1;
    const float t3 = t2 - u[1];
    const float t4 = 17.886541f * t3;
    const float t5 = 1.566f * t0;
    const float t6 = x[0] - t5;
    const float t7 = t6 - u[2];
    const float t8 = 17.838802f * t7;
    argument[0] = t4;
    argument[1] = t8;
}

/* Change of sideslip angle and yaw rate over a step, and lateral acceleration at its beginning, from the values and slopes of both tyre
 * curves. */
ARS_SECTION_CODE static void change_of(
    const float x[2], const float u[4], const float curve[2], const float slope[2], float change[3])
{
    const float t0 = 0.4375498f * u[3];
    const float t1 = t0 * slope[0];
    const float t2 = 1.0760072f * t1;
    const float t3 = 0.43861127f * u[3];
    const float t4 = t3 * slope[1];
    const float t5 = 1.0650972f * t4;
    const float t6 = t2 + t5;
    const float t7 = u[0] * t6;
    const float t8 = 1.0f + t7;
    const float t9 = 0.04892503f * u[3];
    const float t10 = t9 * curve[0];
    const float t11 = 0.04917497f * u[3];
    const float t12 = t11 * curve[1];
    const float t13 = t10 + t12;
    const float t14 = u[0] * t13;
    const float t15 = 0.01f * x[1];
    const float t16 = t14 + t15;
    const float t17 = t8 * t16;
    const float t18 = u[0] * u[0];
    const float t19 = 2.3024714f * t18;
    const float t20 = 0.68361324f * t1;
    const float t21 = 0.6801387f * t4;
    const float t22 = t20 - t21;
    const float t23 = t19 * t22;
    const float t24 = 0.005f + t23;
    const float t25 = u[2] * t13;
    const float t26 = 3.4163723f * t25;
    const float t27 = 1.566f - t26;
    const float t28 = t27 * t12;
    const float t29 = u[1] * t13;
    const float t30 = 5.150738f * t29;
    const float t31 = 1.574f + t30;
    const float t32 = t31 * t10;
    const float t33 = t28 - t32;
    const float t34 = 0.43431592f * t33;
    const float t35 = t24 * t34;
    const float t36 = t17 + t35;
    const float t37 = t1 + t4;
    const float t38 = u[0] * t37;
    const float t39 = 1.0f + t38;
    const float t40 = t39 * t8;
    const float t41 = t24 * t22;
    const float t42 = t40 - t41;
    const float t43 = (t42 > 0.5f) ? t42 : 0.5f;
    const float t44 = t36 / t43;
    const float t45 = -t44;
    const float t46 = t39 * t34;
    const float t47 = t22 * t16;
    const float t48 = t46 + t47;
    const float t49 = t48 / t43;
    const float t50 = (-100.0f) * t13;
    change[0] = t45;
    change[1] = t49;
    change[2] = t50;
}

/* Speed, at least model_speed_min. NaN stays NaN: as a maximum of two numbers, a signalling NaN would give different results on some
 * cores. */
ARS_SECTION_CODE static float at_least_slow(float speed)
{
    return (speed < model_speed_min) ? model_speed_min : speed;
}

ARS_SECTION_CODE void ars_reference_model_start(
    ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle)
{
    /* Steady sideslip of the linear car: rear angle + yaw rate (rear_arm / speed - rear_slip speed). */
    const float rear_arm = 1.566f; /* m */
    const float rear_slip = ars_constants.model_rear_slip_per_lateral_acceleration;
    const float bounded_speed = at_least_slow(speed);

    self->yaw_rate = bounded(yaw_rate, model_yaw_rate_max);
    self->rear_angle = bounded(rear_angle, model_rear_angle_max);
    self->sideslip_angle = bounded(
        self->rear_angle + (self->yaw_rate * ((rear_arm / bounded_speed) - (rear_slip * bounded_speed))), model_sideslip_max);
    self->lateral_acceleration = bounded(bounded_speed * self->yaw_rate, model_lateral_acceleration_max);
}

ARS_SECTION_CODE void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input)
{
    /* Actuator and computation delay as one first-order lag: fraction of the remaining angle in a step, and largest step in rad. */
    const float actuator_share = 0.15351827f;
    const float actuator_step_max = 0.0052359877f;
    const float x[2] = { self->sideslip_angle, self->yaw_rate };
    const float rear_angle_error = input->rear_angle - self->rear_angle;
    const float rear_angle_change = bounded(actuator_share * rear_angle_error, actuator_step_max);
    const float u[4] = {
        1.0f / at_least_slow(input->speed),
        input->front_angle,
        self->rear_angle + (0.5f * rear_angle_change), /* in the middle of the step */
        input->friction
    };
    float argument[2];
    float change[3];
    curve_t front;
    curve_t rear;

    arguments_of(x, u, argument);
    front = front_curve(argument[0]);
    rear = rear_curve(argument[1]);
    {
        const float curve[2] = { front.value, rear.value };
        const float slope[2] = { front.slope, rear.slope };

        change_of(x, u, curve, slope, change);
    }
    self->sideslip_angle = bounded(x[0] + change[0], model_sideslip_max);
    self->yaw_rate = bounded(x[1] + change[1], model_yaw_rate_max);
    self->rear_angle = bounded(self->rear_angle + rear_angle_change, model_rear_angle_max);
    self->lateral_acceleration = bounded(change[2], model_lateral_acceleration_max);
}

ARS_SECTION_CODE uint32_t ars_reference_model_crc(uint32_t start)
{
    uint32_t crc = start;
    uint32_t k;

    crc = ars_checksum_real(crc, front_compression);
    for (k = 0u; k < ((uint32_t)FRONT_CELLS + 1u); k++) {
        crc = ars_checksum_real(crc, front_values[k]);
    }
    crc = ars_checksum_real(crc, rear_compression);
    for (k = 0u; k < ((uint32_t)REAR_CELLS + 1u); k++) {
        crc = ars_checksum_real(crc, rear_values[k]);
    }
    return crc;
}
