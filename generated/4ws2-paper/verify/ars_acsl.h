/*
 * Contracts of the functions in ACSL, for Frama-C, TrustInSoft Analyzer and other tools that read it.
 *
 * Not part of the ECU software. The conditions are those of ars_contracts.h, which the harnesses prove_*.c prove with CBMC. Claims of a
 * harness that call static functions stay there. Floats are compared as in IEEE 754, and sums and products are rounded as in C. Give this
 * file to the tool with the sources. In the folder of the build, with Frama-C:
 *
 * frama-c -machdep x86_32 -cpp-extra-args=-Iinclude -kernel-warn-key annot-error=abort verify/ars_acsl.h src/ars_calibration.c src/ars_checksum.c src/ars_map.c src/ars_inputs.c src/ars_limiter.c src/ars_parameters.c src/ars_law.c src/ars_controller.c src/ars_dynamics.c src/ars_e2e.c src/ars_can.c src/ars_task.c src/ars_selftest.c
 *
 * With this file in its list of sources, the command in the head of every_function.c evaluates the contracts with EVA.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_ACSL_H
#define ARS_ACSL_H

#include "ars_can.h"
#include "ars_controller.h"
#include "ars_e2e.h"
#include "ars_map.h"
#include "ars_task.h"

#if ARS_MAP_BUILD != 0x94F418E9u
#error "ars_map.h and this source come from different builds"
#endif
#if ARS_TASK_BUILD != 0x94F418E9u
#error "ars_task.h and this source come from different builds"
#endif

/*@
    // The number without its sign.
    logic float magnitude_of(float value) = (float)\abs(value);

    // Whether the value is between low and high; false for NaN.
    predicate lies_between(float value, real low, real high) = \is_finite(value) && low <= value <= high;

    // Whether the value is within +-largest; false for NaN.
    predicate lies_within(float value, real largest) = lies_between(value, -largest, largest);

    // Whether a bool is true or false.
    predicate is_flag(_Bool value) = value == 0 || value == 1;
*/

/*@
    predicate ars_limiter_parameters_holds{L}(ars_limiter_parameters_t *value) =
        lies_between(value->rear_angle_max, 1.0e-04f, 1.0f)
        && lies_between(value->rear_rate_max, 0.017453292f, 1000.0f)
        && lies_between(value->in_phase_from_front_angle, 1.0e-04f, 1.0f)
        && lies_between(value->speed_max, 1.0f, 200.0f)
        && lies_between(value->front_angle_max, 0.01f, 1.5f)
        && (\forall integer k; 0 <= k < ARS_LIMITER_POINTS ==>
            lies_between(value->opposite_phase_speed[k], 0.0f, 200.0f)
            && (k == 0u || \lt_float(value->opposite_phase_speed[k - 1u], value->opposite_phase_speed[k]))
            && lies_between(value->opposite_phase_max[k], 0.0f, 1.0f)
            && \le_float(value->opposite_phase_max[k], value->rear_angle_max));
*/

/*@
    predicate ars_inputs_parameters_holds{L}(ars_inputs_parameters_t *value) =
        lies_between(value->speed_max, 13.888889f, 200.0f)
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
        && lies_between(value->yaw_rate_correction_share, 1.0e-06f, 1.0f)
        && lies_between(value->speed_fall, 0.0f, 1.0f)
        && lies_between(value->friction_recovery, 1.0e-05f, 1.0f)
        && value->missing_samples_max <= 100u
        && value->recovery_samples >= 1u
        && value->recovery_samples <= 10000u;
*/

/*@
    predicate ars_parameters_holds{L}(ars_parameters_t *value) =
        lies_between(value->proportional_gain, 0.0f, 2.0f)
        && lies_between(value->integral_gain, 0.01f, 20.0f)
        && lies_between(value->rear_angle_error_max, 0.0017453292f, 1.0f)
        && lies_between(value->rear_angle_max, 1.0e-04f, 0.061086524f)
        && lies_between(value->rear_rate_max, 0.017453292f, 1000.0f)
        && lies_between(value->friction_min, 0.02f, 0.5f)
        && lies_between(value->enable_speed, 0.1388889f, 27.777779f)
        && lies_between(value->disable_speed, 0.027777778f, 27.777779f)
        && lies_between(value->standby_rate, 0.0034906585f, 1.7453293f)
        && lies_between(value->fail_safe_rate, 0.0034906585f, 1.7453293f)
        && lies_between(value->actuator_share, 1.0e-04f, 1.0f)
        && lies_between(value->actuator_error_max, 1.0e-04f, 1.5f)
        && value->actuator_samples_max >= 1u
        && value->actuator_samples_max <= 60000u
        && \le_float(value->rear_angle_max, value->inputs.rear_angle_max)
        && \lt_float(value->disable_speed, value->enable_speed)
        && \le_float(value->inputs.speed_max, value->limiter.speed_max)
        && \le_float(value->inputs.front_angle_max, value->limiter.front_angle_max)
        && \le_float(value->limiter.rear_angle_max, value->rear_angle_max)
        && ars_inputs_parameters_holds(&value->inputs)
        && ars_limiter_parameters_holds(&value->limiter);
*/

/*@
    predicate ars_limiter_holds{L}(ars_limiter_t *value) =
        lies_within(value->rear_angle, 1.0f)
        && lies_between(value->speed, 0.0f, 200.0f)
        && lies_within(value->front_angle, 1.5f)
        && is_flag(value->speed_known);
*/

