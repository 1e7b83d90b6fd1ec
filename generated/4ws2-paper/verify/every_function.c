/*
 * Calls every public function with all inputs that it allows, for abstract interpreters.
 *
 * Not part of the ECU software. An object declared volatile has any value of its type each time it is read, NaN and infinity included.
 * States are those that the functions themselves reach, after any number of calls in any order. Run in the folder of the build, with
 * Frama-C:
 *
 * frama-c -machdep x86_32 -cpp-extra-args=-Iinclude verify/every_function.c src/ars_calibration.c src/ars_checksum.c src/ars_map.c src/ars_inputs.c src/ars_limiter.c src/ars_parameters.c src/ars_law.c src/ars_controller.c src/ars_dynamics.c src/ars_e2e.c src/ars_can.c src/ars_supervision.c src/ars_task.c src/ars_selftest.c -warn-special-float none -warn-signed-downcast -warn-pointer-downcast -eva -eva-no-print -eva-domains cvalue,equality,gauges,symbolic-locations -eva-auto-loop-unroll 32 -eva-ilevel 256 -eva-plevel 256 -eva-subdivide-non-linear 60 -eva-subdivide-non-linear-function crc_step:0,ars_checksum_real:0,ars_checksum_whole:0 -then -report-csv alarms.csv
 *
 * Other abstract interpreters (Astree, Polyspace, TrustInSoft Analyzer) take the same file: main() is the entry.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_task.h"
#include "ars_dynamics.h"
#include "ars_map.h"

#if ARS_TASK_BUILD != 0x76CDF87Cu
#error "ars_task.h and this source come from different builds"
#endif

extern volatile int any;
extern volatile float any_number;
extern volatile uint8_t any_byte;
extern volatile uint16_t any_data_id;
extern volatile uint32_t any_id;
extern volatile ars_dynamics_state_t any_dynamics_state;
extern volatile ars_dynamics_input_t any_dynamics_input;
extern volatile ars_limiter_parameters_t any_limiter_parameters;
extern volatile ars_limiter_input_t any_limiter_input;
extern volatile ars_measurement_t any_measurement;
extern volatile ars_parameters_t any_parameters;
extern volatile ars_vehicle_motion_t any_vehicle_motion;
extern volatile ars_vehicle_conditions_t any_vehicle_conditions;
extern volatile ars_rear_steer_command_t any_rear_steer_command;

static uint8_t frame[8];

static void any_frame(void)
{
    for (int k = 0; k < 8; k++) {
        frame[k] = any_byte;
    }
}

static void call_map(void)
{
    (void)ars_map_yaw_rate(any_number, any_number);
    (void)ars_map_yaw_rate_on_road(any_number, any_number, any_number);
    (void)ars_map_valid();
    (void)ars_selftest();
}

static void call_dynamics(void)
{
    const ars_dynamics_state_t state = any_dynamics_state;
    const ars_dynamics_input_t input = any_dynamics_input;

    (void)ars_dynamics_linear(&state, &input);
    (void)ars_dynamics_linear_jacobian(&state, &input);
    (void)ars_dynamics_magic_formula(&state, &input);
    (void)ars_dynamics_magic_formula_jacobian(&state, &input);
}

static void call_can(void)
{
    ars_vehicle_motion_t vehicle_motion = any_vehicle_motion;
    ars_vehicle_conditions_t vehicle_conditions = any_vehicle_conditions;
    ars_rear_steer_command_t rear_steer_command = any_rear_steer_command;

    ars_can_pack_vehicle_motion(&vehicle_motion, frame);
    any_frame();
    ars_can_unpack_vehicle_motion(frame, &vehicle_motion);
    vehicle_conditions.inhibit = any != 0;
    ars_can_pack_vehicle_conditions(&vehicle_conditions, frame);
    any_frame();
    ars_can_unpack_vehicle_conditions(frame, &vehicle_conditions);
    ars_can_pack_rear_steer_command(&rear_steer_command, frame);
    any_frame();
    ars_can_unpack_rear_steer_command(frame, &rear_steer_command);
    (void)ars_can_not_available();
}

static void call_e2e(void)
{
    ars_e2e_receiver_t receiver;
    ars_e2e_supervision_t supervision;
    uint8_t counter = any_byte;

    ars_e2e_receiver_init(&receiver);
    ars_e2e_supervision_init(&supervision);
    while (any != 0) {
        any_frame();
        (void)ars_e2e_crc(any_data_id, frame);
        ars_e2e_protect(any_data_id, &counter, frame);
        any_frame();
        (void)((any != 0) ? ars_e2e_check(&receiver, any_data_id, frame) : ars_e2e_no_new_data(&receiver));
        (void)ars_e2e_supervise(&supervision, any != 0, any != 0);
    }
}

static void call_limiter(void)
{
    const ars_limiter_parameters_t parameters = any_limiter_parameters;
    ars_limiter_t limiter;

    if (ars_limiter_parameters_valid(&parameters)) {
        ars_limiter_init(&limiter, any_number);
        while (any != 0) {
            const ars_limiter_input_t input = any_limiter_input;

            (void)ars_limiter_step(&limiter, &parameters, &input);
        }
    }
}

static void call_controller(void)
{
    const ars_parameters_t parameters = any_parameters;
    ars_controller_t controller;

    if (ars_parameters_valid(&parameters)) {
        ars_controller_init(&controller, any_number);
        while (any != 0) {
            ars_measurement_t measurement = any_measurement;

            measurement.inhibit = any != 0;
            (void)ars_controller_step(&controller, &parameters, &measurement);
            if (any != 0) {
                ars_controller_place(&controller, any_number);
            }
            if (any != 0) {
                (void)ars_controller_stand_by(&controller, &parameters);
            }
        }
    }
}

static void call_task(void)
{
    const ars_parameters_t parameters = any_parameters;
    ars_task_t task;

    if (ars_parameters_valid(&parameters)) {
        ars_task_init(&task, &parameters);
        while (any != 0) {
            any_frame();
            if (any != 0) {
                ars_task_on_can_frame(&task, any_id, frame, any_byte);
            } else {
                (void)ars_task_is_complete(&task);
                (void)ars_task_10ms(&task, frame);
            }
        }
    }
}

int main(void)
{
    switch (any) {
    case 1: call_map(); break;
    case 2: call_dynamics(); break;
    case 3: call_can(); break;
    case 4: call_e2e(); break;
    case 5: call_limiter(); break;
    case 7: call_controller(); break;
    case 8: call_task(); break;
    default: break;
    }
    return 0;
}
