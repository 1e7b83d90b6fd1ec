/*
 * CAN frames. See ars_can.h.
 *
 * A signal is converted to its code, a whole number, whose bits are then placed in the bytes of the frame.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_can.h"

#include "ars_sections.h"

#if ARS_CAN_BUILD != 0x76CDF87Cu
#error "ars_can.h and this source come from different builds"
#endif

/* NaN is an input here; a compiler that may assume there is none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* A number and its bits. */
typedef union {
    uint32_t bits;
    float value;
} can_number_t;

/* A quiet NaN, because a bare target need not have math.h. */
ARS_SECTION_CONST static const can_number_t quiet_nan = { .bits = 0x7FC00000u };

ARS_SECTION_CODE float ars_can_not_available(void)
{
    return quiet_nan.value;
}

/* Leading half of the digits of a number. */
ARS_SECTION_CODE static float leading_part(float value)
{
    const float spread = value * 4097.0f;

    return spread - (spread - value);
}

/* value * steps = product + error, exactly (T. J. Dekker, A floating-point technique for extending the available precision, 1971):
 * products of halves are exact. */
ARS_SECTION_CODE static float error_of(float product, float value, float steps)
{
    const float value_high = leading_part(value);
    const float value_low = value - value_high;
    const float steps_high = leading_part(steps);
    const float steps_low = steps - steps_high;

    return ((((value_high * steps_high) - product) + (value_high * steps_low)) + (value_low * steps_high))
        + (value_low * steps_low);
}

/* Return whether value * steps rounds away from zero. To be called if its rounded product lies midway between two codes: the
 * exact product decides, and for an exact tie the even code. */
ARS_SECTION_CODE static bool goes_outward(float scaled, float value, float steps, int32_t whole)
{
    const bool odd = (whole % 2) != 0;
    const float error = error_of(scaled, value, steps);
    const float outward = (scaled > 0.0f) ? error : -error;

    return (outward > 0.0f) || ((outward >= 0.0f) && odd);
}

/* Code nearest to value * steps, limited to low and high; ties go to the even code. NaN gives not_available. */
ARS_SECTION_CODE static int32_t to_code(float value, float steps, int32_t low, int32_t high, int32_t not_available)
{
    const float scaled = value * steps;
    int32_t code;

    if ((scaled > (float)low) && (scaled < (float)high)) {
        const int32_t whole = (int32_t)scaled; /* toward zero */
        const float rest = scaled - (float)whole;

        code = whole;
        if ((rest >= 0.5f) && ((rest > 0.5f) || goes_outward(scaled, value, steps, whole))) {
            code = whole + 1;
        }
        if ((rest <= -0.5f) && ((rest < -0.5f) || goes_outward(scaled, value, steps, whole))) {
            code = whole - 1;
        }
    } else if (scaled >= (float)high) {
        code = high;
    } else if (scaled <= (float)low) {
        code = low;
    } else {
        code = not_available; /* NaN */
    }
    return code;
}

ARS_SECTION_CODE static float to_value(int32_t code, float steps, int32_t not_available)
{
    return (code == not_available) ? ars_can_not_available() : ((float)code / steps);
}

ARS_SECTION_CODE static void clear(uint8_t data[8])
{
    uint32_t index;

    for (index = 0u; index < 8u; index++) {
        data[index] = 0u;
    }
}

ARS_SECTION_CODE void ars_can_pack_vehicle_motion(const ars_vehicle_motion_t *signals, uint8_t data[8])
{
    const int32_t speed = to_code(signals->speed, 200.0f, -32767, 32767, -32768);
    const int32_t front_angle = to_code(signals->front_angle, 20000.0f, -32767, 32767, -32768);
    const int32_t yaw_rate = to_code(signals->yaw_rate, 5000.0f, -32767, 32767, -32768);
    uint32_t code;

    clear(data);

    code = 0u;
    code |= (speed != -32768) ? 0x1u : 0u;
    code |= (front_angle != -32768) ? 0x2u : 0u;
    code |= (yaw_rate != -32768) ? 0x4u : 0u;
    data[1] |= (uint8_t)((code & 0x0Fu) << 4u);

    code = (uint32_t)speed & 0xFFFFu;
    data[2] |= (uint8_t)(code & 0xFFu);
    data[3] |= (uint8_t)((code >> 8u) & 0xFFu);

    code = (uint32_t)front_angle & 0xFFFFu;
    data[4] |= (uint8_t)(code & 0xFFu);
    data[5] |= (uint8_t)((code >> 8u) & 0xFFu);

    code = (uint32_t)yaw_rate & 0xFFFFu;
    data[6] |= (uint8_t)(code & 0xFFu);
    data[7] |= (uint8_t)((code >> 8u) & 0xFFu);
}

