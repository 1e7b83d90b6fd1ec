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

#if ARS_REFERENCE_MODEL_BUILD != 0x7DF6281Au
#error "ars_reference_model.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float model_speed_min = 2.1948507f; /* m/s: below, a step would be too long for the model */
ARS_SECTION_CONST static const float model_speed_max = 111.111115f; /* m/s */
ARS_SECTION_CONST static const float model_rear_angle_max = 0.061086524f; /* rad */
ARS_SECTION_CONST static const float model_sideslip_max = 0.34906584f; /* rad */
ARS_SECTION_CONST static const float model_yaw_rate_max = 2.6179938f; /* rad/s */

enum { FRONT_CELLS = 64 };
enum { REAR_CELLS = 64 };

ARS_SECTION_CODE static float between(float value, float low, float high)
{
    float result = low; /* NaN too, and on every core: a maximum of a signalling one would be another NaN on some */

    if (value >= high) {
        result = high;
    } else if (value > low) {
        result = value;
    } else {
        /* below, or NaN */
    }
    return result;
}

/* The value within +-limit; 0 where it is NaN. */
ARS_SECTION_CODE static float bounded(float value, float limit)
{
    float result = 0.0f;

    if ((value > 0.0f) || (value < 0.0f)) {
        result = between(value, -limit, limit);
    }
    return result;
}

/* An odd function from its half for positive x. */
ARS_SECTION_CODE static float curve_at(
    const float curve[], uint32_t cells, float compression, float cells_per_share, float x)
{
    const float magnitude = (x < 0.0f) ? -x : x;
    const float position = (magnitude / (magnitude + compression)) * cells_per_share;
    uint32_t index = (uint32_t)position;
    float value;

    if (index >= cells) {
        index = cells - 1u;
    }
    value = curve[index] + ((position - (float)index) * (curve[index + 1u] - curve[index]));
    return (x < 0.0f) ? -value : value;
}

/* Front tyre: even steps of x / (x + compression), cells_per_share of them from 0 to 1. */
ARS_SECTION_CODE float ars_reference_model_front_curve(float x)
{
    const float compression = 1.0f;
    const float cells_per_share = 65.0f;
    ARS_SECTION_CONST static const float front_curve[FRONT_CELLS + 1] = {
        0.0f, 0.020310277f, 0.041251197f, 0.06283723f, 0.08508172f, 0.10799656f, 0.13159183f, 0.1558753f,
        0.18085197f, 0.20652343f, 0.23288725f, 0.2599361f, 0.28765696f, 0.3160302f, 0.34502852f, 0.37461582f,
        0.4047461f, 0.43536225f, 0.46639505f, 0.49776205f, 0.5293668f, 0.56109816f, 0.5928305f, 0.6244235f,
        0.6557235f, 0.6865649f, 0.71677256f, 0.7461649f, 0.774558f, 0.80176985f, 0.8276256f, 0.85196245f,
        0.8746349f, 0.8955195f, 0.9145186f, 0.93156326f, 0.9466151f, 0.9596666f, 0.9707401f, 0.97988576f,
        0.9871784f, 0.9927138f, 0.9966042f, 0.99897397f, 0.9999554f, 0.9996846f, 0.9982976f, 0.99592805f,
        0.9927042f, 0.9887474f, 0.9841707f, 0.97907776f, 0.9735632f, 0.96771175f, 0.9615991f, 0.95529175f,
        0.948848f, 0.9423183f, 0.93574613f, 0.9291683f, 0.92261606f, 0.9161155f, 0.9096883f, 0.9033521f,
        0.8971211f
    };

    return curve_at(front_curve, (uint32_t)FRONT_CELLS, compression, cells_per_share, bounded(x, 64.0f));
}

