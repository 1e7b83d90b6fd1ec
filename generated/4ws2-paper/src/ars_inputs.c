/*
 * Plausibility checks of the inputs. See ars_inputs.h.
 *
 * Order of a step: check speed and front angle, find the yaw rate expected from them, check the yaw rate, replace implausible signals,
 * then learn the offsets.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_inputs.h"

#include "ars_sections.h"

#if ARS_INPUTS_BUILD != 0x76CDF87Cu
#error "ars_inputs.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* Friction coefficient above that of every road: the value while it is unknown. */
ARS_SECTION_CONST static const float friction_unknown = 2.0f;

/* m/s. At lower speeds the yaw rate is too small to compute the front angle from it. */
ARS_SECTION_CONST static const float speed_least = 1.0f;

/* m/s. At lower speeds the noise of the lateral acceleration looks like a turn. */
ARS_SECTION_CONST static const float lateral_speed_least = 5.0f;

/* m/s^2, largest change of the lateral acceleration in a sample that a car can make. */
ARS_SECTION_CONST static const float lateral_step_max = 2.0f;

/* m/s^2. Every car with turned front wheels reaches more, also on ice. */
ARS_SECTION_CONST static const float turn_acceleration_least = 1.0f;

/* m/s^2, largest change of the offset per sample: fast enough for a banked road, too slow for a car that starts to slide. */
ARS_SECTION_CONST static const float bank_step = 0.006f;

/* Learning rate for a deviation that both signals show, relative to one that only one shows: the former could be a turn. */
ARS_SECTION_CONST static const float ambiguous_share = 0.0625f;

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

/* Return whether the value is within +-largest; false for NaN. */
ARS_SECTION_CODE static bool is_within(float value, float largest)
{
    return magnitude(value) <= largest;
}

/* Return whether the value is between low and high; false for NaN. */
ARS_SECTION_CODE static bool is_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
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

/* Return the value moved towards zero by step, which is not negative; 0 for NaN. */
ARS_SECTION_CODE static float toward_zero(float value, float step)
{
    float result = 0.0f;

    if (value > step) {
        result = value - step;
    } else if (value < -step) {
        result = value + step;
    } else {
        /* closer to zero than one step */
    }
    return result;
}

/* Check a signal that was measured so far. It is lost after too many samples without it, and wrong if it changes by more than step_max
 * in a sample. Returns true while it is missing for a tolerated time. */
ARS_SECTION_CODE static bool follow(
    ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, bool is_available, float step_max)
{
    bool is_missing = false;

    if (!is_available) {
        self->missing++;
        is_missing = self->missing <= parameters->missing_samples_max;
        if (!is_missing) {
            self->source = ARS_SIGNAL_LOST;
        }
    } else {
        const float change_max = (self->missing > 0u) ? (step_max * ((float)self->missing + 1.0f)) : step_max;

        if (is_within(measured - self->value, change_max)) {
            self->value = measured;
        } else {
            self->source = ARS_SIGNAL_WRONG;
        }
    }
    return is_missing;
}

/* Reduce the count of missing samples by two: a signal that is available in most samples is predicted in the others. Call it only if no
 * signal is missing: with independent counts, signals that are missing alternately would be predicted forever. */
ARS_SECTION_CODE static void forget(ars_signal_t *self)
{
    const uint32_t missing = self->missing;

    if ((missing > 0u) && (self->source == ARS_SIGNAL_MEASURED)) {
        self->missing = (uint16_t)((missing > 1u) ? (missing - 2u) : 0u);
    }
}

/* Check a replaced signal. If it was wrong, the other signals must confirm it for recovery_samples consecutive samples. If it was lost, its
 * available samples must outnumber the missing ones by recovery_samples: on a bus that keeps losing frames, they are never consecutive. */
