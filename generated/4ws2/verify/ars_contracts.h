/*
 * Contracts of the functions: what each requires of its arguments, and what it ensures.
 *
 * Not part of the ECU software. The harnesses prove_*.c prove that a function meets its contract; assume_*.c stand for a function
 * where its callers are proved. The including file defines CONTRACT_REQUIRE and CONTRACT_ENSURE, one of which assumes a condition while
 * the other one asserts it. A lemma_*() is assumed everywhere but in its own proof.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CONTRACTS_H
#define ARS_CONTRACTS_H

#define CONTRACT_ASSUME(condition) __CPROVER_assume(condition)

#include <math.h>

#include "ars_constants.h"
#include "ars_map.h"
#include "ars_task.h"

#if ARS_MAP_BUILD != 0xC9A75925u
#error "ars_map.h and this source come from different builds"
#endif
#if ARS_TASK_BUILD != 0xC9A75925u
#error "ars_task.h and this source come from different builds"
#endif

/* Return the number without its sign. */
static inline float magnitude_of(float value)
{
    return (value < 0.0f) ? -value : value;
}

/* Return whether the value is between low and high; false for NaN. */
static inline bool lies_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
}

/* Return whether the value is within +-largest; false for NaN. */
static inline bool lies_within(float value, float largest)
{
    return lies_between(value, -largest, largest);
}

/* Return the value within +-largest, and zero for NaN. */
static inline float held_within(float value, float largest)
{
    return (value > largest) ? largest : ((value < -largest) ? -largest : ((value == value) ? value : 0.0f));
}

/* Return whether a number is the negative of another one; zero has no sign here. True for two NaN. */
static inline bool are_mirrored(float first, float second)
{
    return (first == -second) || ((first != first) && (second != second));
}

/* Return whether a bool is true or false: memory may hold other numbers. */
static inline bool is_flag(bool value)
{
    return (value == false) || (value == true);
}

/* Return the code of a signal in a frame. Bits are numbered as in a DBC: from the least significant one for Intel byte order, from the
 * most significant one for Motorola. */
static inline uint32_t code_in(const uint8_t data[8], uint32_t start_bit, uint32_t length, bool is_motorola)
{
    uint32_t code = 0u;
    uint32_t bit = start_bit;
    uint32_t k;

    for (k = 0u; k < length; k++) {
        const uint32_t value = ((uint32_t)data[bit / 8u] >> (bit % 8u)) & 1u;

        if (is_motorola) {
            code = (code << 1u) | value;
            bit = ((bit % 8u) == 0u) ? (bit + 15u) : (bit - 1u);
        } else {
            code |= value << k;
            bit++;
        }
    }
    return code;
}

static inline bool ars_limiter_parameters_holds(const ars_limiter_parameters_t *value)
{
    bool holds = lies_between(value->rear_angle_max, 1.0e-04f, 1.0f)
        && lies_between(value->rear_rate_max, 0.017453292f, 1000.0f)
        && lies_between(value->in_phase_from_front_angle, 1.0e-04f, 1.0f)
        && lies_between(value->speed_max, 1.0f, 200.0f)
        && lies_between(value->front_angle_max, 0.01f, 1.5f);
    uint32_t k;

    for (k = 0u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        holds = holds && lies_between(value->opposite_phase_speed[k], 0.0f, 200.0f)
            && ((k == 0u) || (value->opposite_phase_speed[k - 1u] < value->opposite_phase_speed[k]))
            && lies_between(value->opposite_phase_max[k], 0.0f, 1.0f)
            && (value->opposite_phase_max[k] <= value->rear_angle_max);
    }
    return holds;
}

static inline bool ars_inputs_parameters_holds(const ars_inputs_parameters_t *value)
{
    bool holds = lies_between(value->speed_max, 13.888889f, 200.0f)
        && lies_between(value->front_angle_max, 0.17453292f, 1.5f)
        && lies_between(value->yaw_rate_max, 0.43633232f, 20.0f)
        && lies_between(value->rear_angle_max, 0.0017453292f, 0.7853982f)
        && lies_between(value->friction_max, 0.5f, 2.0f)
        && lies_between(value->speed_step, 0.12f, 200.0f)
        && lies_between(value->front_angle_step, 0.010471975f, 3.0f)
        && lies_between(value->yaw_rate_step, 0.034906585f, 40.0f)
        && lies_between(value->wheelbase, 1.57f, 6.28f)
        && lies_between(value->understeer_coefficient, -0.0035713008f, 0.0035452303f)
        && lies_between(value->expected_share, 0.001f, 1.0f)
        && lies_between(value->yaw_rate_tolerance, 0.08726646f, 20.0f)
        && lies_between(value->lateral_acceleration_max, 3.0f, 100.0f)
        && lies_between(value->yaw_rate_frozen, 0.008726646f, 20.0f)
        && lies_between(value->speed_agreement, 0.027777778f, 200.0f)
        && lies_between(value->yaw_rate_agreement, 0.0017453292f, 0.17453292f)
        && lies_between(value->straight_yaw_rate, 0.0f, 1.0f)
        && lies_between(value->yaw_rate_offset_max, 0.0f, 1.0f)
        && lies_between(value->lateral_acceleration_offset_max, 0.0f, 10.0f)
        && lies_between(value->yaw_rate_correction_share, 1.0e-06f, 0.25f)
        && lies_between(value->speed_fall, 0.0f, 1.0f)
        && lies_between(value->friction_recovery, 1.0e-05f, 1.0f)
        && (value->missing_samples_max <= 100u)
        && (value->recovery_samples >= 1u)
        && (value->recovery_samples <= 4000u);
    return holds;
}

static inline bool ars_parameters_holds(const ars_parameters_t *value)
{
    bool holds = lies_between(value->lead_smoothing, 0.01f, 1.0f)
        && lies_between(value->lead_angle_max, 0.0f, 0.5f)
        && lies_between(value->response_samples, 0.0f, 100.0f)
        && lies_between(value->yaw_increasing_max, 0.0f, 1.0f)
        && lies_between(value->yaw_increasing_wide, 0.0f, 1.0f)
        && lies_between(value->sideslip_max, 0.005f, 1.0f)
        && lies_between(value->turn_margin_rate, 0.0f, 1.0f)
        && lies_between(value->turn_margin, 0.0f, 10.0f)
        && lies_between(value->trim_share, 0.0f, 0.2f)
        && lies_between(value->trim_rate, 0.01f, 20.0f)
        && lies_between(value->grip_shortfall, 0.1f, 20.0f)
        && lies_between(value->grip_shortfall_share, 0.0f, 1.0f)
        && lies_between(value->grip_loss_rate, 0.1f, 50.0f)
        && lies_between(value->grip_forgetting, 0.01f, 50.0f)
        && lies_between(value->grip_recovery, 0.01f, 100.0f)
        && lies_between(value->grip_recovery_idle, 0.01f, 100.0f)
        && lies_between(value->rear_angle_error_max, 0.0017453292f, 1.0f)
        && lies_between(value->rear_angle_max, 1.0e-04f, 0.061086524f)
        && lies_between(value->rear_rate_max, 0.017453292f, 1000.0f)
        && lies_between(value->friction_min, 0.02f, 0.5f)
        && lies_between(value->slow_speed, 0.5555556f, 13.888889f)
        && lies_between(value->fade_rate, 1.0e-05f, 3.0f)
        && lies_between(value->fail_safe_rate, 0.0034906585f, 1.7453293f)
        && lies_between(value->actuator_share, 1.0e-04f, 1.0f)
        && lies_between(value->actuator_error_max, 1.0e-04f, 1.5f)
        && (value->actuator_samples_max >= 1u)
        && (value->actuator_samples_max <= 60000u)
        && (value->inhibit_samples_max >= 1u)
        && (value->inhibit_samples_max <= 60000u)
        && (value->rear_angle_max <= value->inputs.rear_angle_max)
        && (value->inputs.speed_max <= value->limiter.speed_max)
        && (value->inputs.front_angle_max <= value->limiter.front_angle_max)
        && (value->limiter.rear_angle_max <= value->rear_angle_max)
        && ars_inputs_parameters_holds(&value->inputs)
        && ars_limiter_parameters_holds(&value->limiter);
    uint32_t k;

    for (k = 0u; k < (uint32_t)ARS_SCHEDULE_POINTS; k++) {
        holds = holds && lies_between(value->schedule_speed[k], 0.0f, 200.0f)
            && ((k == 0u) || (value->schedule_speed[k - 1u] < value->schedule_speed[k]))
            && lies_between(value->proportional_gain[k], 0.0f, 2.0f)
            && lies_between(value->integral_gain[k], 0.01f, 20.0f)
            && lies_between(value->lead_time[k], -0.2f, 0.2f)
            && lies_between(value->response_gain[k], 0.0f, 2.0f);
    }
    return holds;
}

static inline bool ars_limiter_holds(const ars_limiter_t *value)
{
    bool holds = lies_within(value->rear_angle, 1.0f)
        && lies_between(value->speed, 0.0f, 200.0f)
        && lies_within(value->front_angle, 1.5f)
        && is_flag(value->speed_known);
    return holds;
}