ARS_SECTION_CODE void ars_can_unpack_vehicle_motion(const uint8_t data[8], ars_vehicle_motion_t *signals)
{
    uint32_t code;
    uint32_t qualifier;

    code = ((uint32_t)data[1] >> 4u) & 0x0Fu;
    qualifier = code;

    code = (uint32_t)data[2] & 0xFFu;
    code |= ((uint32_t)data[3] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->speed = to_value((int32_t)code - 32768, 200.0f, -32768);
    if ((qualifier & 0x1u) == 0u) {
        signals->speed = ars_can_not_available();
    }

    code = (uint32_t)data[4] & 0xFFu;
    code |= ((uint32_t)data[5] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->front_angle = to_value((int32_t)code - 32768, 20000.0f, -32768);
    if ((qualifier & 0x2u) == 0u) {
        signals->front_angle = ars_can_not_available();
    }

    code = (uint32_t)data[6] & 0xFFu;
    code |= ((uint32_t)data[7] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->yaw_rate = to_value((int32_t)code - 32768, 5000.0f, -32768);
    if ((qualifier & 0x4u) == 0u) {
        signals->yaw_rate = ars_can_not_available();
    }
}

ARS_SECTION_CODE void ars_can_pack_vehicle_conditions(const ars_vehicle_conditions_t *signals, uint8_t data[8])
{
    const int32_t rear_angle = to_code(signals->rear_angle, 20000.0f, -32767, 32767, -32768);
    const int32_t friction = to_code(signals->friction, 100.0f, 0, 254, 255);
    const int32_t lateral_acceleration = to_code(signals->lateral_acceleration, 1000.0f, -32767, 32767, -32768);
    uint32_t code;

    clear(data);

    code = signals->inhibit ? 1u : 0u;
    data[1] |= (uint8_t)((code & 0x01u) << 4u);

    code = (uint32_t)rear_angle & 0xFFFFu;
    data[2] |= (uint8_t)(code & 0xFFu);
    data[3] |= (uint8_t)((code >> 8u) & 0xFFu);

    code = (uint32_t)friction & 0xFFu;
    data[4] |= (uint8_t)(code & 0xFFu);

    code = (uint32_t)lateral_acceleration & 0xFFFFu;
    data[6] |= (uint8_t)(code & 0xFFu);
    data[7] |= (uint8_t)((code >> 8u) & 0xFFu);
}

ARS_SECTION_CODE void ars_can_unpack_vehicle_conditions(const uint8_t data[8], ars_vehicle_conditions_t *signals)
{
    uint32_t code;

    code = ((uint32_t)data[1] >> 4u) & 0x01u;
    signals->inhibit = code != 0u;

    code = (uint32_t)data[2] & 0xFFu;
    code |= ((uint32_t)data[3] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->rear_angle = to_value((int32_t)code - 32768, 20000.0f, -32768);

    code = (uint32_t)data[4] & 0xFFu;
    signals->friction = to_value((int32_t)code, 100.0f, 255);

    code = (uint32_t)data[6] & 0xFFu;
    code |= ((uint32_t)data[7] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->lateral_acceleration = to_value((int32_t)code - 32768, 1000.0f, -32768);
}

ARS_SECTION_CODE void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8])
{
    const int32_t rear_angle = to_code(signals->rear_angle, 20000.0f, -32767, 32767, -32768);
    const int32_t yaw_rate_reference = to_code(signals->yaw_rate_reference, 5000.0f, -32767, 32767, -32768);
    uint32_t code;

    clear(data);

    code = (uint32_t)signals->status & 0xFu;
    data[1] |= (uint8_t)((code & 0x0Fu) << 4u);

    code = (uint32_t)rear_angle & 0xFFFFu;
    data[2] |= (uint8_t)(code & 0xFFu);
    data[3] |= (uint8_t)((code >> 8u) & 0xFFu);

    code = (uint32_t)yaw_rate_reference & 0xFFFFu;
    data[4] |= (uint8_t)(code & 0xFFu);
    data[5] |= (uint8_t)((code >> 8u) & 0xFFu);

    code = (uint32_t)signals->diagnostics & 0xFFFFu;
    data[6] |= (uint8_t)(code & 0xFFu);
    data[7] |= (uint8_t)((code >> 8u) & 0xFFu);
}

ARS_SECTION_CODE void ars_can_unpack_rear_steer_command(const uint8_t data[8], ars_rear_steer_command_t *signals)
{
    uint32_t code;

    code = ((uint32_t)data[1] >> 4u) & 0x0Fu;
    signals->status = (uint8_t)code;

    code = (uint32_t)data[2] & 0xFFu;
    code |= ((uint32_t)data[3] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->rear_angle = to_value((int32_t)code - 32768, 20000.0f, -32768);

    code = (uint32_t)data[4] & 0xFFu;
    code |= ((uint32_t)data[5] & 0xFFu) << 8u;
    code ^= 0x8000u; /* two's complement */
    signals->yaw_rate_reference = to_value((int32_t)code - 32768, 5000.0f, -32768);

    code = (uint32_t)data[6] & 0xFFu;
    code |= ((uint32_t)data[7] & 0xFFu) << 8u;
    signals->diagnostics = (uint16_t)code;
}