ARS_SECTION_CODE static void prove(
    ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, bool is_available, bool is_confirmed)
{
    if (is_available && (is_confirmed || (self->source == ARS_SIGNAL_LOST))) {
        self->good++;
    } else if ((self->source == ARS_SIGNAL_LOST) && (self->good > 0u) && (self->good < parameters->recovery_samples)) {
        self->good--; /* a larger count is that of a start, at which the first sample suffices */
    } else {
        self->good = 0u;
    }
    if (self->good >= parameters->recovery_samples) {
        self->source = ARS_SIGNAL_MEASURED;
        self->value = measured;
        self->good = 0u;
        self->missing = 0u;
    }
}

/* Return whether a signal is frozen: its value stays identical while measured and expected yaw rate diverge. *least_deviation is
 * their smallest deviation since the signal last changed. */
ARS_SECTION_CODE static bool is_frozen(
    const ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, float deviation, float *least_deviation)
{
    if ((deviation < *least_deviation) || (measured > self->value) || (measured < self->value)) {
        *least_deviation = deviation;
    }
    return (deviation - *least_deviation) > parameters->yaw_rate_frozen;
}

/* Update the friction estimate. A lost estimate moves slowly to the value of an unknown road. */
ARS_SECTION_CODE static void take_friction(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    if (is_between(measured, 0.0f, parameters->friction_max)) {
        self->friction = measured;
    } else {
        const float recovered_friction = self->friction + parameters->friction_recovery;

        self->friction = (recovered_friction < friction_unknown) ? recovered_friction : friction_unknown;
    }
}

ARS_SECTION_CODE bool ars_inputs_parameters_valid(const ars_inputs_parameters_t *parameters)
{
    return is_between(parameters->speed_max, 13.888889f, 200.0f)
        && is_between(parameters->front_angle_max, 0.17453292f, 1.5f)
        && is_between(parameters->yaw_rate_max, 0.43633232f, 20.0f)
        && is_between(parameters->rear_angle_max, 0.0017453292f, 0.7853982f)
        && is_between(parameters->friction_max, 0.5f, 2.0f)
        && is_between(parameters->speed_step, 0.12f, 200.0f)
        && is_between(parameters->front_angle_step, 0.010471975f, 3.0f)
        && is_between(parameters->yaw_rate_step, 0.034906585f, 40.0f)
        && is_between(parameters->wheelbase, 1.57f, 6.28f)
        && is_between(parameters->understeer_coefficient, -0.0035713008f, 0.0035452303f)
        && is_between(parameters->expected_share, 0.001f, 1.0f)
        && is_between(parameters->yaw_rate_tolerance, 0.08726646f, 20.0f)
        && is_between(parameters->lateral_acceleration_max, 3.0f, 100.0f)
        && is_between(parameters->yaw_rate_frozen, 0.008726646f, 20.0f)
        && is_between(parameters->speed_agreement, 0.027777778f, 200.0f)
        && is_between(parameters->yaw_rate_agreement, 0.0017453292f, 0.17453292f)
        && is_between(parameters->straight_yaw_rate, 0.0f, 1.0f)
        && is_between(parameters->yaw_rate_offset_max, 0.0f, 1.0f)
        && is_between(parameters->lateral_acceleration_offset_max, 0.0f, 10.0f)
        && is_between(parameters->yaw_rate_correction_share, 1.0e-06f, 0.25f)
        && is_between(parameters->speed_fall, 0.0f, 1.0f)
        && is_between(parameters->friction_recovery, 1.0e-05f, 1.0f)
        && (parameters->missing_samples_max <= 100u)
        && (parameters->recovery_samples >= 1u)
        && (parameters->recovery_samples <= 4000u);
}

ARS_SECTION_CODE static void signal_init(ars_signal_t *self, bool is_trusted)
{
    self->value = 0.0f;
    self->missing = 0u;
    self->good = is_trusted ? 4000u : 0u;
    self->source = ARS_SIGNAL_LOST;
}