static inline bool ars_inputs_holds(const ars_inputs_t *value)
{
    bool holds = lies_within(value->speed.value, 200.0f)
        && lies_within(value->front_angle.value, 1.5f)
        && lies_within(value->yaw_rate.value, 20.0f)
        && ((uint32_t)value->speed.source <= 2u)
        && ((uint32_t)value->front_angle.source <= 2u)
        && ((uint32_t)value->yaw_rate.source <= 2u)
        && (value->speed.missing <= 101u)
        && (value->front_angle.missing <= 101u)
        && (value->yaw_rate.missing <= 101u)
        && (!(value->speed.source == ARS_SIGNAL_MEASURED) || (value->speed.missing <= 100u))
        && (!(value->front_angle.source == ARS_SIGNAL_MEASURED) || (value->front_angle.missing <= 100u))
        && (!(value->yaw_rate.source == ARS_SIGNAL_MEASURED) || (value->yaw_rate.missing <= 100u))
        && (((value->front_angle.source == ARS_SIGNAL_MEASURED) && (value->front_angle.good <= 12000u)) || (value->front_angle.good <= 4000u))
        && (value->yaw_rate.good <= 4000u)
        && lies_within(value->expected_yaw_rate, 20.0f)
        && lies_within(value->beyond_linear, 20.0f)
        && lies_between(value->least, 0.0f, (2.0f * 20.0f))
        && lies_between(value->least_of_front, 0.0f, (2.0f * 20.0f))
        && lies_within(value->yaw_rate_offset, 1.0f)
        && lies_within(value->lateral_acceleration_offset, 10.0f)
        && lies_between(value->friction, 0.0f, 2.0f)
        && lies_within(value->lateral_acceleration, 100.0f)
        && lies_between(value->least_of_lateral, 0.0f, 64.0f)
        && (value->lateral_against <= 20000u)
        && is_flag(value->lateral_is_known)
        && is_flag(value->lateral_is_proven)
        && is_flag(value->lateral_is_wrong)
        && is_flag(value->turn_is_confirmed);
    return holds;
}

static inline bool ars_reference_model_holds(const ars_reference_model_t *value)
{
    bool holds = lies_within(value->sideslip_angle, 0.34906584f)
        && lies_within(value->yaw_rate, 2.6179938f)
        && lies_within(value->rear_angle, 0.061086524f)
        && lies_within(value->lateral_acceleration, 20.0f)
        && lies_within(value->front_argument, 1000.0f)
        && lies_within(value->rear_argument, 1000.0f);
    return holds;
}

static inline bool ars_grip_holds(const ars_grip_t *value)
{
    bool holds = lies_between(value->reached, 0.0f, 8192.0f)
        && lies_between(value->available, 0.087190285f, 7.8471293f);
    return holds;
}

static inline bool ars_law_holds(const ars_law_t *value)
{
    bool holds = ars_reference_model_holds(&value->model)
        && lies_within(value->trim, 16.0f)
        && lies_within(value->sideslip, 0.34906584f)
        && lies_within(value->integral, 4096.0f)
        && lies_within(value->front_angle, 1.5f)
        && lies_within(value->front_rate, 4096.0f)
        && lies_within(value->previous_model_yaw_rate, 2.6179938f)
        && lies_within(value->yaw_rate, 20.0f)
        && is_flag(value->is_limited);
    return holds;
}

static inline bool ars_controller_holds(const ars_controller_t *value)
{
    bool holds = ars_law_holds(&value->law)
        && ars_inputs_holds(&value->inputs)
        && ars_limiter_holds(&value->limiter)
        && ars_grip_holds(&value->grip)
        && lies_within(value->rear_angle, 0.061086524f)
        && lies_within(value->yaw_rate_reference, 20.0f)
        && lies_within(value->yaw_rate_error, 40.0f)
        && (value->initialised == 0x41525331u)
        && lies_within(value->sample.speed, 200.0f)
        && lies_within(value->sample.front_angle, 1.5f)
        && lies_within(value->sample.yaw_rate, 20.0f)
        && lies_within(value->sample.rear_angle, 1.0f)
        && lies_within(value->sample.lateral_acceleration, 8192.0f)
        && lies_between(value->sample.friction, 0.0f, 2.0f)
        && is_flag(value->sample.inhibit)
        && ((uint32_t)value->quality <= 3u)
        && ((uint32_t)value->status <= 4u)
        && is_flag(value->enabled)
        && ((value->status > ARS_STATUS_LIMITED) || value->enabled)
        && (((value->status != ARS_STATUS_STANDBY) && (value->status != ARS_STATUS_FAIL_SAFE)) || !value->enabled)
        && (value->rear_angle == value->limiter.rear_angle)
        && ((value->quality != ARS_QUALITY_UNUSABLE) || ((value->status == ARS_STATUS_FAIL_SAFE) && !(value->inputs.front_angle.source == ARS_SIGNAL_MEASURED) && !(value->inputs.yaw_rate.source == ARS_SIGNAL_MEASURED)));
    return holds;
}

static inline bool ars_e2e_receiver_holds(const ars_e2e_receiver_t *value)
{
    bool holds = (value->last_counter <= 14u)
        && (value->max_delta_counter <= 14u)
        && (value->no_new_or_repeated_data_counter <= 14u)
        && (value->sync_counter <= 1u)
        && is_flag(value->waits_for_first);
    return holds;
}

static inline bool ars_e2e_supervision_holds(const ars_e2e_supervision_t *value)
{
    bool holds = ((uint32_t)value->state <= 3u);
    return holds;
}

static inline bool ars_task_input_holds(const ars_task_input_t *value)
{
    bool holds = ars_e2e_receiver_holds(&value->receiver)
        && ars_e2e_supervision_holds(&value->supervision)
        && (value->causes <= 7u)
        && (value->advance <= 7u)
        && is_flag(value->out_of_sequence)
        && is_flag(value->disturbed)
        && is_flag(value->usable);
    return holds;
}

static inline bool ars_supervision_holds(const ars_supervision_t *value)
{
    bool holds = ((uint32_t)value->state <= 7u)
        && ((uint32_t)value->cause <= 10u)
        && ((uint32_t)value->status <= 4u)
        && is_flag(value->has_command)
        && (value->has_command == ((value->state != ARS_SUPERVISION_START) && (value->state != ARS_SUPERVISION_RESYNCHRONISE)));
    return holds;
}

static inline bool ars_task_holds(const ars_task_t *value)
{
    bool holds = ars_controller_holds(&value->controller)
        && ars_task_input_holds(&value->motion_input)
        && ((value->motion.speed != value->motion.speed) || lies_between(value->motion.speed, -163.84f, 163.84f))
        && ((value->motion.front_angle != value->motion.front_angle) || lies_between(value->motion.front_angle, -1.6384f, 1.6384f))
        && ((value->motion.yaw_rate != value->motion.yaw_rate) || lies_between(value->motion.yaw_rate, -6.5536f, 6.5536f))
        && ars_task_input_holds(&value->conditions_input)
        && ((value->conditions.rear_angle != value->conditions.rear_angle) || lies_between(value->conditions.rear_angle, -1.6384f, 1.6384f))
        && ((value->conditions.friction != value->conditions.friction) || lies_between(value->conditions.friction, -0.01f, 2.55f))
        && ((value->conditions.lateral_acceleration != value->conditions.lateral_acceleration) || lies_between(value->conditions.lateral_acceleration, -32.768f, 32.768f))
        && ((value->stuck_angle != value->stuck_angle) || lies_between(value->stuck_angle, -1.6384f, 1.6384f))
        && (value->counter <= 14u)
        && ((value->backlog <= 80u) && (value->disturbance <= 80u))
        && (value->inhibited_samples <= 60001u)
        && (value->actuator_samples <= (60000u + (value->is_stuck ? 1u : 0u)))
        && lies_within(value->expected_angle, 0.7853982f)
        && lies_within(value->measured_angle, 0.7853982f)
        && lies_within(value->start_angle, 0.061086524f)
        && lies_within(value->angle_offset, (2 * 0.7853982f))
        && (!(value->controller.enabled || value->released) || (value->angle_offset == 0.0f))
        && !(value->controller.enabled && value->released)
        && (value->waited_samples <= 500u)
        && ars_supervision_holds(&value->supervision)
        && is_flag(value->conditions.inhibit)
        && is_flag(value->conditions_close)
        && is_flag(value->has_measured)
        && is_flag(value->deviates)
        && is_flag(value->released)
        && is_flag(value->is_stuck);
    return holds;
}

/* The result of ars_map_valid() for any breakpoint and any cell. Objects without a definition can have any value.
 * The look-ups are proved for a valid map: their callers have one with valid parameters. */
extern const uint32_t any_row;
extern const uint32_t any_column;
static inline bool ars_map_speed_breakpoints_hold(uint32_t k)
{
    return (k >= (uint32_t)ARS_MAP_SPEED_POINTS)
        || (lies_between(ars_map_speed_breakpoints[k], 0.0f, 150.0f)
            && ((k == 0u) ? (ars_map_speed_breakpoints[0] <= 0.0f) : (ars_map_speed_breakpoints[k - 1u] < ars_map_speed_breakpoints[k])));
}