/*@
    predicate ars_inputs_holds{L}(ars_inputs_t *value) =
        lies_within(value->speed.value, 200.0f)
        && lies_within(value->front_angle.value, 1.5f)
        && lies_within(value->yaw_rate.value, 20.0f)
        && (uint32_t)value->speed.source <= 2u
        && (uint32_t)value->front_angle.source <= 2u
        && (uint32_t)value->yaw_rate.source <= 2u
        && value->speed.missing <= 101u
        && value->front_angle.missing <= 101u
        && value->yaw_rate.missing <= 101u
        && (value->speed.source == ARS_SIGNAL_MEASURED ==> value->speed.missing <= 100u)
        && (value->front_angle.source == ARS_SIGNAL_MEASURED ==> value->front_angle.missing <= 100u)
        && (value->yaw_rate.source == ARS_SIGNAL_MEASURED ==> value->yaw_rate.missing <= 100u)
        && (value->front_angle.source == ARS_SIGNAL_MEASURED ==> value->front_angle.good == 0u)
        && value->front_angle.good <= 10000u
        && value->yaw_rate.good <= 10000u
        && lies_within(value->expected_yaw_rate, 20.0f)
        && lies_within(value->beyond_linear, 20.0f)
        && lies_between(value->least, 0.0f, (float)(2.0f * 20.0f))
        && lies_between(value->least_of_front, 0.0f, (float)(2.0f * 20.0f))
        && lies_within(value->yaw_rate_offset, 1.0f)
        && lies_between(value->friction, 0.0f, 2.0f)
        && is_flag(value->lateral_is_known)
        && is_flag(value->lateral_is_proven);
*/

/*@
    predicate ars_law_holds{L}(ars_law_t *value) =
        lies_within(value->integral, 4096.0f)
        && is_flag(value->is_limited);
*/

/*@
    predicate ars_controller_holds{L}(ars_controller_t *value) =
        ars_law_holds(&value->law)
        && ars_inputs_holds(&value->inputs)
        && ars_limiter_holds(&value->limiter)
        && lies_within(value->rear_angle, 0.061086524f)
        && lies_within(value->yaw_rate_reference, 20.0f)
        && lies_within(value->yaw_rate_error, 40.0f)
        && value->initialised == 0x41525331u
        && lies_within(value->sample.speed, 200.0f)
        && lies_within(value->sample.front_angle, 1.5f)
        && lies_within(value->sample.yaw_rate, 20.0f)
        && lies_within(value->sample.rear_angle, 1.0f)
        && lies_within(value->sample.lateral_acceleration, 4096.0f)
        && lies_between(value->sample.friction, 0.0f, 2.0f)
        && is_flag(value->sample.inhibit)
        && (uint32_t)value->quality <= 3u
        && (uint32_t)value->status <= 4u
        && is_flag(value->enabled)
        && (value->status > ARS_STATUS_LIMITED || value->enabled != 0)
        && ((value->status != ARS_STATUS_STANDBY && value->status != ARS_STATUS_FAIL_SAFE) || value->enabled == 0)
        && \eq_float(value->rear_angle, value->limiter.rear_angle)
        && (value->quality != ARS_QUALITY_UNUSABLE || (value->status == ARS_STATUS_FAIL_SAFE && !(value->inputs.front_angle.source == ARS_SIGNAL_MEASURED) && !(value->inputs.yaw_rate.source == ARS_SIGNAL_MEASURED)));
*/

/*@
    predicate ars_e2e_receiver_holds{L}(ars_e2e_receiver_t *value) =
        value->last_counter <= 14u
        && value->max_delta_counter <= 14u
        && value->no_new_or_repeated_data_counter <= 14u
        && value->sync_counter <= 1u
        && is_flag(value->waits_for_first);
*/

/*@
    predicate ars_e2e_supervision_holds{L}(ars_e2e_supervision_t *value) =
        (uint32_t)value->state <= 3u;
*/

/*@
    predicate ars_task_input_holds{L}(ars_task_input_t *value) =
        ars_e2e_receiver_holds(&value->receiver)
        && ars_e2e_supervision_holds(&value->supervision)
        && value->causes <= 7u
        && value->advance <= 7u
        && is_flag(value->disturbed)
        && is_flag(value->usable);
*/

/*@
    predicate ars_task_holds{L}(ars_task_t *value) =
        ars_controller_holds(&value->controller)
        && ars_task_input_holds(&value->motion_input)
        && (\is_NaN(value->motion.speed) || lies_between(value->motion.speed, -163.84f, 163.84f))
        && (\is_NaN(value->motion.front_angle) || lies_between(value->motion.front_angle, -1.6384f, 1.6384f))
        && (\is_NaN(value->motion.yaw_rate) || lies_between(value->motion.yaw_rate, -6.5536f, 6.5536f))
        && ars_task_input_holds(&value->conditions_input)
        && (\is_NaN(value->conditions.rear_angle) || lies_between(value->conditions.rear_angle, -1.6384f, 1.6384f))
        && (\is_NaN(value->conditions.friction) || lies_between(value->conditions.friction, -0.01f, 2.55f))
        && (\is_NaN(value->conditions.lateral_acceleration) || lies_between(value->conditions.lateral_acceleration, -32.768f, 32.768f))
        && value->counter <= 14u
        && value->backlog <= 64u && value->disturbance <= 64u
        && value->actuator_samples <= 60001u
        && lies_within(value->expected_angle, 0.7853982f)
        && is_flag(value->conditions.inhibit)
        && is_flag(value->conditions_close)
        && is_flag(value->started);
*/

/*@
    predicate are_mirrored{L}(float first, float second) =
        \eq_float(first, (float)(-second)) || (\is_NaN(first) && \is_NaN(second));
*/