ARS_SECTION_CODE void ars_inputs_init(ars_inputs_t *self, bool is_trusted)
{
    signal_init(&self->speed, is_trusted);
    signal_init(&self->front_angle, is_trusted);
    signal_init(&self->yaw_rate, is_trusted);
    self->expected_yaw_rate = 0.0f;
    self->least = 0.0f;
    self->least_of_front = 0.0f;
    self->yaw_rate_offset = 0.0f;
    self->lateral_acceleration_offset = 0.0f;
    self->beyond_linear = 0.0f;
    self->friction = friction_unknown;
    self->lateral_acceleration = 0.0f;
    self->least_of_lateral = 0.0f;
    self->lateral_against = 0u;
    self->lateral_is_wrong = false;
    self->lateral_is_known = false;
    self->lateral_is_proven = false;
}

ARS_SECTION_CODE static ars_quality_t quality_of(const ars_inputs_t *self, bool has_missing)
{
    ars_quality_t quality = ARS_QUALITY_GOOD;

    if (self->front_angle.source != ARS_SIGNAL_MEASURED) {
        quality = (self->yaw_rate.source == ARS_SIGNAL_MEASURED) ? ARS_QUALITY_REPLACED : ARS_QUALITY_UNUSABLE;
    } else if ((self->yaw_rate.source != ARS_SIGNAL_MEASURED) || (self->speed.source != ARS_SIGNAL_MEASURED)) {
        quality = ARS_QUALITY_REPLACED;
    } else {
        /* good */
    }
    return (has_missing && (quality != ARS_QUALITY_UNUSABLE)) ? ARS_QUALITY_MISSING : quality;
}

/* Yaw rate of the linear vehicle per net steering angle, in 1/s. Bounded for an oversteering vehicle near its critical speed. */
ARS_SECTION_CODE static float yaw_gain(const ars_inputs_parameters_t *parameters, float speed)
{
    const float length_min = 0.25f * parameters->wheelbase;
    const float effective_length = parameters->wheelbase + ((parameters->understeer_coefficient * speed) * speed);

    return speed / ((effective_length > length_min) ? effective_length : length_min);
}

/* Return whether a yaw rate agrees with that of a turn. Near zero it does not count: agreement on a straight proves nothing. */
ARS_SECTION_CODE static bool agrees(const ars_inputs_parameters_t *parameters, float yaw_rate, float turn_yaw_rate)
{
    const float agreement = parameters->yaw_rate_agreement;

    return !is_within(turn_yaw_rate, agreement + agreement) && is_within(yaw_rate - turn_yaw_rate, agreement);
}

/* Turn that follows from the lateral acceleration. */
typedef struct {
    float yaw_rate; /* rad/s */
    bool is_there;
    bool is_evidence; /* available, and it agreed with the yaw rate in the last turn */
} lateral_t;

ARS_SECTION_CONST static const lateral_t no_lateral = { 0.0f, false, false };

ARS_SECTION_CODE static lateral_t turn_of_lateral(
    const ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    lateral_t lateral = no_lateral;

    if ((self->speed.value >= lateral_speed_least) && is_within(measured, parameters->lateral_acceleration_max)) {
        lateral.yaw_rate = (measured - self->lateral_acceleration_offset) / self->speed.value;
        lateral.is_there = true;
        lateral.is_evidence = self->lateral_is_proven;
    }
    return lateral;
}

/* Judge whether the lateral acceleration may be used. It is compared with a yaw rate that the steering angles confirm. It contradicts
 * that yaw rate if it implies a turn in the other direction, or one that differs by half: no car slides like this for long. A jump
 * counts as wrong at once, and so does a value that stays constant to the bit while the yaw rate moves away from it. The signal is
 * used again after 5 * recovery_samples samples without a contradiction. */