static inline bool ars_map_front_angle_breakpoints_hold(uint32_t k)
{
    return (k >= (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS)
        || (lies_between(ars_map_front_angle_breakpoints[k], 0.0f, 1.2f)
            && ((k == 0u) ? (ars_map_front_angle_breakpoints[0] <= 0.0f) : (ars_map_front_angle_breakpoints[k - 1u] < ars_map_front_angle_breakpoints[k])));
}

static inline bool ars_map_cell_holds(uint32_t row, uint32_t column)
{
    return (row >= (uint32_t)ARS_MAP_SPEED_POINTS) || (column >= (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS)
        || (lies_between(ars_map_yaw_rate_table[row][column], 0.0f, 10.0f) && lies_between(ars_map_rear_angle_table[row][column], -0.5f, 0.5f));
}

#ifndef CONTRACT_LEMMA_SHARE
#define CONTRACT_LEMMA_SHARE(condition, text) __CPROVER_assume(condition)
#endif
static inline void lemma_share(float value, float first, float second)
{
    const bool applies = (0.0f <= first) && (first <= value) && (value <= second) && (first < second) && (second <= 200.0f);
    const float share = applies ? ((value - first) / (second - first)) : 0.0f;

    CONTRACT_LEMMA_SHARE(lies_between(share, 0.0f, 1.0f), "a share is from 0 to 1");
}

#ifndef CONTRACT_LEMMA_INTERPOLATION
#define CONTRACT_LEMMA_INTERPOLATION(condition, text) __CPROVER_assume(condition)
#endif
static inline void lemma_interpolation(float first, float second, float share)
{
    const float value = first + (share * (second - first));
    const float least = (first < second) ? first : second;
    const float most = (first < second) ? second : first;
    const bool applies = lies_between(share, 0.0f, 1.0f);

    CONTRACT_LEMMA_INTERPOLATION(!applies || !(0.0f <= least) || !(most <= 16.0f) || lies_between(value, 0.0f, most + 1.0f),
        "between two numbers that are not negative, it is not negative and close to them");
    CONTRACT_LEMMA_INTERPOLATION(!applies || !(-1.0f <= least) || !(most <= 1.0f) || lies_between(value, least - 0.25f, most + 0.25f),
        "between two small numbers, it is close to them");
}

#ifndef CONTRACT_LEMMA_CAP
#define CONTRACT_LEMMA_CAP(condition, text) __CPROVER_assume(condition)
#endif
static inline void lemma_cap(float value, float speed, float limit)
{
    const bool applies = lies_between(value, 0.0f, 16.0f) && lies_between(limit, 0.0f, 100.0f);

    CONTRACT_LEMMA_CAP(!applies || !((value * speed) > limit) || lies_between(limit / speed, 0.0f, 16.0f), "a capped number is in range");
}

#ifndef CONTRACT_LEMMA_CONSTANTS
#define CONTRACT_LEMMA_CONSTANTS(condition, text) __CPROVER_assume(condition)
#endif
static inline void lemma_constants(void)
{
    CONTRACT_LEMMA_CONSTANTS(ars_constants.lateral_acceleration_cap == 7.8471255f, "lateral_acceleration_cap is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.lateral_acceleration_cap_per_friction == 8.719028f, "lateral_acceleration_cap_per_friction is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.map_friction == 0.9f, "map_friction is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.wheelbase == 3.14f, "wheelbase is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.understeer_coefficient == -1.3035295e-05f, "understeer_coefficient is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.rear_arm == 1.566f, "rear_arm is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.rear_slip_per_lateral_acceleration == 0.0048840423f, "rear_slip_per_lateral_acceleration is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.sideslip_max == 0.05235988f, "sideslip_max is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.rear_angle_max == 0.061086524f, "rear_angle_max is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.grip_max == 7.8471293f, "grip_max is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.friction_per_grip == 0.114691675f, "friction_per_grip is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.model_rear_slip_per_lateral_acceleration == 0.0048840423f, "model_rear_slip_per_lateral_acceleration is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.rear_slip_least == 0.05985464f, "rear_slip_least is that of the build");
    CONTRACT_LEMMA_CONSTANTS(ars_constants.rear_slip_per_friction == 0.06650516f, "rear_slip_per_friction is that of the build");
}

#ifndef CONTRACT_LEMMA_AXES
#define CONTRACT_LEMMA_AXES(condition, text) __CPROVER_assume(condition)
#endif
/* Every breakpoint of a valid map is in range and above the one before. */
static inline void assume_breakpoints(void)
{
    uint32_t k;

    for (k = 0u; k < (uint32_t)ARS_MAP_SPEED_POINTS; k++) {
        CONTRACT_ASSUME(ars_map_speed_breakpoints_hold(k));
    }
    for (k = 0u; k < (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS; k++) {
        CONTRACT_ASSUME(ars_map_front_angle_breakpoints_hold(k));
    }
}

/* The breakpoints that a search reads. */
static inline void lemma_axes(void)
{
    CONTRACT_LEMMA_AXES(ars_map_speed_breakpoints_hold(0u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_speed_breakpoints_hold(1u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_speed_breakpoints[0] < ars_map_speed_breakpoints[1], "the breakpoints of a valid map increase");
    CONTRACT_LEMMA_AXES(ars_map_speed_breakpoints_hold(118u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_speed_breakpoints[1] < ars_map_speed_breakpoints[118], "the breakpoints of a valid map increase");
    CONTRACT_LEMMA_AXES(ars_map_front_angle_breakpoints_hold(0u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_front_angle_breakpoints_hold(100u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_front_angle_breakpoints[0] < ars_map_front_angle_breakpoints[100], "the breakpoints of a valid map increase");
    CONTRACT_LEMMA_AXES(ars_map_front_angle_breakpoints_hold(101u), "a breakpoint of a valid map is in range");
    CONTRACT_LEMMA_AXES(ars_map_front_angle_breakpoints[100] < ars_map_front_angle_breakpoints[101], "the breakpoints of a valid map increase");
}

static inline void ars_limiter_parameters_valid_requires(const ars_limiter_parameters_t *parameters)
{
    (void)parameters;
}

static inline void ars_limiter_parameters_valid_ensures(const ars_limiter_parameters_t *parameters, bool result)
{
    (void)parameters;
    (void)result;
    CONTRACT_ENSURE(!result || ars_limiter_parameters_holds(parameters), "valid parameters are in range");
}

static inline void ars_limiter_init_requires(const ars_limiter_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
}

static inline void ars_limiter_init_ensures(const ars_limiter_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
    CONTRACT_ENSURE(ars_limiter_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(self->rear_angle == (lies_within(rear_angle, 1.0f) ? rear_angle : 0.0f), "it starts from the angle given; from zero beyond 1 rad and for NaN");
}

static inline void ars_limiter_step_requires(const ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input)
{
    (void)self;
    (void)parameters;
    (void)input;
    CONTRACT_REQUIRE(ars_limiter_holds(self), "ars_limiter_step requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_limiter_parameters_holds(parameters), "ars_limiter_step requires: parameters is within its invariant");
}

static inline void ars_limiter_step_ensures(const ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input, float result, const ars_limiter_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)input;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_limiter_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(lies_within(result, parameters->rear_angle_max), "|rear angle| is at most rear_angle_max");
    CONTRACT_ENSURE(result == self->rear_angle, "the result is kept");
    CONTRACT_ENSURE((result <= (self_before->rear_angle + (parameters->rear_rate_max * 0.01f))) || (result == -parameters->rear_angle_max), "it rises by at most rear_rate_max, or to -rear_angle_max");
    CONTRACT_ENSURE(((self_before->rear_angle - (parameters->rear_rate_max * 0.01f)) <= result) || (result == parameters->rear_angle_max), "it falls by at most rear_rate_max, or to rear_angle_max");
    CONTRACT_ENSURE(self->speed == (lies_within(input->speed, parameters->speed_max) ? magnitude_of(input->speed) : self_before->speed), "speed is the one given where it is available, else the last one");
    CONTRACT_ENSURE(self->front_angle == (lies_within(input->front_angle, parameters->front_angle_max) ? input->front_angle : self_before->front_angle), "front_angle is the one given where it is available, else the last one");
    CONTRACT_ENSURE(self->speed_known == (lies_within(input->speed, parameters->speed_max) || self_before->speed_known), "a speed is known once there was one");
    CONTRACT_ENSURE((result <= self_before->rear_angle) || (result <= input->demand) || (result <= 0.0f), "it is not above its last value, the demand and zero");
    CONTRACT_ENSURE((self_before->rear_angle <= result) || (input->demand <= result) || (0.0f <= result), "it is not below its last value, the demand and zero");
    CONTRACT_ENSURE(!self->speed_known || (input->demand != input->demand) || (result <= input->demand) || (result <= 0.0f) || (result <= (self_before->rear_angle - (parameters->rear_rate_max * 0.01f))), "from the left, it follows a demand toward zero as fast as rear_rate_max lets it");
    CONTRACT_ENSURE(!self->speed_known || (input->demand != input->demand) || (input->demand <= result) || (0.0f <= result) || ((self_before->rear_angle + (parameters->rear_rate_max * 0.01f)) <= result), "from the right, it follows a demand toward zero as fast as rear_rate_max lets it");
    CONTRACT_ENSURE(self->speed_known || !lies_within(self_before->rear_angle, parameters->rear_angle_max) || (result == self_before->rear_angle), "it is held as long as no speed is known");
}

static inline void ars_inputs_parameters_valid_requires(const ars_inputs_parameters_t *parameters)
{
    (void)parameters;
}

static inline void ars_inputs_parameters_valid_ensures(const ars_inputs_parameters_t *parameters, bool result)
{
    (void)parameters;
    (void)result;
    CONTRACT_ENSURE(!result || ars_inputs_parameters_holds(parameters), "valid parameters are in range");
}

static inline void ars_inputs_init_requires(const ars_inputs_t *self, bool is_trusted)
{
    (void)self;
    (void)is_trusted;
}

static inline void ars_inputs_init_ensures(const ars_inputs_t *self, bool is_trusted)
{
    (void)self;
    (void)is_trusted;
    CONTRACT_ENSURE(ars_inputs_holds(self), "self is within its invariant");
}

static inline void ars_inputs_step_requires(const ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle, const ars_reference_model_t *model, const ars_measurement_t *checked)
{
    (void)self;
    (void)parameters;
    (void)measured;
    (void)rear_angle;
    (void)model;
    (void)checked;
    CONTRACT_REQUIRE(ars_inputs_holds(self), "ars_inputs_step requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_inputs_parameters_holds(parameters), "ars_inputs_step requires: parameters is within its invariant");
    CONTRACT_REQUIRE(ars_reference_model_holds(model), "ars_inputs_step requires: model is within its invariant");
    CONTRACT_REQUIRE(is_flag(measured->inhibit), "ars_inputs_step requires: inhibit is true or false");
    CONTRACT_REQUIRE(lies_within(rear_angle, 1.0f), "ars_inputs_step requires: rear_angle is within its range");
}

static inline void ars_inputs_step_ensures(const ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle, const ars_reference_model_t *model, const ars_measurement_t *checked, ars_quality_t result, const ars_inputs_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)measured;
    (void)rear_angle;
    (void)model;
    (void)checked;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_inputs_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(lies_within(checked->speed, 200.0f), "speed is within its range");
    CONTRACT_ENSURE(lies_within(checked->front_angle, 1.5f), "front_angle is within its range");
    CONTRACT_ENSURE(lies_within(checked->yaw_rate, 20.0f), "yaw_rate is within its range");
    CONTRACT_ENSURE(lies_within(checked->rear_angle, 1.0f), "rear_angle is within its range");
    CONTRACT_ENSURE(lies_within(checked->lateral_acceleration, 8192.0f), "lateral_acceleration is within its range");
    CONTRACT_ENSURE(lies_between(checked->friction, 0.0f, 2.0f), "friction is within its range");
    CONTRACT_ENSURE(is_flag(checked->inhibit), "inhibit is true or false");
    CONTRACT_ENSURE(((uint32_t)result <= 3u), "the quality is one of its enumerators");
    CONTRACT_ENSURE((result == ARS_QUALITY_UNUSABLE) == (!(self->front_angle.source == ARS_SIGNAL_MEASURED) && !(self->yaw_rate.source == ARS_SIGNAL_MEASURED)), "the sample is unusable if neither front angle nor yaw rate is used");
    CONTRACT_ENSURE((result != ARS_QUALITY_GOOD) || ((self->speed.source == ARS_SIGNAL_MEASURED) && (self->front_angle.source == ARS_SIGNAL_MEASURED) && (self->yaw_rate.source == ARS_SIGNAL_MEASURED)), "a good sample has all signals");
    CONTRACT_ENSURE((result != ARS_QUALITY_REPLACED) || !(self->speed.source == ARS_SIGNAL_MEASURED) || !(self->front_angle.source == ARS_SIGNAL_MEASURED) || !(self->yaw_rate.source == ARS_SIGNAL_MEASURED), "a signal of a replaced sample is not used");
    CONTRACT_ENSURE((result != ARS_QUALITY_MISSING) || (self->speed.missing > 0u) || (self->front_angle.missing > 0u) || (self->yaw_rate.missing > 0u), "a signal of a missing sample is missing");
    CONTRACT_ENSURE((self_before->speed.source == ARS_SIGNAL_MEASURED) || !(self->speed.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->speed, parameters->speed_max) && ((self_before->speed.good + 1u) >= parameters->recovery_samples)), "speed is used again only after recovery_samples good ones, less missing ones");
    CONTRACT_ENSURE((self_before->speed.source == ARS_SIGNAL_MEASURED) || (self->speed.source == ARS_SIGNAL_MEASURED) || (self->speed.good == 0u) || (lies_within(measured->speed, parameters->speed_max) && (self->speed.good == (self_before->speed.good + 1u))) || ((self_before->speed.source == ARS_SIGNAL_LOST) && ((self->speed.good + 1u) == self_before->speed.good)), "without speed, its count of good samples starts anew, or falls by one if it was lost");
    CONTRACT_ENSURE(!(self_before->speed.source == ARS_SIGNAL_MEASURED) || (self->speed.source == ARS_SIGNAL_MEASURED) || (self->speed.good == 0u), "speed that is no longer used has no good sample");
    CONTRACT_ENSURE(!(self_before->speed.source == ARS_SIGNAL_MEASURED) || lies_within(measured->speed, parameters->speed_max) || ((self->speed.missing == (self_before->speed.missing + 1u)) && (!(self->speed.source == ARS_SIGNAL_MEASURED) || (self->speed.missing <= parameters->missing_samples_max))), "speed is not used after missing_samples_max missing ones");
    CONTRACT_ENSURE((self_before->front_angle.source == ARS_SIGNAL_MEASURED) || !(self->front_angle.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->front_angle, parameters->front_angle_max) && ((self_before->front_angle.good + 1u) >= parameters->recovery_samples)), "front_angle is used again only after recovery_samples good ones, less missing ones");
    CONTRACT_ENSURE((self_before->front_angle.source == ARS_SIGNAL_MEASURED) || (self->front_angle.source == ARS_SIGNAL_MEASURED) || (self->front_angle.good == 0u) || (lies_within(measured->front_angle, parameters->front_angle_max) && (self->front_angle.good == (self_before->front_angle.good + 1u))) || ((self_before->front_angle.source == ARS_SIGNAL_LOST) && ((self->front_angle.good + 1u) == self_before->front_angle.good)), "without front_angle, its count of good samples starts anew, or falls by one if it was lost");
    CONTRACT_ENSURE(!(self_before->front_angle.source == ARS_SIGNAL_MEASURED) || (self->front_angle.source == ARS_SIGNAL_MEASURED) || (self->front_angle.good == 0u), "front_angle that is no longer used has no good sample");
    CONTRACT_ENSURE(!(self_before->front_angle.source == ARS_SIGNAL_MEASURED) || lies_within(measured->front_angle, parameters->front_angle_max) || ((self->front_angle.missing == (self_before->front_angle.missing + 1u)) && (!(self->front_angle.source == ARS_SIGNAL_MEASURED) || (self->front_angle.missing <= parameters->missing_samples_max))), "front_angle is not used after missing_samples_max missing ones");
    CONTRACT_ENSURE((self_before->yaw_rate.source == ARS_SIGNAL_MEASURED) || !(self->yaw_rate.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->yaw_rate, parameters->yaw_rate_max) && ((self_before->yaw_rate.good + 1u) >= parameters->recovery_samples)), "yaw_rate is used again only after recovery_samples good ones, less missing ones");
    CONTRACT_ENSURE((self_before->yaw_rate.source == ARS_SIGNAL_MEASURED) || (self->yaw_rate.source == ARS_SIGNAL_MEASURED) || (self->yaw_rate.good == 0u) || (lies_within(measured->yaw_rate, parameters->yaw_rate_max) && (self->yaw_rate.good == (self_before->yaw_rate.good + 1u))) || ((self_before->yaw_rate.source == ARS_SIGNAL_LOST) && ((self->yaw_rate.good + 1u) == self_before->yaw_rate.good)), "without yaw_rate, its count of good samples starts anew, or falls by one if it was lost");
    CONTRACT_ENSURE(!(self_before->yaw_rate.source == ARS_SIGNAL_MEASURED) || (self->yaw_rate.source == ARS_SIGNAL_MEASURED) || (self->yaw_rate.good == 0u), "yaw_rate that is no longer used has no good sample");
    CONTRACT_ENSURE(!(self_before->yaw_rate.source == ARS_SIGNAL_MEASURED) || lies_within(measured->yaw_rate, parameters->yaw_rate_max) || ((self->yaw_rate.missing == (self_before->yaw_rate.missing + 1u)) && (!(self->yaw_rate.source == ARS_SIGNAL_MEASURED) || (self->yaw_rate.missing <= parameters->missing_samples_max))), "yaw_rate is not used after missing_samples_max missing ones");
}

static inline void ars_map_valid_requires(void)
{
}

static inline void ars_map_valid_ensures(bool result)
{
    (void)result;
    CONTRACT_ENSURE(!result || (ars_map_speed_breakpoints_hold(any_row) && ars_map_front_angle_breakpoints_hold(any_column)), "the axes of a valid map are in range and increasing");
    CONTRACT_ENSURE(!result || ars_map_cell_holds(any_row, any_column), "the numbers of a valid map are in range");
}

static inline void ars_map_yaw_rate_on_road_requires(float speed, float front_angle, float friction)
{
    (void)speed;
    (void)front_angle;
    (void)friction;
}

static inline void ars_map_yaw_rate_on_road_ensures(float speed, float front_angle, float friction, float result)
{
    (void)speed;
    (void)front_angle;
    (void)friction;
    (void)result;
    CONTRACT_ENSURE(lies_within(result, 16.0f), "the yaw rate is in range");
}

static inline void ars_map_reference_requires(float speed, float front_angle, float friction)
{
    (void)speed;
    (void)front_angle;
    (void)friction;
}

static inline void ars_map_reference_ensures(float speed, float front_angle, float friction, const ars_map_reference_t *result)
{
    (void)speed;
    (void)front_angle;
    (void)friction;
    (void)result;
    CONTRACT_ENSURE(lies_within(result->yaw_rate, 16.0f), "the yaw rate is in range");
    CONTRACT_ENSURE(lies_within(result->rear_angle, 1.0f), "the rear angle is in range");
    CONTRACT_ENSURE(lies_between(result->lateral_acceleration_max, 0.0f, 100.0f), "the acceleration is in range");
}

static inline void ars_reference_model_start_requires(const ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle)
{
    (void)self;
    (void)speed;
    (void)yaw_rate;
    (void)rear_angle;
}

static inline void ars_reference_model_start_ensures(const ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle)
{
    (void)self;
    (void)speed;
    (void)yaw_rate;
    (void)rear_angle;
    CONTRACT_ENSURE(ars_reference_model_holds(self), "self is within its invariant");
}

static inline void ars_reference_model_step_requires(const ars_reference_model_t *self, const ars_reference_model_input_t *input)
{
    (void)self;
    (void)input;
    CONTRACT_REQUIRE(ars_reference_model_holds(self), "ars_reference_model_step requires: self is within its invariant");
}

static inline void ars_reference_model_step_ensures(const ars_reference_model_t *self, const ars_reference_model_input_t *input, const ars_reference_model_t *self_before)
{
    (void)self;
    (void)input;
    (void)self_before;
    CONTRACT_ENSURE(ars_reference_model_holds(self), "self is within its invariant");
}

static inline void ars_grip_init_requires(const ars_grip_t *self)
{
    (void)self;
}

static inline void ars_grip_init_ensures(const ars_grip_t *self)
{
    (void)self;
    CONTRACT_ENSURE(ars_grip_holds(self), "self is within its invariant");
}

static inline void ars_grip_friction_requires(const ars_grip_t *self, const ars_parameters_t *parameters, float estimate)
{
    (void)self;
    (void)parameters;
    (void)estimate;
    CONTRACT_REQUIRE(ars_grip_holds(self), "ars_grip_friction requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_grip_friction requires: parameters is within its invariant");
}

static inline void ars_grip_friction_ensures(const ars_grip_t *self, const ars_parameters_t *parameters, float estimate, float result)
{
    (void)self;
    (void)parameters;
    (void)estimate;
    (void)result;
    CONTRACT_ENSURE((result > 0.0f) && (result <= 2.0f), "the friction is positive and in range");
}

static inline void ars_grip_update_requires(const ars_grip_t *self, const ars_parameters_t *parameters, float model_acceleration, float acceleration)
{
    (void)self;
    (void)parameters;
    (void)model_acceleration;
    (void)acceleration;
    CONTRACT_REQUIRE(ars_grip_holds(self), "ars_grip_update requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_grip_update requires: parameters is within its invariant");
    CONTRACT_REQUIRE(lies_within(model_acceleration, 8192.0f), "ars_grip_update requires: model_acceleration is in range");
    CONTRACT_REQUIRE(lies_within(acceleration, 8192.0f), "ars_grip_update requires: acceleration is in range");
}

static inline void ars_grip_update_ensures(const ars_grip_t *self, const ars_parameters_t *parameters, float model_acceleration, float acceleration, const ars_grip_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)model_acceleration;
    (void)acceleration;
    (void)self_before;
    CONTRACT_ENSURE(ars_grip_holds(self), "self is within its invariant");
}

static inline void ars_grip_recover_requires(const ars_grip_t *self, const ars_parameters_t *parameters)
{
    (void)self;
    (void)parameters;
    CONTRACT_REQUIRE(ars_grip_holds(self), "ars_grip_recover requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_grip_recover requires: parameters is within its invariant");
}

static inline void ars_grip_recover_ensures(const ars_grip_t *self, const ars_parameters_t *parameters, const ars_grip_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)self_before;
    CONTRACT_ENSURE(ars_grip_holds(self), "self is within its invariant");
}

static inline void ars_law_init_requires(const ars_law_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
    CONTRACT_REQUIRE(lies_within(rear_angle, 1.0f), "ars_law_init requires: rear_angle is in range");
}

static inline void ars_law_init_ensures(const ars_law_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
    CONTRACT_ENSURE(ars_law_holds(self), "self is within its invariant");
}

static inline void ars_law_step_requires(const ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase, float friction, float rear_angle, float yaw_rate_error)
{
    (void)self;
    (void)parameters;
    (void)sample;
    (void)phase;
    (void)friction;
    (void)rear_angle;
    (void)yaw_rate_error;
    CONTRACT_REQUIRE(ars_law_holds(self), "ars_law_step requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_law_step requires: parameters is within its invariant");
    CONTRACT_REQUIRE(lies_between(sample->speed, -200.0f, 200.0f), "ars_law_step requires: speed is in range");
    CONTRACT_REQUIRE(lies_between(sample->front_angle, -1.5f, 1.5f), "ars_law_step requires: front_angle is in range");
    CONTRACT_REQUIRE(lies_between(sample->yaw_rate, -20.0f, 20.0f), "ars_law_step requires: yaw_rate is in range");
    CONTRACT_REQUIRE(lies_within(sample->lateral_acceleration, 8192.0f), "ars_law_step requires: lateral_acceleration is in range");
    CONTRACT_REQUIRE(is_flag(sample->inhibit), "ars_law_step requires: inhibit is true or false");
    CONTRACT_REQUIRE(((uint32_t)phase <= 2u), "ars_law_step requires: phase is one of its enumerators");
    CONTRACT_REQUIRE(lies_within(rear_angle, 1.0f), "ars_law_step requires: rear_angle is in range");
    CONTRACT_REQUIRE(lies_within(yaw_rate_error, 1000.0f), "ars_law_step requires: yaw_rate_error is in range");
}

static inline void ars_law_step_ensures(const ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase, float friction, float rear_angle, float yaw_rate_error, const ars_law_output_t *result, const ars_law_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)sample;
    (void)phase;
    (void)friction;
    (void)rear_angle;
    (void)yaw_rate_error;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_law_holds(self), "self is within its invariant");
    CONTRACT_ENSURE((((rear_angle - (((parameters->rear_rate_max < parameters->limiter.rear_rate_max) ? parameters->rear_rate_max : parameters->limiter.rear_rate_max) * 0.01f)) <= result->rear_angle) && (result->rear_angle <= (rear_angle + (((parameters->rear_rate_max < parameters->limiter.rear_rate_max) ? parameters->rear_rate_max : parameters->limiter.rear_rate_max) * 0.01f)))), "the command moves by at most the lower of both rates");
    CONTRACT_ENSURE(lies_within(result->yaw_rate_reference, 20.0f), "yaw_rate_reference is in range");
}

static inline void ars_law_rest_requires(const ars_law_t *self, const ars_measurement_t *sample, float friction, float rear_angle)
{
    (void)self;
    (void)sample;
    (void)friction;
    (void)rear_angle;
    CONTRACT_REQUIRE(ars_law_holds(self), "ars_law_rest requires: self is within its invariant");
}

static inline void ars_law_rest_ensures(const ars_law_t *self, const ars_measurement_t *sample, float friction, float rear_angle, const ars_law_t *self_before)
{
    (void)self;
    (void)sample;
    (void)friction;
    (void)rear_angle;
    (void)self_before;
    CONTRACT_ENSURE(ars_law_holds(self), "self is within its invariant");
}

static inline void ars_parameters_valid_requires(const ars_parameters_t *parameters)
{
    (void)parameters;
}

static inline void ars_parameters_valid_ensures(const ars_parameters_t *parameters, bool result)
{
    (void)parameters;
    (void)result;
    CONTRACT_ENSURE(!result || ars_parameters_holds(parameters), "valid parameters are in range");
    CONTRACT_ENSURE(!result || (ars_map_speed_breakpoints_hold(any_row) && ars_map_front_angle_breakpoints_hold(any_column)), "the axes of a valid map are in range and increasing");
    CONTRACT_ENSURE(!result || ars_map_cell_holds(any_row, any_column), "the numbers of a valid map are in range");
}

static inline void ars_controller_init_requires(const ars_controller_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
}

static inline void ars_controller_init_ensures(const ars_controller_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
    CONTRACT_ENSURE(ars_controller_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(lies_within(self->rear_angle, 0.061086524f), "|rear_angle| is at most the actuator's largest angle");
    CONTRACT_ENSURE(self->rear_angle == held_within(rear_angle, 0.061086524f), "it starts from the given angle");
}

static inline void ars_controller_place_requires(const ars_controller_t *self, float rear_angle)
{
    (void)self;
    (void)rear_angle;
    CONTRACT_REQUIRE(ars_controller_holds(self), "ars_controller_place requires: self is within its invariant");
}

static inline void ars_controller_place_ensures(const ars_controller_t *self, float rear_angle, const ars_controller_t *self_before)
{
    (void)self;
    (void)rear_angle;
    (void)self_before;
    CONTRACT_ENSURE(ars_controller_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(lies_within(self->rear_angle, 0.061086524f), "|rear_angle| is at most the actuator's largest angle");
    CONTRACT_ENSURE(self->rear_angle == held_within(rear_angle, 0.061086524f), "it starts from the given angle");
    CONTRACT_ENSURE(self->enabled == self_before->enabled, "it neither starts nor ends control");
}

static inline void ars_controller_stand_by_requires(const ars_controller_t *self, const ars_parameters_t *parameters)
{
    (void)self;
    (void)parameters;
    CONTRACT_REQUIRE(ars_controller_holds(self), "ars_controller_stand_by requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_controller_stand_by requires: parameters is within its invariant");
}

static inline void ars_controller_stand_by_ensures(const ars_controller_t *self, const ars_parameters_t *parameters, const ars_command_t *result, const ars_controller_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_controller_holds(self), "self is within its invariant");
    CONTRACT_ENSURE((result->rear_angle <= (self_before->rear_angle + (parameters->limiter.rear_rate_max * 0.01f))) || (result->rear_angle == -parameters->limiter.rear_angle_max), "it rises by at most rear_rate_max, or to -rear_angle_max");
    CONTRACT_ENSURE(((self_before->rear_angle - (parameters->limiter.rear_rate_max * 0.01f)) <= result->rear_angle) || (result->rear_angle == parameters->limiter.rear_angle_max), "it falls by at most rear_rate_max, or to rear_angle_max");
    CONTRACT_ENSURE((magnitude_of(result->rear_angle) <= magnitude_of(self_before->rear_angle)), "|rear_angle| does not grow");
    CONTRACT_ENSURE(result->status == ARS_STATUS_STANDBY, "the status is standby");
    CONTRACT_ENSURE((result->rear_angle == self->rear_angle) && (result->status == self->status), "the command and the status are kept");
}

static inline void ars_controller_step_requires(const ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    (void)self;
    (void)parameters;
    (void)measurement;
    CONTRACT_REQUIRE(ars_controller_holds(self), "ars_controller_step requires: self is within its invariant");
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_controller_step requires: parameters is within its invariant");
    CONTRACT_REQUIRE(is_flag(measurement->inhibit), "ars_controller_step requires: inhibit is true or false");
}

static inline void ars_controller_step_ensures(const ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, const ars_command_t *result, const ars_controller_t *self_before)
{
    (void)self;
    (void)parameters;
    (void)measurement;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_controller_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(lies_within(result->rear_angle, parameters->rear_angle_max), "|rear_angle| is at most rear_angle_max");
    CONTRACT_ENSURE(lies_within(result->yaw_rate_reference, 20.0f), "yaw_rate_reference is in range");
    CONTRACT_ENSURE(((uint32_t)result->status <= 4u), "status is one of its enumerators");
    CONTRACT_ENSURE((result->rear_angle <= (self_before->rear_angle + (parameters->limiter.rear_rate_max * 0.01f))) || (result->rear_angle == -parameters->limiter.rear_angle_max), "it rises by at most rear_rate_max, or to -rear_angle_max");
    CONTRACT_ENSURE(((self_before->rear_angle - (parameters->limiter.rear_rate_max * 0.01f)) <= result->rear_angle) || (result->rear_angle == parameters->limiter.rear_angle_max), "it falls by at most rear_rate_max, or to rear_angle_max");
    CONTRACT_ENSURE((result->status != ARS_STATUS_TRACKING) || (((self_before->rear_angle - (((parameters->rear_rate_max < parameters->limiter.rear_rate_max) ? parameters->rear_rate_max : parameters->limiter.rear_rate_max) * 0.01f)) <= result->rear_angle) && (result->rear_angle <= (self_before->rear_angle + (((parameters->rear_rate_max < parameters->limiter.rear_rate_max) ? parameters->rear_rate_max : parameters->limiter.rear_rate_max) * 0.01f)))), "tracking, it moves by at most the lower of both rates");
    CONTRACT_ENSURE(self->enabled || (magnitude_of(result->rear_angle) <= magnitude_of(self_before->rear_angle)), "without control |rear_angle| does not grow");
    CONTRACT_ENSURE((result->rear_angle == self->rear_angle) && (result->status == self->status), "the command and the status are kept");
}

static inline void ars_e2e_receiver_init_requires(const ars_e2e_receiver_t *self)
{
    (void)self;
}

static inline void ars_e2e_receiver_init_ensures(const ars_e2e_receiver_t *self)
{
    (void)self;
    CONTRACT_ENSURE(ars_e2e_receiver_holds(self), "self is within its invariant");
}

static inline void ars_e2e_check_requires(const ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8])
{
    (void)self;
    (void)data_id;
    (void)data;
    CONTRACT_REQUIRE(ars_e2e_receiver_holds(self), "ars_e2e_check requires: self is within its invariant");
}

static inline void ars_e2e_check_ensures(const ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8], ars_e2e_status_t result, const ars_e2e_receiver_t *self_before)
{
    (void)self;
    (void)data_id;
    (void)data;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_e2e_receiver_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(((uint32_t)result <= 7u), "the result is one of its enumerators");
    CONTRACT_ENSURE((result == ARS_E2E_WRONG_CRC) == ((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)), "a wrong CRC is found");
    CONTRACT_ENSURE((result == ARS_E2E_INITIAL) == (!((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)) && self_before->waits_for_first), "only the first intact frame may have any counter");
    CONTRACT_ENSURE(self->waits_for_first == ((result == ARS_E2E_WRONG_CRC) && self_before->waits_for_first), "the first intact frame ends the wait for it");
    CONTRACT_ENSURE((result == ARS_E2E_REPEATED) == ((!((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)) && !self_before->waits_for_first) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) == 0u)), "a repeated counter is found");
    CONTRACT_ENSURE((result == ARS_E2E_WRONG_SEQUENCE) == ((!((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)) && !self_before->waits_for_first) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) > 0u) && !((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) <= ((self_before->max_delta_counter < 14u) ? (self_before->max_delta_counter + 1u) : 14u))), "a counter beyond the window is found");
    CONTRACT_ENSURE((result == ARS_E2E_OK) == (((!((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)) && !self_before->waits_for_first) && !(self_before->no_new_or_repeated_data_counter > 3u) && (self_before->sync_counter == 0u)) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) == 1u) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) <= ((self_before->max_delta_counter < 14u) ? (self_before->max_delta_counter + 1u) : 14u))), "a frame is accepted if its counter advances by one");
    CONTRACT_ENSURE((result == ARS_E2E_OK_SOME_LOST) == (((!((ars_e2e_crc(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u)) && !self_before->waits_for_first) && !(self_before->no_new_or_repeated_data_counter > 3u) && (self_before->sync_counter == 0u)) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) > 1u) && ((((data[1] & 0x0Fu) + 15u - self_before->last_counter) % 15u) <= ((self_before->max_delta_counter < 14u) ? (self_before->max_delta_counter + 1u) : 14u))), "after lost frames, one is accepted within the window only");
    CONTRACT_ENSURE(self->max_delta_counter == (((result == ARS_E2E_WRONG_CRC) || (result == ARS_E2E_REPEATED)) ? ((self_before->max_delta_counter < 14u) ? (self_before->max_delta_counter + 1u) : 14u) : 1u), "the window grows until a new frame");
    CONTRACT_ENSURE(self->last_counter == (((result == ARS_E2E_WRONG_CRC) || (result == ARS_E2E_REPEATED)) ? self_before->last_counter : (data[1] & 0x0Fu)), "the last counter is that of the last new frame");
    CONTRACT_ENSURE(!(result == ARS_E2E_WRONG_SEQUENCE) || (self->sync_counter == 1u), "after a jump, frames must be in sequence");
}