/*@
    predicate ars_map_speed_breakpoints_hold{L}(integer k) =
        k >= (uint32_t)ARS_MAP_SPEED_POINTS || (lies_between(ars_map_speed_breakpoints[k], 0.0f, 150.0f) && ((k == 0u ==> \le_float(ars_map_speed_breakpoints[0], (float)0.0f)) && (!(k == 0u) ==> \lt_float(ars_map_speed_breakpoints[k - 1u], ars_map_speed_breakpoints[k]))));
*/

/*@
    predicate ars_map_front_angle_breakpoints_hold{L}(integer k) =
        k >= (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS || (lies_between(ars_map_front_angle_breakpoints[k], 0.0f, 1.2f) && ((k == 0u ==> \le_float(ars_map_front_angle_breakpoints[0], (float)0.0f)) && (!(k == 0u) ==> \lt_float(ars_map_front_angle_breakpoints[k - 1u], ars_map_front_angle_breakpoints[k]))));
*/

/*@
    predicate ars_map_cell_holds{L}(integer row, integer column) =
        row >= (uint32_t)ARS_MAP_SPEED_POINTS || column >= (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS || lies_between(ars_map_yaw_rate_table[row][column], 0.0f, 10.0f);
*/

/*@
    requires "parameters is valid":
        \valid_read(parameters);
    assigns \nothing;
    ensures "valid parameters are in range":
        \result != 0 ==> ars_limiter_parameters_holds(parameters);
*/
bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters);

/*@
    requires "self is valid":
        \valid(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_limiter_holds(self);
    ensures "it starts from the angle given; from zero beyond 1 rad and for NaN":
        (lies_within(rear_angle, 1.0f) ==> \eq_float(self->rear_angle, rear_angle)) && (!lies_within(rear_angle, 1.0f) ==> \eq_float(self->rear_angle, (float)0.0f));
*/
void ars_limiter_init(ars_limiter_t *self, float rear_angle);

/*@
    requires "self is valid":
        \valid(self);
    requires "parameters is valid":
        \valid_read(parameters);
    requires "input is valid":
        \valid_read(input);
    requires "objects do not overlap":
        \separated(self, parameters, input);
    requires "self is within its invariant":
        ars_limiter_holds(self);
    requires "parameters is within its invariant":
        ars_limiter_parameters_holds(parameters);
    assigns *self;
    ensures "self is within its invariant":
        ars_limiter_holds(self);
    ensures "|rear angle| is at most rear_angle_max":
        lies_within(\result, parameters->rear_angle_max);
    ensures "the result is kept":
        \eq_float(\result, self->rear_angle);
    ensures "it rises by at most rear_rate_max, or to -rear_angle_max":
        \le_float(\result, (float)(\old(self->rear_angle) + (float)(parameters->rear_rate_max * 0.01f))) || \eq_float(\result, (float)(-parameters->rear_angle_max));
    ensures "it falls by at most rear_rate_max, or to rear_angle_max":
        \le_float((float)(\old(self->rear_angle) - (float)(parameters->rear_rate_max * 0.01f)), \result) || \eq_float(\result, parameters->rear_angle_max);
    ensures "speed is the one given where it is available, else the last one":
        (lies_within(input->speed, parameters->speed_max) ==> \eq_float(self->speed, magnitude_of(input->speed))) && (!lies_within(input->speed, parameters->speed_max) ==> \eq_float(self->speed, \old(self->speed)));
    ensures "front_angle is the one given where it is available, else the last one":
        (lies_within(input->front_angle, parameters->front_angle_max) ==> \eq_float(self->front_angle, input->front_angle)) && (!lies_within(input->front_angle, parameters->front_angle_max) ==> \eq_float(self->front_angle, \old(self->front_angle)));
    ensures "a speed is known once there was one":
        (self->speed_known != 0) <==> (lies_within(input->speed, parameters->speed_max) || \old(self->speed_known) != 0);
    ensures "it is not above its last value, the demand and zero":
        \le_float(\result, \old(self->rear_angle)) || \le_float(\result, input->demand) || \le_float(\result, (float)0.0f);
    ensures "it is not below its last value, the demand and zero":
        \le_float(\old(self->rear_angle), \result) || \le_float(input->demand, \result) || \le_float((float)0.0f, \result);
    ensures "from the left, it follows a demand toward zero as fast as rear_rate_max lets it":
        self->speed_known == 0 || \is_NaN(input->demand) || \le_float(\result, input->demand) || \le_float(\result, (float)0.0f) || \le_float(\result, (float)(\old(self->rear_angle) - (float)(parameters->rear_rate_max * 0.01f)));
    ensures "from the right, it follows a demand toward zero as fast as rear_rate_max lets it":
        self->speed_known == 0 || \is_NaN(input->demand) || \le_float(input->demand, \result) || \le_float((float)0.0f, \result) || \le_float((float)(\old(self->rear_angle) + (float)(parameters->rear_rate_max * 0.01f)), \result);
    ensures "it is held as long as no speed is known":
        self->speed_known != 0 || !(lies_within(\old(self->rear_angle), parameters->rear_angle_max)) || \eq_float(\result, \old(self->rear_angle));
*/
float ars_limiter_step(ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input);

/*@
    requires "parameters is valid":
        \valid_read(parameters);
    assigns \nothing;
    ensures "valid parameters are in range":
        \result != 0 ==> ars_inputs_parameters_holds(parameters);
*/
bool ars_inputs_parameters_valid(const ars_inputs_parameters_t *parameters);

/*@
    requires "self is valid":
        \valid(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_inputs_holds(self);
*/
void ars_inputs_init(ars_inputs_t *self, bool is_trusted);