ARS_SECTION_CODE static void judge_lateral(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, const lateral_t *lateral)
{
    const float yaw_rate = self->yaw_rate.value;
    const float deviation = magnitude(lateral->yaw_rate - yaw_rate);
    const uint32_t against_max = 5u * parameters->recovery_samples;
    const bool is_confirmed = is_within(self->expected_yaw_rate - yaw_rate, parameters->yaw_rate_agreement);

    if ((deviation < self->least_of_lateral) || (measured > self->lateral_acceleration) || (measured < self->lateral_acceleration)) {
        self->least_of_lateral = deviation;
    }
    if (!is_within(measured - self->lateral_acceleration, lateral_step_max)
        || (is_confirmed && ((deviation - self->least_of_lateral) > parameters->yaw_rate_agreement))) {
        self->lateral_against = (uint16_t)against_max;
    } else if (is_confirmed && (deviation > (parameters->yaw_rate_agreement + (0.5f * magnitude(yaw_rate))))) {
        if (self->lateral_against < against_max) {
            self->lateral_against++;
        }
    } else if (self->lateral_against > 0u) {
        self->lateral_against--;
    } else {
        /* no contradiction for long */
    }
    self->lateral_acceleration = measured;
    if (self->lateral_against >= against_max) {
        self->lateral_is_wrong = true;
    } else if (self->lateral_against == 0u) {
        self->lateral_is_wrong = false;
    } else {
        /* hysteresis */
    }
}

/* Check the speed against the one implied by the motion: lateral acceleration / yaw rate. The implied speed counts only if the
 * steering angles give the same yaw rate at it, because a banked road changes the acceleration alone. A measured speed is wrong after
 * deviating from it for fifteen times recovery_samples; a replaced speed moves slowly to it.
 * net_steering_angle: rad, front minus rear angle. */
ARS_SECTION_CODE static void check_speed(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float net_steering_angle, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->speed;
    const float yaw_rate = self->yaw_rate.value;
    const float implied_speed = (lateral->yaw_rate * signal->value) / yaw_rate;

    if (is_within((yaw_gain(parameters, implied_speed) * net_steering_angle) - yaw_rate, parameters->yaw_rate_agreement)) {
        const float speed_deviation = implied_speed - signal->value;

        if (signal->source != ARS_SIGNAL_MEASURED) {
            signal->value = bounded(signal->value + (parameters->yaw_rate_correction_share * speed_deviation), parameters->speed_max);
        } else if (!is_within(speed_deviation, parameters->speed_agreement)) {
            signal->good++;
            if (signal->good >= (15u * parameters->recovery_samples)) {
                signal->source = ARS_SIGNAL_WRONG;
                signal->value = bounded(implied_speed, parameters->speed_max);
                signal->good = 0u;
            }
        } else {
            signal->good = 0u;
        }
    }
}

/* Compare yaw rate and lateral acceleration in a turn. Agreement proves the lateral acceleration. It is refuted if the yaw rate agrees
 * with the front angle instead. If the yaw rate agrees with neither, the speed may be wrong. */
ARS_SECTION_CODE static void compare_with_lateral(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float net_steering_angle, const lateral_t *lateral)
{
    const float agreement = parameters->yaw_rate_agreement;
    const float yaw_rate = self->yaw_rate.value;
    const float yaw_rate_deviation = lateral->yaw_rate - yaw_rate;

    if (is_within(yaw_rate, agreement + agreement)) {
        /* no turn */
    } else if (is_within(yaw_rate_deviation, agreement)) {
        self->lateral_is_proven = true;
    } else if (!is_within(self->expected_yaw_rate - yaw_rate, agreement)) {
        if (lateral->is_evidence) {
            check_speed(self, parameters, net_steering_angle, lateral);
        }
    } else if (!is_within(yaw_rate_deviation, agreement + agreement) && (self->speed.source == ARS_SIGNAL_MEASURED)) {
        self->lateral_is_proven = false;
    } else {
        /* not conclusive */
    }
}

/* Return whether a speed that was wrong is plausible again, that is, close to its replacement. The tolerance grows by a quarter of the
 * replacement, which cannot follow changes of the true speed. A replacement near standstill confirms every speed. */
ARS_SECTION_CODE static bool is_right_again(const ars_inputs_parameters_t *parameters, float measured, float replacement)
{
    const float replacement_speed = magnitude(replacement);

    return (replacement_speed < speed_least)
        || is_within(measured - replacement, parameters->speed_agreement + (0.25f * replacement_speed));
}

