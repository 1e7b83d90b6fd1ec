/*
 * The closed loop as one writes it by hand: the paper's car on two tracks, integrated with RK4, around the generated
 * controller. The peer that the generated loop is measured against; see hand_loop.c.
 */
#ifndef HAND_LOOP_H
#define HAND_LOOP_H

#include <stdint.h>

#include "ars_controller.h"

typedef struct {
    double lateral_speed; /* m/s, of the centre of gravity, to the left */
    double yaw_rate; /* rad/s */
    double steering_wheel_angle; /* rad */
    double rear_angle; /* rad */
    double position_x; /* m */
    double position_y; /* m */
    double heading; /* rad */
} hand_state_t;

/* One row for each millisecond. */
typedef struct {
    double speed; /* m/s */
    double steering_wheel_command; /* rad */
    double friction; /* of the road */
    double friction_estimate; /* for the controller; NaN: none */
    double yaw_moment; /* N m, from outside */
    double inhibit; /* not zero: ESC or ABS is acting */
    double longitudinal_acceleration; /* m/s^2; not read */
} hand_input_t;

/* One row for each 10 ms. */
typedef struct {
    double time; /* s */
    double speed; /* m/s */
    double front_angle; /* rad, road wheel */
    double yaw_rate; /* rad/s */
    double yaw_rate_reference; /* rad/s */
    double sideslip_angle; /* rad */
    double lateral_acceleration; /* m/s^2 */
    double rear_angle_command; /* rad */
    double rear_angle; /* rad */
    double slip_front; /* rad */
    double slip_rear; /* rad */
    double status;
} hand_record_t;

enum { HAND_STEPS_PER_SAMPLE = 10 };

/* Goes on from state, with a controller that starts afresh: samples rows of records, HAND_STEPS_PER_SAMPLE times as many
 * rows of inputs. */
void hand_run(hand_state_t *state, uint32_t samples, const hand_input_t *inputs, hand_record_t *records);

#endif /* HAND_LOOP_H */
