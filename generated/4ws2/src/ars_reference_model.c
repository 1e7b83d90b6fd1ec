/*
 * Reference model. See ars_reference_model.h.
 *
 * The straight-line functions are CasADi expression graphs printed one operation a line. Arrays hold
 * x = [sideslip angle, yaw rate, arguments of both tyre curves], u = [1/speed, front angle, rear angle, friction], curve = [front tyre, rear tyre].
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_reference_model.h"

#include "ars_checksum.h"
#include "ars_constants.h"
#include "ars_sections.h"

#if ARS_CHECKSUM_BUILD != 0xC9A75925u
#error "ars_checksum.h and this source come from different builds"
#endif
#if ARS_CONSTANTS_BUILD != 0xC9A75925u
#error "ars_constants.h and this source come from different builds"
#endif
#if ARS_REFERENCE_MODEL_BUILD != 0xC9A75925u
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
ARS_SECTION_CONST static const float model_argument_max = 1000.0f; /* the curves are level there */

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

/* Value of a tyre curve at an argument. The curve is odd; its table covers positive x in equal steps of x / (x + compression). */
ARS_SECTION_CODE static float curve_at(const float curve[], uint32_t cells, float compression, float x)
{
    const float x_magnitude = magnitude(x);
    const float position = x_magnitude * ((float)cells / (x_magnitude + compression));
    uint32_t index = cells - 1u; /* of an infinite x, and of NaN */
    float fraction = 1.0f;
    float result;

    if (position < (float)cells) {
        index = (uint32_t)position;
        fraction = position - (float)index;
    }
    result = curve[index] + (fraction * (curve[index + 1u] - curve[index]));
    return (x < 0.0f) ? -result : result;
}

ARS_SECTION_CODE static float front_curve(float x)
{
    return curve_at(front_values, (uint32_t)FRONT_CELLS, front_compression, x);
}

ARS_SECTION_CODE static float rear_curve(float x)
{
    return curve_at(rear_values, (uint32_t)REAR_CELLS, rear_compression, x);
}

/* Arguments of both tyre curves, half a step after the motion. */
ARS_SECTION_CODE static void arguments_of(const float x[4], const float u[4], float argument[2])
{
    const float t0 = x[1] * u[0];
    const float t1 = 1.574f * t0;
    const float t2 = x[0] + t1;
    const float t3 = t2 - u[1];
    const float t4 = 17.886541f * t3;
    const float t5 = t4 - x[2];
    const float t6 = 40.0f * u[0];
    const float t7 = 0.5f + t6;
    const float t8 = t5 / t7;
    const float t9 = x[2] + t8;
    const float t10 = 1.566f * t0;
    const float t11 = x[0] - t10;
    const float t12 = t11 - u[2];
    const float t13 = 17.838802f * t12;
    const float t14 = t13 - x[3];
    const float t15 = t14 / t7;
    const float t16 = x[3] + t15;
    argument[0] = t9;
    argument[1] = t16;
}

/* Change of sideslip angle and yaw rate over a step, and lateral acceleration in its middle, from the values of both tyre curves. */
ARS_SECTION_CODE static void change_of(
    const float x[4], const float u[4], const float curve[2], float change[3])
{
    const float t0 = 0.04892503f * u[3];
    const float t1 = t0 * curve[0];
    const float t2 = 0.04917497f * u[3];
    const float t3 = t2 * curve[1];
    const float t4 = t1 + t3;
    const float t5 = u[0] * t4;
    const float t6 = 0.01f * x[1];
    const float t7 = t5 + t6;
    const float t8 = u[2] * t4;
    const float t9 = 3.4163723f * t8;
    const float t10 = 1.566f - t9;
    const float t11 = t10 * t3;
    const float t12 = u[1] * t4;
    const float t13 = 5.150738f * t12;
    const float t14 = 1.574f + t13;
    const float t15 = t14 * t1;
    const float t16 = t11 - t15;
    const float t17 = 0.0021715795f * t16;
    const float t18 = t7 + t17;
    const float t19 = -t18;
    const float t20 = 0.43431592f * t16;
    const float t21 = (-100.0f) * t4;
    change[0] = t19;
    change[1] = t20;
    change[2] = t21;
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
    const float front_argument = -0.08712547f; /* for each m/s^2 */
    const float rear_argument = -0.08712547f;

    self->yaw_rate = bounded(yaw_rate, model_yaw_rate_max);
    self->rear_angle = bounded(rear_angle, model_rear_angle_max);
    self->sideslip_angle = bounded(
        self->rear_angle + (self->yaw_rate * ((rear_arm / bounded_speed) - (rear_slip * bounded_speed))), model_sideslip_max);
    self->lateral_acceleration = bounded(bounded_speed * self->yaw_rate, model_lateral_acceleration_max);
    self->front_argument = front_argument * self->lateral_acceleration;
    self->rear_argument = rear_argument * self->lateral_acceleration;
}

ARS_SECTION_CODE void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input)
{
    /* Actuator and computation delay as one first-order lag: fraction of the remaining angle in a step, and largest step in rad. */
    const float actuator_share = 0.15351827f;
    const float actuator_step_max = 0.0052359877f;
    const float x[4] = { self->sideslip_angle, self->yaw_rate, self->front_argument, self->rear_argument };
    const float rear_angle_error = input->rear_angle - self->rear_angle;
    const float rear_angle_change = bounded(actuator_share * rear_angle_error, actuator_step_max);
    const float u[4] = {
        1.0f / at_least_slow(input->speed),
        input->front_angle,
        self->rear_angle,
        input->friction
    };
    float argument[2];
    float change[3];

    arguments_of(x, u, argument);
    {
        const float curve[2] = { front_curve(argument[0]), rear_curve(argument[1]) };

        change_of(x, u, curve, change);
    }
    self->front_argument = bounded(argument[0], model_argument_max);
    self->rear_argument = bounded(argument[1], model_argument_max);
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