/* Check the speed. Returns true while it is missing for a tolerated time, as the next two functions do. */
ARS_SECTION_CODE static bool take_speed(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    ars_signal_t *const signal = &self->speed;
    const bool is_available = is_within(measured, parameters->speed_max);
    bool is_missing = false;

    if (signal->source == ARS_SIGNAL_MEASURED) {
        is_missing = follow(signal, parameters, measured, is_available, parameters->speed_step);
        signal->good = (signal->source == ARS_SIGNAL_MEASURED) ? signal->good : 0u;
    } else {
        prove(signal, parameters, measured, is_available, is_right_again(parameters, measured, signal->value));
    }
    if (signal->source != ARS_SIGNAL_MEASURED) {
        signal->value = toward_zero(signal->value, parameters->speed_fall);
    }
    return is_missing;
}

/* Check the front angle. front_yaw_rate: rad/s, of the linear vehicle with the measured front angle. While the driver holds the wheel
 * still, soft tyres or a slippery road also make the vehicle deviate. A frozen angle is therefore wrong only if yaw rate and lateral
 * acceleration agree for three times recovery_samples that there is no turn to its side, not even one on ice. */
ARS_SECTION_CODE static bool take_front_angle(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, float front_yaw_rate, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->front_angle;
    const float yaw_rate = self->yaw_rate.value;
    const float expected_yaw_rate = self->expected_yaw_rate;
    const bool is_available = is_within(measured, parameters->front_angle_max);
    bool has_frozen = false;
    bool is_missing = false;

    if ((signal->source == ARS_SIGNAL_MEASURED) && (self->yaw_rate.source == ARS_SIGNAL_MEASURED)) {
        has_frozen = is_frozen(signal, parameters, measured, magnitude(yaw_rate - expected_yaw_rate), &self->least_of_front);
    } else {
        self->least_of_front = 2.0f * parameters->yaw_rate_max; /* above every deviation */
    }
    if (signal->source != ARS_SIGNAL_MEASURED) {
        prove(signal, parameters, measured, is_available, agrees(parameters, front_yaw_rate, yaw_rate));
    } else {
        is_missing = follow(signal, parameters, measured, is_available, parameters->front_angle_step);
        if (is_available && has_frozen && lateral->is_evidence
            && (((yaw_rate * expected_yaw_rate) * self->speed.value) < (turn_acceleration_least * magnitude(expected_yaw_rate)))
            && is_within(lateral->yaw_rate - yaw_rate, parameters->yaw_rate_agreement)) {
            signal->good++;
        } else {
            signal->good = 0u;
        }
        if (signal->good >= (3u * parameters->recovery_samples)) {
            signal->source = ARS_SIGNAL_WRONG;
        }
        signal->good = (signal->source == ARS_SIGNAL_MEASURED) ? signal->good : 0u;
    }
    return is_missing;
}

/* Return whether a yaw rate contradicts both the steering angles and the lateral acceleration: it has the opposite sign to both. A smaller
 * one is no contradiction, because the tyres of the car may give less than those of the linear vehicle. */
ARS_SECTION_CODE static bool contradicts(
    const ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, const lateral_t *lateral)
{
    const float turn_yaw_rate_min = 2.0f * parameters->yaw_rate_agreement;

    return ((measured * self->expected_yaw_rate) < 0.0f) && ((measured * lateral->yaw_rate) < 0.0f)
        && !is_within(measured, turn_yaw_rate_min) && !is_within(lateral->yaw_rate, turn_yaw_rate_min);
}

/* Check the yaw rate. It may exceed what the grip of the road allows by a tolerance, for a spinning car. It is wrong if it is frozen, or
 * if for recovery_samples it contradicts the other signals.
 * net_steering_angle: rad, front minus rear angle. */