static inline void ars_e2e_no_new_data_requires(const ars_e2e_receiver_t *self)
{
    (void)self;
    CONTRACT_REQUIRE(ars_e2e_receiver_holds(self), "ars_e2e_no_new_data requires: self is within its invariant");
}

static inline void ars_e2e_no_new_data_ensures(const ars_e2e_receiver_t *self, ars_e2e_status_t result, const ars_e2e_receiver_t *self_before)
{
    (void)self;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_e2e_receiver_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(result == ARS_E2E_NO_NEW_DATA, "it returns NO_NEW_DATA");
    CONTRACT_ENSURE(self->max_delta_counter == ((self_before->max_delta_counter < 14u) ? (self_before->max_delta_counter + 1u) : 14u), "the accepted advance of the counter grows by one");
}

static inline void ars_e2e_protect_requires(uint16_t data_id, const uint8_t *counter, const uint8_t data[8])
{
    (void)data_id;
    (void)counter;
    (void)data;
}

static inline void ars_e2e_protect_ensures(uint16_t data_id, const uint8_t *counter, const uint8_t data[8], const uint8_t *counter_before)
{
    (void)data_id;
    (void)counter;
    (void)data;
    (void)counter_before;
    CONTRACT_ENSURE(*counter <= 14u, "the counter for the next frame is at most 14");
    CONTRACT_ENSURE((data[1] & 0x0Fu) == (*counter_before & 0x0Fu), "the frame carries the counter");
    CONTRACT_ENSURE(ars_e2e_crc(data_id, data) == data[0], "the frame has the right CRC");
}