/*@
    requires "self is valid":
        \valid(self);
    requires "parameters is valid":
        \valid_read(parameters);
    requires "measured is valid":
        \valid_read(measured);
    requires "checked is valid":
        \valid(checked);
    requires "objects do not overlap":
        \separated(self, parameters, measured, checked);
    requires "self is within its invariant":
        ars_inputs_holds(self);
    requires "parameters is within its invariant":
        ars_inputs_parameters_holds(parameters);
    requires "inhibit is true or false":
        is_flag(measured->inhibit);
    requires "rear_angle is within its range":
        lies_within(rear_angle, 1.0f);
    assigns *self, *checked;
    ensures "self is within its invariant":
        ars_inputs_holds(self);
    ensures "speed is within its range":
        lies_within(checked->speed, 200.0f);
    ensures "front_angle is within its range":
        lies_within(checked->front_angle, 1.5f);
    ensures "yaw_rate is within its range":
        lies_within(checked->yaw_rate, 20.0f);
    ensures "rear_angle is within its range":
        lies_within(checked->rear_angle, 1.0f);
    ensures "lateral_acceleration is within its range":
        lies_within(checked->lateral_acceleration, 4096.0f);
    ensures "friction is within its range":
        lies_between(checked->friction, 0.0f, 2.0f);
    ensures "inhibit is true or false":
        is_flag(checked->inhibit);
    ensures "the quality is one of its enumerators":
        (uint32_t)\result <= 3u;
    ensures "the sample is unusable if neither front angle nor yaw rate is used":
        (\result == ARS_QUALITY_UNUSABLE) <==> (!(self->front_angle.source == ARS_SIGNAL_MEASURED) && !(self->yaw_rate.source == ARS_SIGNAL_MEASURED));
    ensures "a good sample has all signals":
        \result != ARS_QUALITY_GOOD || (self->speed.source == ARS_SIGNAL_MEASURED && self->front_angle.source == ARS_SIGNAL_MEASURED && self->yaw_rate.source == ARS_SIGNAL_MEASURED);
    ensures "a signal of a replaced sample is not used":
        \result != ARS_QUALITY_REPLACED || !(self->speed.source == ARS_SIGNAL_MEASURED) || !(self->front_angle.source == ARS_SIGNAL_MEASURED) || !(self->yaw_rate.source == ARS_SIGNAL_MEASURED);
    ensures "a signal of a missing sample is missing":
        \result != ARS_QUALITY_MISSING || self->speed.missing > 0u || self->front_angle.missing > 0u || self->yaw_rate.missing > 0u;
    ensures "speed is used again only after recovery_samples good ones in a row":
        \old(self->speed.source) == ARS_SIGNAL_MEASURED || !(self->speed.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->speed, parameters->speed_max) && (uint32_t)(\old(self->speed.good) + 1u) >= parameters->recovery_samples);
    ensures "without speed, its count of good samples starts anew":
        \old(self->speed.source) == ARS_SIGNAL_MEASURED || self->speed.source == ARS_SIGNAL_MEASURED || self->speed.good == 0u || (lies_within(measured->speed, parameters->speed_max) && self->speed.good == (uint32_t)(\old(self->speed.good) + 1u));
    ensures "speed that is no longer used has no good sample":
        !(\old(self->speed.source) == ARS_SIGNAL_MEASURED) || self->speed.source == ARS_SIGNAL_MEASURED || self->speed.good == 0u;
    ensures "speed is not used after missing_samples_max missing ones":
        !(\old(self->speed.source) == ARS_SIGNAL_MEASURED) || lies_within(measured->speed, parameters->speed_max) || (self->speed.missing == (uint32_t)(\old(self->speed.missing) + 1u) && (self->speed.source == ARS_SIGNAL_MEASURED ==> self->speed.missing <= parameters->missing_samples_max));
    ensures "front_angle is used again only after recovery_samples good ones in a row":
        \old(self->front_angle.source) == ARS_SIGNAL_MEASURED || !(self->front_angle.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->front_angle, parameters->front_angle_max) && (uint32_t)(\old(self->front_angle.good) + 1u) >= parameters->recovery_samples);
    ensures "without front_angle, its count of good samples starts anew":
        \old(self->front_angle.source) == ARS_SIGNAL_MEASURED || self->front_angle.source == ARS_SIGNAL_MEASURED || self->front_angle.good == 0u || (lies_within(measured->front_angle, parameters->front_angle_max) && self->front_angle.good == (uint32_t)(\old(self->front_angle.good) + 1u));
    ensures "front_angle that is no longer used has no good sample":
        !(\old(self->front_angle.source) == ARS_SIGNAL_MEASURED) || self->front_angle.source == ARS_SIGNAL_MEASURED || self->front_angle.good == 0u;
    ensures "front_angle is not used after missing_samples_max missing ones":
        !(\old(self->front_angle.source) == ARS_SIGNAL_MEASURED) || lies_within(measured->front_angle, parameters->front_angle_max) || (self->front_angle.missing == (uint32_t)(\old(self->front_angle.missing) + 1u) && (self->front_angle.source == ARS_SIGNAL_MEASURED ==> self->front_angle.missing <= parameters->missing_samples_max));
    ensures "yaw_rate is used again only after recovery_samples good ones in a row":
        \old(self->yaw_rate.source) == ARS_SIGNAL_MEASURED || !(self->yaw_rate.source == ARS_SIGNAL_MEASURED) || (lies_within(measured->yaw_rate, parameters->yaw_rate_max) && (uint32_t)(\old(self->yaw_rate.good) + 1u) >= parameters->recovery_samples);
    ensures "without yaw_rate, its count of good samples starts anew":
        \old(self->yaw_rate.source) == ARS_SIGNAL_MEASURED || self->yaw_rate.source == ARS_SIGNAL_MEASURED || self->yaw_rate.good == 0u || (lies_within(measured->yaw_rate, parameters->yaw_rate_max) && self->yaw_rate.good == (uint32_t)(\old(self->yaw_rate.good) + 1u));
    ensures "yaw_rate that is no longer used has no good sample":
        !(\old(self->yaw_rate.source) == ARS_SIGNAL_MEASURED) || self->yaw_rate.source == ARS_SIGNAL_MEASURED || self->yaw_rate.good == 0u;
    ensures "yaw_rate is not used after missing_samples_max missing ones":
        !(\old(self->yaw_rate.source) == ARS_SIGNAL_MEASURED) || lies_within(measured->yaw_rate, parameters->yaw_rate_max) || (self->yaw_rate.missing == (uint32_t)(\old(self->yaw_rate.missing) + 1u) && (self->yaw_rate.source == ARS_SIGNAL_MEASURED ==> self->yaw_rate.missing <= parameters->missing_samples_max));
*/
ars_quality_t ars_inputs_step(ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle, ars_measurement_t *checked);