ARS_SECTION_CODE static bool take_yaw_rate(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, float net_steering_angle, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->yaw_rate;
    const float speed = magnitude(self->speed.value);
    const float expected_yaw_rate = self->expected_yaw_rate;
    const bool is_available = is_within(measured, parameters->yaw_rate_max)
        && is_within(speed * measured, parameters->lateral_acceleration_max + (speed * parameters->yaw_rate_tolerance));
    bool is_missing = false;

    if (signal->source != ARS_SIGNAL_MEASURED) {
        self->least = 2.0f * parameters->yaw_rate_max; /* above every deviation */
        prove(signal, parameters, measured, is_available, agrees(parameters, measured, signal->value));
    } else if (is_available) {
        const bool has_frozen = is_frozen(signal, parameters, measured, magnitude(measured - expected_yaw_rate), &self->least);

        if (contradicts(self, parameters, measured, lateral)) {
            signal->good++;
        } else {
            signal->good = 0u;
        }
        is_missing = follow(signal, parameters, measured, true, parameters->yaw_rate_step);
        if (has_frozen || (signal->good >= parameters->recovery_samples)) {
            signal->source = ARS_SIGNAL_WRONG;
        }
        if (signal->source != ARS_SIGNAL_MEASURED) {
            signal->good = 0u;
        } else if (lateral->is_there) {
            compare_with_lateral(self, parameters, net_steering_angle, lateral);
        } else {
            /* no lateral acceleration to compare with */
        }
    } else {
        signal->good = 0u;
        is_missing = follow(signal, parameters, measured, false, parameters->yaw_rate_step);
    }
    return is_missing;
}

/* Learn the offsets of yaw rate and lateral acceleration. On a straight both are compared with the expected yaw rate; a difference
 * above the largest offset is a disturbance. A deviation that both show is probably a turn and is learned slowly. In a turn only the
 * offset of the acceleration is learned, from the yaw rate: a banked road changes the acceleration alone, like a loss of grip. */
ARS_SECTION_CODE static void learn_offsets(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float front_yaw_rate, float expected_yaw_rate,
    const lateral_t *lateral)
{
    const float share = parameters->yaw_rate_correction_share;
    const float slow_share = ambiguous_share * share;
    const float difference = self->yaw_rate.value - expected_yaw_rate;
    const float yaw_rate_error = difference - self->yaw_rate_offset;
    float offset = self->lateral_acceleration_offset;

    if (self->speed.value < lateral_speed_least) {
        /* too slow */
    } else if (!is_within(front_yaw_rate, parameters->straight_yaw_rate)) {
        if (lateral->is_there) {
            offset += bounded(
                self->speed.value * (lateral->yaw_rate - (self->yaw_rate.value - self->yaw_rate_offset)), bank_step);
        }
    } else if (is_within(difference, parameters->yaw_rate_offset_max) && (lateral->is_there || !self->lateral_is_known)) {
        float common = yaw_rate_error;

        if (lateral->is_there) {
            const float lateral_error = lateral->yaw_rate - expected_yaw_rate;

            common = ((yaw_rate_error * lateral_error) > 0.0f) ? bounded(yaw_rate_error, magnitude(lateral_error)) : 0.0f;
            offset += self->speed.value * (((3.0f * share) * (lateral_error - common)) + (slow_share * common));
        }
        self->yaw_rate_offset = bounded(
            self->yaw_rate_offset + ((share * (yaw_rate_error - common)) + (slow_share * common)), parameters->yaw_rate_offset_max);
    } else {
        /* disturbed, or the lateral acceleration is missing */
    }
    self->lateral_acceleration_offset = bounded(offset, parameters->lateral_acceleration_offset_max);
}

/* Replace the yaw rate by the expected one and a slow correction from the lateral acceleration. A fast correction would oscillate,
 * because the lateral acceleration depends on the yaw rate through the rear angle. */