static inline void ars_e2e_supervision_init_requires(const ars_e2e_supervision_t *self)
{
    (void)self;
}

static inline void ars_e2e_supervision_init_ensures(const ars_e2e_supervision_t *self)
{
    (void)self;
    CONTRACT_ENSURE(ars_e2e_supervision_holds(self), "self is within its invariant");
}

static inline void ars_e2e_supervise_requires(const ars_e2e_supervision_t *self, bool is_good, bool is_damaged)
{
    (void)self;
    (void)is_good;
    (void)is_damaged;
    CONTRACT_REQUIRE(ars_e2e_supervision_holds(self), "ars_e2e_supervise requires: self is within its invariant");
}

static inline void ars_e2e_supervise_ensures(const ars_e2e_supervision_t *self, bool is_good, bool is_damaged, ars_e2e_state_t result, const ars_e2e_supervision_t *self_before)
{
    (void)self;
    (void)is_good;
    (void)is_damaged;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_e2e_supervision_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(result == self->state, "the result is kept");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_NO_DATA) || (self->state == (is_good ? ARS_E2E_STATE_INIT : ARS_E2E_STATE_NO_DATA)), "the first good frame ends NO_DATA");
    CONTRACT_ENSURE((self_before->state == ARS_E2E_STATE_NO_DATA) || !(self->state == ARS_E2E_STATE_NO_DATA), "NO_DATA does not return");
    CONTRACT_ENSURE((self_before->state == ARS_E2E_STATE_NO_DATA) || (((self->window >> 0u) & 0x3Fu) == ((((self_before->window >> 0u) << 1u) | (is_good ? 1u : 0u)) & 0x3Fu)), "the window has the last good cycles");
    CONTRACT_ENSURE((self_before->state == ARS_E2E_STATE_NO_DATA) || (((self->window >> 16u) & 0x3Fu) == ((((self_before->window >> 16u) << 1u) | (is_damaged ? 1u : 0u)) & 0x3Fu)), "the window has the last damaged cycles");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_INIT) || ((self->state == ARS_E2E_STATE_VALID) == (((((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u) + ((self->window >> 2u) & 1u) + ((self->window >> 3u) & 1u) + ((self->window >> 4u) & 1u) + ((self->window >> 5u) & 1u)) >= 2u) && ((((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u) + ((self->window >> 18u) & 1u) + ((self->window >> 19u) & 1u) + ((self->window >> 20u) & 1u) + ((self->window >> 21u) & 1u)) <= 2u))), "from INIT, the thresholds decide on VALID");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_INIT) || ((self->state == ARS_E2E_STATE_INIT) == (((((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u) + ((self->window >> 18u) & 1u) + ((self->window >> 19u) & 1u) + ((self->window >> 20u) & 1u) + ((self->window >> 21u) & 1u)) <= 2u) && !((((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u) + ((self->window >> 2u) & 1u) + ((self->window >> 3u) & 1u) + ((self->window >> 4u) & 1u) + ((self->window >> 5u) & 1u)) >= 2u))), "INIT stays until there are enough good or too many damaged cycles");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_VALID) || ((self->state == ARS_E2E_STATE_VALID) == (((((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u) + ((self->window >> 2u) & 1u) + ((self->window >> 3u) & 1u) + ((self->window >> 4u) & 1u) + ((self->window >> 5u) & 1u)) >= 2u) && ((((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u) + ((self->window >> 18u) & 1u) + ((self->window >> 19u) & 1u) + ((self->window >> 20u) & 1u) + ((self->window >> 21u) & 1u)) <= 3u))), "from VALID, the thresholds decide on VALID");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_VALID) || !(self->state == ARS_E2E_STATE_INIT), "from VALID, INIT does not return");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_INVALID) || ((self->state == ARS_E2E_STATE_VALID) == (((((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u) + ((self->window >> 2u) & 1u) + ((self->window >> 3u) & 1u) + ((self->window >> 4u) & 1u) + ((self->window >> 5u) & 1u)) >= 3u) && ((((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u) + ((self->window >> 18u) & 1u) + ((self->window >> 19u) & 1u) + ((self->window >> 20u) & 1u) + ((self->window >> 21u) & 1u)) <= 2u))), "from INVALID, the thresholds decide on VALID");
    CONTRACT_ENSURE(!(self_before->state == ARS_E2E_STATE_INVALID) || !(self->state == ARS_E2E_STATE_INIT), "from INVALID, INIT does not return");
}