/*@
    assigns \nothing;
    ensures "the axes of a valid map are in range and increasing":
        \forall integer any_row, any_column; any_row >= 0 && any_column >= 0 ==> (\result != 0 ==> (ars_map_speed_breakpoints_hold(any_row) && ars_map_front_angle_breakpoints_hold(any_column)));
    ensures "the numbers of a valid map are in range":
        \forall integer any_row, any_column; any_row >= 0 && any_column >= 0 ==> (\result != 0 ==> ars_map_cell_holds(any_row, any_column));
*/
bool ars_map_valid(void);

/*@
    assigns \nothing;
    ensures "the yaw rate is in range":
        lies_within(\result, 16.0f);
*/
float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction);

/*@
    requires "self is valid":
        \valid(self);
    requires "rear_angle is in range":
        lies_within(rear_angle, 1.0f);
    assigns *self;
    ensures "self is within its invariant":
        ars_law_holds(self);
*/
void ars_law_init(ars_law_t *self, float rear_angle);

/*@
    requires "self is valid":
        \valid(self);
    requires "parameters is valid":
        \valid_read(parameters);
    requires "sample is valid":
        \valid_read(sample);
    requires "objects do not overlap":
        \separated(self, parameters, sample);
    requires "self is within its invariant":
        ars_law_holds(self);
    requires "parameters is within its invariant":
        ars_parameters_holds(parameters);
    requires "speed is in range":
        lies_between(sample->speed, 0.01f, 200.0f);
    requires "front_angle is in range":
        lies_between(sample->front_angle, -1.5f, 1.5f);
    requires "yaw_rate is in range":
        lies_between(sample->yaw_rate, -20.0f, 20.0f);
    requires "inhibit is true or false":
        is_flag(sample->inhibit);
    requires "phase is one of its enumerators":
        (uint32_t)phase <= 2u;
    requires "rear_angle is in range":
        lies_within(rear_angle, 1.0f);
    requires "yaw_rate_error is in range":
        lies_within(yaw_rate_error, 1000.0f);
    assigns *self;
    ensures "self is within its invariant":
        ars_law_holds(self);
    ensures "the command moves by at most the lower of both rates":
        ((\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float((float)(rear_angle - (float)(parameters->rear_rate_max * 0.01f)), \result.rear_angle)) && (!\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float((float)(rear_angle - (float)(parameters->limiter.rear_rate_max * 0.01f)), \result.rear_angle))) && ((\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float(\result.rear_angle, (float)(rear_angle + (float)(parameters->rear_rate_max * 0.01f)))) && (!\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float(\result.rear_angle, (float)(rear_angle + (float)(parameters->limiter.rear_rate_max * 0.01f)))));
    ensures "yaw_rate_reference is in range":
        lies_within(\result.yaw_rate_reference, 20.0f);
*/
ars_law_output_t ars_law_step(ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase, float friction, float rear_angle, float yaw_rate_error);

/*@
    requires "parameters is valid":
        \valid_read(parameters);
    assigns \nothing;
    ensures "valid parameters are in range":
        \result != 0 ==> ars_parameters_holds(parameters);
    ensures "the axes of a valid map are in range and increasing":
        \forall integer any_row, any_column; any_row >= 0 && any_column >= 0 ==> (\result != 0 ==> (ars_map_speed_breakpoints_hold(any_row) && ars_map_front_angle_breakpoints_hold(any_column)));
    ensures "the numbers of a valid map are in range":
        \forall integer any_row, any_column; any_row >= 0 && any_column >= 0 ==> (\result != 0 ==> ars_map_cell_holds(any_row, any_column));
*/
bool ars_parameters_valid(const ars_parameters_t *parameters);

/*@
    requires "self is valid":
        \valid(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_controller_holds(self);
    ensures "|rear_angle| is at most the actuator's largest angle":
        lies_within(self->rear_angle, 0.061086524f);
*/
void ars_controller_init(ars_controller_t *self, float rear_angle);