/* Rear tyre: even steps of x / (x + compression), cells_per_share of them from 0 to 1. */
ARS_SECTION_CODE float ars_reference_model_rear_curve(float x)
{
    const float compression = 1.0f;
    const float cells_per_share = 65.0f;
    ARS_SECTION_CONST static const float rear_curve[REAR_CELLS + 1] = {
        0.0f, 0.020310277f, 0.041251197f, 0.06283723f, 0.08508172f, 0.10799656f, 0.13159183f, 0.1558753f,
        0.18085197f, 0.20652343f, 0.23288725f, 0.2599361f, 0.28765696f, 0.3160302f, 0.34502852f, 0.37461582f,
        0.4047461f, 0.43536225f, 0.46639505f, 0.49776205f, 0.5293668f, 0.56109816f, 0.5928305f, 0.6244235f,
        0.6557235f, 0.6865649f, 0.71677256f, 0.7461649f, 0.774558f, 0.80176985f, 0.8276256f, 0.85196245f,
        0.8746349f, 0.8955195f, 0.9145186f, 0.93156326f, 0.9466151f, 0.9596666f, 0.9707401f, 0.97988576f,
        0.9871784f, 0.9927138f, 0.9966042f, 0.99897397f, 0.9999554f, 0.9996846f, 0.9982976f, 0.99592805f,
        0.9927042f, 0.9887474f, 0.9841707f, 0.97907776f, 0.9735632f, 0.96771175f, 0.9615991f, 0.95529175f,
        0.948848f, 0.9423183f, 0.93574613f, 0.9291683f, 0.92261606f, 0.9161155f, 0.9096883f, 0.9033521f,
        0.8971211f
    };

    return curve_at(rear_curve, (uint32_t)REAR_CELLS, compression, cells_per_share, bounded(x, 64.0f));
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
    /* Steady sideslip of the linear car: rear angle + yaw rate (rear_arm / speed - rear_slip speed). */
    const float rear_arm = 1.566f; /* m */
    const float rear_slip = 0.0048840423f; /* rad s^2/m */
    const float forward = between(speed, model_speed_min, model_speed_max);

    self->yaw_rate = bounded(yaw_rate, model_yaw_rate_max);
    self->rear_angle = bounded(rear_angle, model_rear_angle_max);
    self->sideslip_angle = bounded(
        self->rear_angle + (self->yaw_rate * ((rear_arm / forward) - (rear_slip * forward))),
        model_sideslip_max);
}

ARS_SECTION_CODE void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input)
{
    const float step = 0.01f; /* s */
    const float front_angle_max = 0.7853982f; /* rad */
    const float friction_max = 0.9f; /* the map's own */
    /* The actuator with the computation's delay as one first-order lag: the share of the way that it goes in a step, and rad at most. */
    const float actuator_share = 0.15351827f;
    const float actuator_step_max = 0.0052359877f;
    const float x[2] = { self->sideslip_angle, self->yaw_rate };
    const float way = bounded(input->rear_angle, model_rear_angle_max) - self->rear_angle;
    const float moved = between(actuator_share * way, -actuator_step_max, actuator_step_max);
    const float u[4] = {
        between(input->speed, model_speed_min, model_speed_max),
        bounded(input->front_angle, front_angle_max),
        self->rear_angle + (0.5f * moved), /* in the middle of the step */
        (input->friction < friction_max) ? between(input->friction, 0.0f, friction_max) : friction_max
    };
    float slope[2];
    float ahead[2];
    float slope_ahead[2];

    slope_at(x, u, slope);
    ahead[0] = x[0] + (step * slope[0]);
    ahead[1] = x[1] + (step * slope[1]);
    slope_at(ahead, u, slope_ahead);
    self->sideslip_angle = bounded(x[0] + ((0.5f * step) * (slope[0] + slope_ahead[0])), model_sideslip_max);
    self->yaw_rate = bounded(x[1] + ((0.5f * step) * (slope[1] + slope_ahead[1])), model_yaw_rate_max);
    self->rear_angle = bounded(self->rear_angle + moved, model_rear_angle_max);
}