static inline void ars_can_not_available_requires(void)
{
}

static inline void ars_can_not_available_ensures(float result)
{
    (void)result;
    CONTRACT_ENSURE(result != result, "it is NaN");
}

static inline void ars_can_unpack_vehicle_motion_requires(const uint8_t data[8], const ars_vehicle_motion_t *signals)
{
    (void)data;
    (void)signals;
}

static inline void ars_can_unpack_vehicle_motion_ensures(const uint8_t data[8], const ars_vehicle_motion_t *signals)
{
    (void)data;
    (void)signals;
    CONTRACT_ENSURE(((signals->speed != signals->speed) || lies_between(signals->speed, -163.84f, 163.84f)), "speed is in the range of its frame, or NaN");
    CONTRACT_ENSURE(((signals->front_angle != signals->front_angle) || lies_between(signals->front_angle, -1.6384f, 1.6384f)), "front_angle is in the range of its frame, or NaN");
    CONTRACT_ENSURE(((signals->yaw_rate != signals->yaw_rate) || lies_between(signals->yaw_rate, -6.5536f, 6.5536f)), "yaw_rate is in the range of its frame, or NaN");
}

static inline void ars_can_pack_vehicle_motion_requires(const ars_vehicle_motion_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_can_pack_vehicle_motion_ensures(const ars_vehicle_motion_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_can_unpack_vehicle_conditions_requires(const uint8_t data[8], const ars_vehicle_conditions_t *signals)
{
    (void)data;
    (void)signals;
}

static inline void ars_can_unpack_vehicle_conditions_ensures(const uint8_t data[8], const ars_vehicle_conditions_t *signals)
{
    (void)data;
    (void)signals;
    CONTRACT_ENSURE(((signals->rear_angle != signals->rear_angle) || lies_between(signals->rear_angle, -1.6384f, 1.6384f)), "rear_angle is in the range of its frame, or NaN");
    CONTRACT_ENSURE(((signals->friction != signals->friction) || lies_between(signals->friction, -0.01f, 2.55f)), "friction is in the range of its frame, or NaN");
    CONTRACT_ENSURE(((signals->lateral_acceleration != signals->lateral_acceleration) || lies_between(signals->lateral_acceleration, -32.768f, 32.768f)), "lateral_acceleration is in the range of its frame, or NaN");
}

static inline void ars_can_pack_vehicle_conditions_requires(const ars_vehicle_conditions_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_can_pack_vehicle_conditions_ensures(const ars_vehicle_conditions_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_can_unpack_rear_steer_command_requires(const uint8_t data[8], const ars_rear_steer_command_t *signals)
{
    (void)data;
    (void)signals;
}

static inline void ars_can_unpack_rear_steer_command_ensures(const uint8_t data[8], const ars_rear_steer_command_t *signals)
{
    (void)data;
    (void)signals;
    CONTRACT_ENSURE(((signals->rear_angle != signals->rear_angle) || lies_between(signals->rear_angle, -1.6384f, 1.6384f)), "rear_angle is in the range of its frame, or NaN");
    CONTRACT_ENSURE(((signals->yaw_rate_reference != signals->yaw_rate_reference) || lies_between(signals->yaw_rate_reference, -6.5536f, 6.5536f)), "yaw_rate_reference is in the range of its frame, or NaN");
}

static inline void ars_can_pack_rear_steer_command_requires(const ars_rear_steer_command_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_can_pack_rear_steer_command_ensures(const ars_rear_steer_command_t *signals, const uint8_t data[8])
{
    (void)signals;
    (void)data;
}

static inline void ars_supervision_init_requires(const ars_supervision_t *self)
{
    (void)self;
}

static inline void ars_supervision_init_ensures(const ars_supervision_t *self)
{
    (void)self;
    CONTRACT_ENSURE(ars_supervision_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(self->state == ARS_SUPERVISION_START, "it starts without a rear angle");
}

static inline void ars_supervision_step_requires(const ars_supervision_t *self, ars_supervision_cause_t cause, ars_status_t status)
{
    (void)self;
    (void)cause;
    (void)status;
    CONTRACT_REQUIRE(ars_supervision_holds(self), "ars_supervision_step requires: self is within its invariant");
    CONTRACT_REQUIRE(((uint32_t)cause <= 10u), "ars_supervision_step requires: cause is one of its enumerators");
    CONTRACT_REQUIRE(((uint32_t)status <= 4u), "ars_supervision_step requires: status is one of its enumerators");
}

static inline void ars_supervision_step_ensures(const ars_supervision_t *self, ars_supervision_cause_t cause, ars_status_t status, ars_status_t result, const ars_supervision_t *self_before)
{
    (void)self;
    (void)cause;
    (void)status;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_supervision_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_START), "from START, ANGLE_UNKNOWN leads to START");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from START, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from START, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from START, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from START, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from START, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from START, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from START, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from START, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from START, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from START, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from RUN, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from RUN, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from RUN, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from RUN, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RUN, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RUN, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RUN, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RUN, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RUN, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from RUN, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RUN) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from RUN, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from PREDICTED, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from PREDICTED, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from PREDICTED, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from PREDICTED, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from PREDICTED, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from PREDICTED, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from PREDICTED, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from PREDICTED, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from PREDICTED, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from PREDICTED, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_PREDICTED) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from PREDICTED, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from DEGRADED, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from DEGRADED, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from DEGRADED, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from DEGRADED, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from DEGRADED, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from DEGRADED, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from DEGRADED, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from DEGRADED, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from DEGRADED, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from DEGRADED, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_DEGRADED) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from DEGRADED, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from LOST, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from LOST, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from LOST, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from LOST, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from LOST, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from LOST, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from LOST, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from LOST, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from LOST, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from LOST, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_LOST) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from LOST, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from RESYNCHRONISE, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from RESYNCHRONISE, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from RESYNCHRONISE, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from RESYNCHRONISE, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RESYNCHRONISE, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RESYNCHRONISE, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RESYNCHRONISE, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RESYNCHRONISE, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from RESYNCHRONISE, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from RESYNCHRONISE, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_RESYNCHRONISE) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from RESYNCHRONISE, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from STANDBY, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from STANDBY, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from STANDBY, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from STANDBY, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from STANDBY, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from STANDBY, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from STANDBY, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from STANDBY, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from STANDBY, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from STANDBY, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_STANDBY) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from STANDBY, NONE leads to RUN");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) || (self->state == ARS_SUPERVISION_RESYNCHRONISE), "from INHIBITED, ANGLE_UNKNOWN leads to RESYNCHRONISE");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_STANDBY)) || (self->state == ARS_SUPERVISION_STANDBY), "from INHIBITED, STANDBY leads to STANDBY");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_SAMPLE_LOST)) || (self->state == ARS_SUPERVISION_LOST), "from INHIBITED, SAMPLE_LOST leads to LOST");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_SAMPLE_MISSING)) || (self->state == ARS_SUPERVISION_PREDICTED), "from INHIBITED, SAMPLE_MISSING leads to PREDICTED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_SIGNAL_REPLACED)) || (self->state == ARS_SUPERVISION_DEGRADED), "from INHIBITED, SIGNAL_REPLACED leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_ACTUATOR_STUCK)) || (self->state == ARS_SUPERVISION_DEGRADED), "from INHIBITED, ACTUATOR_STUCK leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_TASK_LATE)) || (self->state == ARS_SUPERVISION_DEGRADED), "from INHIBITED, TASK_LATE leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_CONDITIONS_UNKNOWN)) || (self->state == ARS_SUPERVISION_DEGRADED), "from INHIBITED, CONDITIONS_UNKNOWN leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_BUS_INTERMITTENT)) || (self->state == ARS_SUPERVISION_DEGRADED), "from INHIBITED, BUS_INTERMITTENT leads to DEGRADED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_INHIBIT)) || (self->state == ARS_SUPERVISION_INHIBITED), "from INHIBITED, INHIBIT leads to INHIBITED");
    CONTRACT_ENSURE(!((self_before->state == ARS_SUPERVISION_INHIBITED) && (cause == ARS_CAUSE_NONE)) || (self->state == ARS_SUPERVISION_RUN), "from INHIBITED, NONE leads to RUN");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_START) || (result == ARS_STATUS_FAIL_SAFE), "in START the status is FAIL_SAFE");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_RUN) || (result == ((status == ARS_STATUS_LIMITED) ? status : ARS_STATUS_TRACKING)), "in RUN the status is TRACKING");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_PREDICTED) || (result == ARS_STATUS_DEGRADED), "in PREDICTED the status is DEGRADED");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_DEGRADED) || (result == ARS_STATUS_DEGRADED), "in DEGRADED the status is DEGRADED");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_LOST) || (result == ARS_STATUS_FAIL_SAFE), "in LOST the status is FAIL_SAFE");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_RESYNCHRONISE) || (result == ARS_STATUS_FAIL_SAFE), "in RESYNCHRONISE the status is FAIL_SAFE");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_STANDBY) || (result == ARS_STATUS_STANDBY), "in STANDBY the status is STANDBY");
    CONTRACT_ENSURE((self->state != ARS_SUPERVISION_INHIBITED) || (result == ((status == ARS_STATUS_LIMITED) ? status : ARS_STATUS_TRACKING)), "in INHIBITED the status is TRACKING");
    CONTRACT_ENSURE((self->cause == cause) && (self->status == result), "cause and status are kept");
}