/*@
    requires "self is valid":
        \valid(self);
    requires "parameters is valid":
        \valid_read(parameters);
    requires "measurement is valid":
        \valid_read(measurement);
    requires "objects do not overlap":
        \separated(self, parameters, measurement);
    requires "self is within its invariant":
        ars_controller_holds(self);
    requires "parameters is within its invariant":
        ars_parameters_holds(parameters);
    requires "inhibit is true or false":
        is_flag(measurement->inhibit);
    assigns *self;
    ensures "self is within its invariant":
        ars_controller_holds(self);
    ensures "|rear_angle| is at most rear_angle_max":
        lies_within(\result.rear_angle, parameters->rear_angle_max);
    ensures "yaw_rate_reference is in range":
        lies_within(\result.yaw_rate_reference, 20.0f);
    ensures "status is one of its enumerators":
        (uint32_t)\result.status <= 4u;
    ensures "it rises by at most rear_rate_max, or to -rear_angle_max":
        \le_float(\result.rear_angle, (float)(\old(self->rear_angle) + (float)(parameters->limiter.rear_rate_max * 0.01f))) || \eq_float(\result.rear_angle, (float)(-parameters->limiter.rear_angle_max));
    ensures "it falls by at most rear_rate_max, or to rear_angle_max":
        \le_float((float)(\old(self->rear_angle) - (float)(parameters->limiter.rear_rate_max * 0.01f)), \result.rear_angle) || \eq_float(\result.rear_angle, parameters->limiter.rear_angle_max);
    ensures "tracking, it moves by at most the lower of both rates":
        \result.status != ARS_STATUS_TRACKING || (((\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float((float)(\old(self->rear_angle) - (float)(parameters->rear_rate_max * 0.01f)), \result.rear_angle)) && (!\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float((float)(\old(self->rear_angle) - (float)(parameters->limiter.rear_rate_max * 0.01f)), \result.rear_angle))) && ((\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float(\result.rear_angle, (float)(\old(self->rear_angle) + (float)(parameters->rear_rate_max * 0.01f)))) && (!\lt_float(parameters->rear_rate_max, parameters->limiter.rear_rate_max) ==> \le_float(\result.rear_angle, (float)(\old(self->rear_angle) + (float)(parameters->limiter.rear_rate_max * 0.01f))))));
    ensures "without control |rear_angle| does not grow":
        self->enabled != 0 || \le_float(magnitude_of(\result.rear_angle), magnitude_of(\old(self->rear_angle)));
    ensures "the command and the status are kept":
        \eq_float(\result.rear_angle, self->rear_angle) && \result.status == self->status;
*/
ars_command_t ars_controller_step(ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement);

/*@
    requires "self is valid":
        \valid(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_e2e_receiver_holds(self);
*/
void ars_e2e_receiver_init(ars_e2e_receiver_t *self);

/*@
    requires "self is valid":
        \valid(self);
    requires "data is valid":
        \valid_read(data + (0 .. 7));
    requires "objects do not overlap":
        \separated(self, data + (0 .. 7));
    requires "self is within its invariant":
        ars_e2e_receiver_holds(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_e2e_receiver_holds(self);
    ensures "the result is one of its enumerators":
        (uint32_t)\result <= 7u;
    // Left out, since ars_e2e_crc() is not a function of ACSL: a wrong CRC is found.
    // Left out, since ars_e2e_crc() is not a function of ACSL: only the first intact frame may have any counter.
    ensures "the first intact frame ends the wait for it":
        (self->waits_for_first != 0) <==> (\result == ARS_E2E_WRONG_CRC && \old(self->waits_for_first) != 0);
    // Left out, since ars_e2e_crc() is not a function of ACSL: a repeated counter is found.
    // Left out, since ars_e2e_crc() is not a function of ACSL: a counter beyond the window is found.
    // Left out, since ars_e2e_crc() is not a function of ACSL: a frame is accepted if its counter advances by one.
    // Left out, since ars_e2e_crc() is not a function of ACSL: after lost frames, one is accepted within the window only.
    ensures "the window grows until a new frame":
        ((\result == ARS_E2E_WRONG_CRC || \result == ARS_E2E_REPEATED) && \old(self->max_delta_counter) < 14u ==> self->max_delta_counter == (uint32_t)(\old(self->max_delta_counter) + 1u)) && ((\result == ARS_E2E_WRONG_CRC || \result == ARS_E2E_REPEATED) && !(\old(self->max_delta_counter) < 14u) ==> self->max_delta_counter == 14u) && (!(\result == ARS_E2E_WRONG_CRC || \result == ARS_E2E_REPEATED) ==> self->max_delta_counter == 1u);
    ensures "the last counter is that of the last new frame":
        ((\result == ARS_E2E_WRONG_CRC || \result == ARS_E2E_REPEATED) ==> self->last_counter == \old(self->last_counter)) && (!(\result == ARS_E2E_WRONG_CRC || \result == ARS_E2E_REPEATED) ==> self->last_counter == (data[1] & 0x0Fu));
    ensures "after a jump, frames must be in sequence":
        \result == ARS_E2E_WRONG_SEQUENCE ==> self->sync_counter == 1u;
*/
ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8]);

/*@
    requires "self is valid":
        \valid(self);
    requires "self is within its invariant":
        ars_e2e_receiver_holds(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_e2e_receiver_holds(self);
    ensures "it returns NO_NEW_DATA":
        \result == ARS_E2E_NO_NEW_DATA;
    ensures "the accepted advance of the counter grows by one":
        (\old(self->max_delta_counter) < 14u ==> self->max_delta_counter == (uint32_t)(\old(self->max_delta_counter) + 1u)) && (!(\old(self->max_delta_counter) < 14u) ==> self->max_delta_counter == 14u);
*/
ars_e2e_status_t ars_e2e_no_new_data(ars_e2e_receiver_t *self);

