/*
 * Reference model. See ars_reference_model.h.
 *
 * The straight-line functions are CasADi expression graphs printed one operation a line. Arrays hold
 * x = [sideslip angle, yaw rate], u = [speed, front angle, rear angle, friction] and shape = [front curve, rear curve].
 *
 * Map 4ws2-tracking: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_reference_model.h"

#include <stdint.h>

#include "ars_sections.h"

#if ARS_REFERENCE_MODEL_BUILD != 0xF76ECFC0u
#error "ars_reference_model.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float step = 0.01f; /* s */
ARS_SECTION_CONST static const float speed_min = 2.1948507f; /* m/s: below, a step would be too long for the model */
ARS_SECTION_CONST static const float speed_max = 111.111115f; /* m/s */
ARS_SECTION_CONST static const float front_angle_max = 0.7853982f; /* rad */
ARS_SECTION_CONST static const float rear_angle_max = 0.061086524f; /* rad */
ARS_SECTION_CONST static const float sideslip_max = 0.34906584f; /* rad */
ARS_SECTION_CONST static const float yaw_rate_max = 2.6179938f; /* rad/s */
ARS_SECTION_CONST static const float friction_max = 0.9f; /* the map's own */

/* The actuator with the computation's delay as one first-order lag: the share of the way that it goes in a step, and rad at most. */
ARS_SECTION_CONST static const float actuator_share = 0.15351827f;
ARS_SECTION_CONST static const float actuator_step_max = 0.0052359877f;

/* Steady sideslip of the linear car: rear angle + yaw rate (rear_arm / speed - rear_slip speed). m, rad s^2/m. */
ARS_SECTION_CONST static const float rear_arm = 1.566f;
ARS_SECTION_CONST static const float rear_slip_per_lateral_acceleration = 0.0048840423f;

/* Front tyre: even steps of x / (x + front_compression) from 0 to 1. */
enum { FRONT_CELLS = 64 };
ARS_SECTION_CONST static const float front_compression = 1.0f;
ARS_SECTION_CONST static const float front_curve[FRONT_CELLS + 1] = {
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

/* Rear tyre: even steps of x / (x + rear_compression) from 0 to 1. */
enum { REAR_CELLS = 64 };
ARS_SECTION_CONST static const float rear_compression = 1.0f;
ARS_SECTION_CONST static const float rear_curve[REAR_CELLS + 1] = {
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

ARS_SECTION_CODE static float clamp(float value, float low, float high)
{
    float result = low;

    if (value > low) {
        result = value;
    }
    if (result > high) {
        result = high;
    }
    return result;
}

/* The value within +-limit; 0 where it is NaN. */
ARS_SECTION_CODE static float bounded(float value, float limit)
{
    float result = 0.0f;

    if ((value > 0.0f) || (value < 0.0f)) {
        result = clamp(value, -limit, limit);
    }
    return result;
}

/* An odd function from its half for positive x. */
ARS_SECTION_CODE static float curve_at(const float curve[], uint32_t cells, float compression, float x)
{
    const float magnitude = (x < 0.0f) ? -x : x;
    const float position = (magnitude / (magnitude + compression)) * (float)cells;
    uint32_t cell = (uint32_t)position;
    float value;

    if (cell >= cells) {
        cell = cells - 1u;
    }
    value = curve[cell] + ((position - (float)cell) * (curve[cell + 1u] - curve[cell]));
    return (x < 0.0f) ? -value : value;
}

ARS_SECTION_CODE float ars_reference_model_front_curve(float x)
{
    return curve_at(front_curve, (uint32_t)FRONT_CELLS, front_compression, bounded(x, 1.0e+06f));
}

ARS_SECTION_CODE float ars_reference_model_rear_curve(float x)
{
    return curve_at(rear_curve, (uint32_t)REAR_CELLS, rear_compression, bounded(x, 1.0e+06f));
}

/* Arguments of both curves. */
ARS_SECTION_CODE static void arguments_of(const float x[2], const float u[4], float argument[2])
{
    const float t0 = 1.574f * x[1];
    const float t1 = t0 / u[0];
    const float t2 = x[0] + t1;
    const float t3 = t2 - u[1];
    const float t4 = 17.886541f * t3;
    const float t5 = 1.566f * x[1];
    const float t6 = t5 / u[0];
    const float t7 = x[0] - t6;
    const float t8 = t7 - u[2];
    const float t9 = 17.838802f * t8;
    argument[0] = t4;
    argument[1] = t9;
}

/* Time derivative of the state from the values of both curves. */
ARS_SECTION_CODE static void derivative_of(
    const float x[2], const float u[4], const float shape[2], float dx[2])
{
    const float t0 = 5712.169f * u[3];
    const float t1 = t0 * shape[0];
    const float t2 = (-2.0f) * t1;
    const float t3 = 5741.3496f * u[3];
    const float t4 = t3 * shape[1];
    const float t5 = (-2.0f) * t4;
    const float t6 = t2 + t5;
    const float t7 = 2335.07f * u[0];
    const float t8 = t6 / t7;
    const float t9 = t8 - x[1];
    const float t10 = (-3.148f) * t1;
    const float t11 = (-3.132f) * t4;
    const float t12 = t10 - t11;
    const float t13 = t12 / 5376.432f;
    dx[0] = t9;
    dx[1] = t13;
}

ARS_SECTION_CODE static void slope_at(const float x[2], const float u[4], float slope[2])
{
    float arguments[2];
    float shape[2];

    arguments_of(x, u, arguments);
    shape[0] = ars_reference_model_front_curve(arguments[0]);
    shape[1] = ars_reference_model_rear_curve(arguments[1]);
    derivative_of(x, u, shape, slope);
}

ARS_SECTION_CODE void ars_reference_model_start(
    ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle)
{
    const float forward = clamp(speed, speed_min, speed_max);

    self->yaw_rate = bounded(yaw_rate, yaw_rate_max);
    self->rear_angle = bounded(rear_angle, rear_angle_max);
    self->sideslip_angle = bounded(
        self->rear_angle + (self->yaw_rate * ((rear_arm / forward) - (rear_slip_per_lateral_acceleration * forward))),
        sideslip_max);
}

ARS_SECTION_CODE void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input)
{
    const float x[2] = { self->sideslip_angle, self->yaw_rate };
    const float way = bounded(input->rear_angle, rear_angle_max) - self->rear_angle;
    const float moved = clamp(actuator_share * way, -actuator_step_max, actuator_step_max);
    const float u[4] = {
        clamp(input->speed, speed_min, speed_max),
        bounded(input->front_angle, front_angle_max),
        self->rear_angle + (0.5f * moved), /* in the middle of the step */
        (input->friction < friction_max) ? clamp(input->friction, 0.0f, friction_max) : friction_max
    };
    float slope[2];
    float ahead[2];
    float slope_ahead[2];

    slope_at(x, u, slope);
    ahead[0] = x[0] + (step * slope[0]);
    ahead[1] = x[1] + (step * slope[1]);
    slope_at(ahead, u, slope_ahead);
    self->sideslip_angle = bounded(x[0] + ((0.5f * step) * (slope[0] + slope_ahead[0])), sideslip_max);
    self->yaw_rate = bounded(x[1] + ((0.5f * step) * (slope[1] + slope_ahead[1])), yaw_rate_max);
    self->rear_angle = bounded(self->rear_angle + moved, rear_angle_max);
}