static inline void ars_task_init_requires(const ars_task_t *self, const ars_parameters_t *parameters)
{
    (void)self;
    (void)parameters;
    CONTRACT_REQUIRE(ars_parameters_holds(parameters), "ars_task_init requires: parameters is within its invariant");
}

static inline void ars_task_init_ensures(const ars_task_t *self, const ars_parameters_t *parameters)
{
    (void)self;
    (void)parameters;
    CONTRACT_ENSURE(ars_task_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(self->parameters == parameters, "the parameters are those given");
}

static inline void ars_task_on_can_frame_requires(const ars_task_t *self, uint32_t id, const uint8_t data[8], uint8_t length)
{
    (void)self;
    (void)id;
    (void)data;
    (void)length;
    CONTRACT_REQUIRE(ars_task_holds(self), "ars_task_on_can_frame requires: self is within its invariant");
}

static inline void ars_task_on_can_frame_ensures(const ars_task_t *self, uint32_t id, const uint8_t data[8], uint8_t length, const ars_task_t *self_before)
{
    (void)self;
    (void)id;
    (void)data;
    (void)length;
    (void)self_before;
    CONTRACT_ENSURE(ars_task_holds(self), "self is within its invariant");
    CONTRACT_ENSURE((id != (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS) || (self->conditions_close == (self_before->motion_input.frames > 0u)), "the set is complete after the conditions of a cycle with the motion");
    CONTRACT_ENSURE((uint32_t)self->motion_input.frames == ((id == (uint32_t)ARS_CAN_ID_VEHICLE_MOTION) ? (((uint32_t)self_before->motion_input.frames < UINT8_MAX) ? ((uint32_t)self_before->motion_input.frames + 1u) : UINT8_MAX) : (uint32_t)self_before->motion_input.frames), "a frame of the motion counts, whatever its length and content");
    CONTRACT_ENSURE((uint32_t)self->conditions_input.frames == ((id == (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS) ? (((uint32_t)self_before->conditions_input.frames < UINT8_MAX) ? ((uint32_t)self_before->conditions_input.frames + 1u) : UINT8_MAX) : (uint32_t)self_before->conditions_input.frames), "a frame of the conditions counts, whatever its length and content");
}

static inline void ars_task_10ms_requires(const ars_task_t *self, const uint8_t data[8])
{
    (void)self;
    (void)data;
    CONTRACT_REQUIRE(ars_task_holds(self), "ars_task_10ms requires: self is within its invariant");
}

static inline void ars_task_10ms_ensures(const ars_task_t *self, const uint8_t data[8], uint32_t result, const ars_task_t *self_before)
{
    (void)self;
    (void)data;
    (void)result;
    (void)self_before;
    CONTRACT_ENSURE(ars_task_holds(self), "self is within its invariant");
    CONTRACT_ENSURE(result == (uint32_t)ARS_CAN_ID_REAR_STEER_COMMAND, "it is the frame of the command");
    CONTRACT_ENSURE(((data[1] & 0x0Fu) == (uint32_t)self_before->counter) && (self->counter == (((uint32_t)self_before->counter + 1u) % 15u)), "the frame has the counter, and the counter advances");
    CONTRACT_ENSURE(ars_e2e_crc((uint16_t)ARS_CAN_DATA_ID_REAR_STEER_COMMAND, data) == data[0], "the frame has the right CRC");
    CONTRACT_ENSURE((self->motion_input.frames == 0u) && (self->conditions_input.frames == 0u), "the next cycle begins without frames");
    CONTRACT_ENSURE(!self->conditions_close, "the next cycle begins with an incomplete set");
    CONTRACT_ENSURE(!(self->conditions_input.supervision.state == ARS_E2E_STATE_VALID) || !self->conditions.inhibit || ((uint32_t)self->supervision.cause <= (uint32_t)ARS_CAUSE_INHIBIT), "Inhibit acts until the car ends it, over single lost frames too");
    CONTRACT_ENSURE((self->conditions_input.supervision.state == ARS_E2E_STATE_VALID) || ((uint32_t)self->supervision.cause <= (uint32_t)ARS_CAUSE_CONDITIONS_UNKNOWN), "without valid conditions it is unknown whether the car sets Inhibit");
}

#endif /* ARS_CONTRACTS_H */