/*@
    requires "counter is valid":
        \valid(counter);
    requires "data is valid":
        \valid(data + (0 .. 7));
    requires "objects do not overlap":
        \separated(counter, data + (0 .. 7));
    assigns *counter, data[0 .. 7];
    ensures "the counter for the next frame is at most 14":
        *counter <= 14u;
    ensures "the frame carries the counter":
        (data[1] & 0x0Fu) == (\old(*counter) & 0x0Fu);
    // Left out, since ars_e2e_crc() is not a function of ACSL: the frame has the right CRC.
*/
void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8]);

/*@
    requires "self is valid":
        \valid(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_e2e_supervision_holds(self);
*/
void ars_e2e_supervision_init(ars_e2e_supervision_t *self);

/*@
    requires "self is valid":
        \valid(self);
    requires "self is within its invariant":
        ars_e2e_supervision_holds(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_e2e_supervision_holds(self);
    ensures "the result is kept":
        \result == self->state;
    ensures "the first good frame ends NO_DATA":
        \old(self->state) == ARS_E2E_STATE_NO_DATA ==> ((is_good != 0 ==> self->state == ARS_E2E_STATE_INIT) && (is_good == 0 ==> self->state == ARS_E2E_STATE_NO_DATA));
    ensures "NO_DATA does not return":
        \old(self->state) == ARS_E2E_STATE_NO_DATA || !(self->state == ARS_E2E_STATE_NO_DATA);
    ensures "the window has the last good cycles":
        \old(self->state) == ARS_E2E_STATE_NO_DATA || ((is_good != 0 ==> ((self->window >> 0u) & 0x3Fu) == (((uint32_t)((\old(self->window) >> 0u) << 1u) | 1u) & 0x3Fu)) && (is_good == 0 ==> ((self->window >> 0u) & 0x3Fu) == (((uint32_t)((\old(self->window) >> 0u) << 1u) | 0u) & 0x3Fu)));
    ensures "the window has the last damaged cycles":
        \old(self->state) == ARS_E2E_STATE_NO_DATA || ((is_damaged != 0 ==> ((self->window >> 16u) & 0x3Fu) == (((uint32_t)((\old(self->window) >> 16u) << 1u) | 1u) & 0x3Fu)) && (is_damaged == 0 ==> ((self->window >> 16u) & 0x3Fu) == (((uint32_t)((\old(self->window) >> 16u) << 1u) | 0u) & 0x3Fu)));
    ensures "from INIT, the thresholds decide on VALID":
        \old(self->state) == ARS_E2E_STATE_INIT ==> ((self->state == ARS_E2E_STATE_VALID) <==> ((uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u)) + ((self->window >> 2u) & 1u)) + ((self->window >> 3u) & 1u)) + ((self->window >> 4u) & 1u)) + ((self->window >> 5u) & 1u)) >= 2u && (uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u)) + ((self->window >> 18u) & 1u)) + ((self->window >> 19u) & 1u)) + ((self->window >> 20u) & 1u)) + ((self->window >> 21u) & 1u)) <= 2u));
    ensures "INIT stays until there are enough good or too many damaged cycles":
        \old(self->state) == ARS_E2E_STATE_INIT ==> ((self->state == ARS_E2E_STATE_INIT) <==> ((uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u)) + ((self->window >> 18u) & 1u)) + ((self->window >> 19u) & 1u)) + ((self->window >> 20u) & 1u)) + ((self->window >> 21u) & 1u)) <= 2u && !((uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u)) + ((self->window >> 2u) & 1u)) + ((self->window >> 3u) & 1u)) + ((self->window >> 4u) & 1u)) + ((self->window >> 5u) & 1u)) >= 2u)));
    ensures "from VALID, the thresholds decide on VALID":
        \old(self->state) == ARS_E2E_STATE_VALID ==> ((self->state == ARS_E2E_STATE_VALID) <==> ((uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u)) + ((self->window >> 2u) & 1u)) + ((self->window >> 3u) & 1u)) + ((self->window >> 4u) & 1u)) + ((self->window >> 5u) & 1u)) >= 2u && (uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u)) + ((self->window >> 18u) & 1u)) + ((self->window >> 19u) & 1u)) + ((self->window >> 20u) & 1u)) + ((self->window >> 21u) & 1u)) <= 3u));
    ensures "from VALID, INIT does not return":
        \old(self->state) == ARS_E2E_STATE_VALID ==> !(self->state == ARS_E2E_STATE_INIT);
    ensures "from INVALID, the thresholds decide on VALID":
        \old(self->state) == ARS_E2E_STATE_INVALID ==> ((self->state == ARS_E2E_STATE_VALID) <==> ((uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 0u) & 1u) + ((self->window >> 1u) & 1u)) + ((self->window >> 2u) & 1u)) + ((self->window >> 3u) & 1u)) + ((self->window >> 4u) & 1u)) + ((self->window >> 5u) & 1u)) >= 3u && (uint32_t)((uint32_t)((uint32_t)((uint32_t)((uint32_t)(((self->window >> 16u) & 1u) + ((self->window >> 17u) & 1u)) + ((self->window >> 18u) & 1u)) + ((self->window >> 19u) & 1u)) + ((self->window >> 20u) & 1u)) + ((self->window >> 21u) & 1u)) <= 2u));
    ensures "from INVALID, INIT does not return":
        \old(self->state) == ARS_E2E_STATE_INVALID ==> !(self->state == ARS_E2E_STATE_INIT);
*/
ars_e2e_state_t ars_e2e_supervise(ars_e2e_supervision_t *self, bool is_good, bool is_damaged);

/*@
    assigns \nothing;
    ensures "it is NaN":
        \is_NaN(\result);
*/
float ars_can_not_available(void);