ARS_SECTION_CODE static void stand_in(ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const lateral_t *lateral)
{
    float correction = 0.0f;

    if (lateral->is_evidence) {
        correction = lateral->yaw_rate - self->expected_yaw_rate;
    }
    correction = self->beyond_linear + (parameters->yaw_rate_correction_share * (correction - self->beyond_linear));
    self->beyond_linear = bounded(correction, parameters->yaw_rate_max);
    self->yaw_rate.value = bounded(self->expected_yaw_rate + self->beyond_linear, parameters->yaw_rate_max);
}

/* Move the expected yaw rate towards the steady one of the linear vehicle, with the lag of a real vehicle. */
ARS_SECTION_CODE static float follow_linear_vehicle(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float steady_yaw_rate)
{
    const float expected_yaw_rate
        = self->expected_yaw_rate + (parameters->expected_share * (steady_yaw_rate - self->expected_yaw_rate));

    self->expected_yaw_rate = bounded(expected_yaw_rate, parameters->yaw_rate_max);
    return self->expected_yaw_rate;
}

ARS_SECTION_CODE ars_quality_t ars_inputs_step(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle,
    ars_measurement_t *checked)
{
    const float checked_rear_angle
        = is_within(measured->rear_angle, parameters->rear_angle_max) ? measured->rear_angle : rear_angle;
    bool has_missing = take_speed(self, parameters, measured->speed);
    const float gain = yaw_gain(parameters, self->speed.value);
    lateral_t lateral = turn_of_lateral(self, parameters, measured->lateral_acceleration);
    const float linear_yaw_rate = gain * (measured->front_angle - checked_rear_angle);
    float net_steering_angle;
    float expected_yaw_rate;

    if (lateral.is_there) {
        self->lateral_is_known = true;
        judge_lateral(self, parameters, measured->lateral_acceleration, &lateral);
        if (self->lateral_is_wrong) {
            lateral = no_lateral;
        }
    }
    has_missing = take_front_angle(self, parameters, measured->front_angle, linear_yaw_rate, &lateral) || has_missing;
    net_steering_angle = self->front_angle.value - checked_rear_angle;
    expected_yaw_rate = follow_linear_vehicle(self, parameters, gain * net_steering_angle);
    has_missing = take_yaw_rate(self, parameters, measured->yaw_rate, net_steering_angle, &lateral) || has_missing;
    if ((self->front_angle.source == ARS_SIGNAL_WRONG) && (self->yaw_rate.source == ARS_SIGNAL_WRONG)) {
        self->front_angle.source = ARS_SIGNAL_LOST; /* neither can confirm the other */
        self->yaw_rate.source = ARS_SIGNAL_LOST;
    }
    if (self->yaw_rate.source != ARS_SIGNAL_MEASURED) {
        stand_in(self, parameters, &lateral);
    } else if ((self->front_angle.source != ARS_SIGNAL_MEASURED) && (self->speed.value >= speed_least)) {
        self->front_angle.value = bounded(checked_rear_angle + (self->yaw_rate.value / gain), parameters->front_angle_max);
    } else {
        /* both are measured, or the car is too slow */
    }
    if (!has_missing) {
        forget(&self->speed);
        forget(&self->front_angle);
        forget(&self->yaw_rate);
    }
    take_friction(self, parameters, measured->friction);
    checked->speed = self->speed.value;
    checked->front_angle = self->front_angle.value;
    checked->yaw_rate = self->yaw_rate.value;
    if (self->yaw_rate.source == ARS_SIGNAL_MEASURED) {
        self->beyond_linear = 0.0f;
        if (!has_missing && !measured->inhibit) {
            learn_offsets(self, parameters, gain * self->front_angle.value, expected_yaw_rate, &lateral);
        }
        checked->yaw_rate = bounded(self->yaw_rate.value - self->yaw_rate_offset, parameters->yaw_rate_max);
    }
    checked->rear_angle = checked_rear_angle;
    checked->friction = self->friction;
    checked->lateral_acceleration = checked->speed * (lateral.is_there ? lateral.yaw_rate : checked->yaw_rate);
    checked->inhibit = measured->inhibit;
    return quality_of(self, has_missing);
}