/*@
    requires "data is valid":
        \valid_read(data + (0 .. 7));
    requires "signals is valid":
        \valid(signals);
    requires "objects do not overlap":
        \separated(data + (0 .. 7), signals);
    assigns *signals;
    ensures "speed is in the range of its frame, or NaN":
        \is_NaN(signals->speed) || lies_between(signals->speed, -163.84f, 163.84f);
    ensures "front_angle is in the range of its frame, or NaN":
        \is_NaN(signals->front_angle) || lies_between(signals->front_angle, -1.6384f, 1.6384f);
    ensures "yaw_rate is in the range of its frame, or NaN":
        \is_NaN(signals->yaw_rate) || lies_between(signals->yaw_rate, -6.5536f, 6.5536f);
*/
void ars_can_unpack_vehicle_motion(const uint8_t data[8], ars_vehicle_motion_t *signals);

/*@
    requires "signals is valid":
        \valid_read(signals);
    requires "data is valid":
        \valid(data + (0 .. 7));
    requires "objects do not overlap":
        \separated(signals, data + (0 .. 7));
    assigns data[0 .. 7];
*/
void ars_can_pack_vehicle_motion(const ars_vehicle_motion_t *signals, uint8_t data[8]);

/*@
    requires "data is valid":
        \valid_read(data + (0 .. 7));
    requires "signals is valid":
        \valid(signals);
    requires "objects do not overlap":
        \separated(data + (0 .. 7), signals);
    assigns *signals;
    ensures "rear_angle is in the range of its frame, or NaN":
        \is_NaN(signals->rear_angle) || lies_between(signals->rear_angle, -1.6384f, 1.6384f);
    ensures "friction is in the range of its frame, or NaN":
        \is_NaN(signals->friction) || lies_between(signals->friction, -0.01f, 2.55f);
    ensures "lateral_acceleration is in the range of its frame, or NaN":
        \is_NaN(signals->lateral_acceleration) || lies_between(signals->lateral_acceleration, -32.768f, 32.768f);
*/
void ars_can_unpack_vehicle_conditions(const uint8_t data[8], ars_vehicle_conditions_t *signals);

/*@
    requires "signals is valid":
        \valid_read(signals);
    requires "data is valid":
        \valid(data + (0 .. 7));
    requires "objects do not overlap":
        \separated(signals, data + (0 .. 7));
    assigns data[0 .. 7];
*/
void ars_can_pack_vehicle_conditions(const ars_vehicle_conditions_t *signals, uint8_t data[8]);

/*@
    requires "data is valid":
        \valid_read(data + (0 .. 7));
    requires "signals is valid":
        \valid(signals);
    requires "objects do not overlap":
        \separated(data + (0 .. 7), signals);
    assigns *signals;
    ensures "rear_angle is in the range of its frame, or NaN":
        \is_NaN(signals->rear_angle) || lies_between(signals->rear_angle, -1.6384f, 1.6384f);
    ensures "yaw_rate_reference is in the range of its frame, or NaN":
        \is_NaN(signals->yaw_rate_reference) || lies_between(signals->yaw_rate_reference, -6.5536f, 6.5536f);
*/
void ars_can_unpack_rear_steer_command(const uint8_t data[8], ars_rear_steer_command_t *signals);

/*@
    requires "signals is valid":
        \valid_read(signals);
    requires "data is valid":
        \valid(data + (0 .. 7));
    requires "objects do not overlap":
        \separated(signals, data + (0 .. 7));
    assigns data[0 .. 7];
*/
void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8]);

/*@
    requires "self is valid":
        \valid(self);
    requires "parameters is valid":
        \valid_read(parameters);
    requires "objects do not overlap":
        \separated(self, parameters);
    requires "parameters is within its invariant":
        ars_parameters_holds(parameters);
    assigns *self;
    ensures "self is within its invariant":
        ars_task_holds(self);
    ensures "the parameters are those given":
        self->parameters == parameters;
*/
void ars_task_init(ars_task_t *self, const ars_parameters_t *parameters);

/*@
    requires "self is valid":
        \valid(self);
    requires "data is valid":
        length == 8 ==> \valid_read(data + (0 .. 7));
    requires "self->parameters is valid":
        \valid_read(self->parameters);
    requires "self->parameters is within its invariant":
        ars_parameters_holds(self->parameters);
    requires "objects do not overlap":
        \separated(self, data + (0 .. 7), self->parameters);
    requires "self is within its invariant":
        ars_task_holds(self);
    assigns *self;
    ensures "self is within its invariant":
        ars_task_holds(self);
*/
void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t data[8], uint8_t length);

/*@
    requires "self is valid":
        \valid(self);
    requires "data is valid":
        \valid(data + (0 .. 7));
    requires "self->parameters is valid":
        \valid_read(self->parameters);
    requires "self->parameters is within its invariant":
        ars_parameters_holds(self->parameters);
    requires "objects do not overlap":
        \separated(self, data + (0 .. 7), self->parameters);
    requires "self is within its invariant":
        ars_task_holds(self);
    assigns *self, data[0 .. 7];
    ensures "self is within its invariant":
        ars_task_holds(self);
    ensures "it is the frame of the command":
        \result == (uint32_t)ARS_CAN_ID_REAR_STEER_COMMAND;
    ensures "the frame has the counter, and the counter advances":
        (data[1] & 0x0Fu) == (uint32_t)\old(self->counter) && self->counter == ((uint32_t)((uint32_t)\old(self->counter) + 1u) % 15u);
    // Left out, since ars_e2e_crc() is not a function of ACSL: the frame has the right CRC.
*/
uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8]);

#endif /* ARS_ACSL_H */
