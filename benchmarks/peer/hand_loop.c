/*
 * See hand_loop.h. Written from the equations, not from the generated C, for speed as well as for reading: one file, so that
 * the compiler sees everything; forces and directions of an axle computed once; the car's numbers constants.
 */
#include "hand_loop.h"

#include <math.h>

static const double step = 0.001; /* s */
static const double pi = 3.14159265358979323846;

static const double mass = 2335.07; /* kg */
static const double yaw_inertia = 5376.432; /* kg m^2 */
static const double cg_height = 0.42; /* m */
static const double track = 1.627; /* m */
static const double front_arm = 1.574; /* m, from the centre of gravity to the front axle */
static const double rear_arm = 1.566; /* m */
static const double front_roll_share = 0.6;
static const double gravity = 9.81; /* m/s^2 */
static const double nominal_friction = 0.9;

static const double front_stiffness = 119540.0; /* N/rad, one tyre at its static load */
static const double rear_stiffness = 119830.0;
static const double shape_factor = 1.3; /* C of the Magic Formula */
static const double curvature_factor = -0.5; /* E */
static const double wheel_speed_min = 0.5; /* m/s */

static const double steering_ratio = 90.0 / 6.75;
static const double steering_lag = 0.005; /* s */
static const double steering_rate_max_deg = 300.0; /* deg/s, at the steering wheel */
static const double rear_angle_max_deg = 3.5;
static const double rear_lag = 0.05; /* s */
static const double rear_rate_max_deg = 30.0; /* deg/s */

typedef struct {
    double force; /* N, of both tyres, across the wheels, to the left */
    double difference; /* N, left minus right */
} axle_forces_t;

static inline double clamp(double value, double limit)
{
    return (value > limit) ? limit : ((value < -limit) ? -limit : value);
}

static inline double at_least(double value, double low)
{
    return (value > low) ? value : low;
}

/* Side force of one tyre in N: against its slip angle (rad), in proportion to its load (N). */
static inline double tyre_force(double stiffness_factor, double slip, double load, double friction)
{
    const double x = stiffness_factor * slip;
    const double shape = sin(shape_factor * atan(x - (curvature_factor * (x - atan(x)))));

    return -friction * load * shape;
}

/* Slip angle of a tyre that rolls at speed (m/s), in either direction. */
static inline double slip_angle(double speed, double lateral_speed, double angle)
{
    return atan(lateral_speed / at_least(fabs(speed), wheel_speed_min)) - (clamp(speed / wheel_speed_min, 1.0) * angle);
}

/* Both tyres of an axle that moves sideways at lateral_speed (m/s) and is steered by angle (rad). */
static inline axle_forces_t axle_forces(
    double stiffness, double static_load, double load_moved, double lateral_speed, double angle, const hand_state_t *state,
    const hand_input_t *input)
{
    const double stiffness_factor = stiffness / (shape_factor * nominal_friction * static_load);
    const double from_yaw = 0.5 * track * state->yaw_rate;
    const double moved = clamp(load_moved, static_load);
    const double slip_left = slip_angle(input->speed - from_yaw, lateral_speed, angle);
    const double slip_right = slip_angle(input->speed + from_yaw, lateral_speed, angle);
    const double left = tyre_force(stiffness_factor, slip_left, static_load - moved, input->friction);
    const double right = tyre_force(stiffness_factor, slip_right, static_load + moved, input->friction);
    const axle_forces_t forces = { left + right, left - right };

    return forces;
}

/* The time derivative of the state; the lateral acceleration (m/s^2) of the centre of gravity comes with it. */
static inline hand_state_t derivative(
    const hand_state_t *state, const hand_input_t *input, double rear_command, double *lateral_acceleration)
{
    const double wheelbase = front_arm + rear_arm;
    const double front_load = mass * gravity * rear_arm / (2.0 * wheelbase);
    const double rear_load = mass * gravity * front_arm / (2.0 * wheelbase);
    const double load_moved = mass * cg_height / track * input->speed * state->yaw_rate;
    const double front_angle = state->steering_wheel_angle / steering_ratio;
    const double degree = pi / 180.0;
    const axle_forces_t front = axle_forces(
        front_stiffness, front_load, front_roll_share * load_moved, state->lateral_speed + (front_arm * state->yaw_rate),
        front_angle, state, input);
    const axle_forces_t rear = axle_forces(
        rear_stiffness, rear_load, (1.0 - front_roll_share) * load_moved, state->lateral_speed - (rear_arm * state->yaw_rate),
        state->rear_angle, state, input);
    const double front_across = front.force * cos(front_angle);
    const double rear_across = rear.force * cos(state->rear_angle);
    const double couple = 0.5 * track * ((front.difference * sin(front_angle)) + (rear.difference * sin(state->rear_angle)));
    const double moment = (front_arm * front_across) - (rear_arm * rear_across) + couple + input->yaw_moment;
    const double cos_heading = cos(state->heading);
    const double sin_heading = sin(state->heading);
    const double rear_error = clamp(rear_command, rear_angle_max_deg * degree) - state->rear_angle;
    const double steering_error = input->steering_wheel_command - state->steering_wheel_angle;
    hand_state_t rate;

    *lateral_acceleration = (front_across + rear_across) / mass;
    rate.lateral_speed = *lateral_acceleration - (input->speed * state->yaw_rate);
    rate.yaw_rate = moment / yaw_inertia;
    rate.steering_wheel_angle = clamp(steering_error / steering_lag, steering_rate_max_deg * degree);
    rate.rear_angle = clamp(rear_error / rear_lag, rear_rate_max_deg * degree);
    rate.position_x = (input->speed * cos_heading) - (state->lateral_speed * sin_heading);
    rate.position_y = (input->speed * sin_heading) + (state->lateral_speed * cos_heading);
    rate.heading = state->yaw_rate;
    return rate;
}

/* state + time * rate */
static inline hand_state_t moved_on(const hand_state_t *state, const hand_state_t *rate, double time)
{
    const hand_state_t result = {
        state->lateral_speed + (time * rate->lateral_speed),
        state->yaw_rate + (time * rate->yaw_rate),
        state->steering_wheel_angle + (time * rate->steering_wheel_angle),
        state->rear_angle + (time * rate->rear_angle),
        state->position_x + (time * rate->position_x),
        state->position_y + (time * rate->position_y),
        state->heading + (time * rate->heading),
    };

    return result;
}

static void runge_kutta_4(hand_state_t *state, const hand_input_t *input, double rear_command)
{
    double unused;
    const hand_state_t k1 = derivative(state, input, rear_command, &unused);
    const hand_state_t at2 = moved_on(state, &k1, 0.5 * step);
    const hand_state_t k2 = derivative(&at2, input, rear_command, &unused);
    const hand_state_t at3 = moved_on(state, &k2, 0.5 * step);
    const hand_state_t k3 = derivative(&at3, input, rear_command, &unused);
    const hand_state_t at4 = moved_on(state, &k3, step);
    const hand_state_t k4 = derivative(&at4, input, rear_command, &unused);

    *state = moved_on(state, &k1, step / 6.0);
    *state = moved_on(state, &k2, step / 3.0);
    *state = moved_on(state, &k3, step / 3.0);
    *state = moved_on(state, &k4, step / 6.0);
}

static ars_command_t control(ars_controller_t *controller, const hand_state_t *state, const hand_input_t *input)
{
    ars_measurement_t measurement;
    double lateral_acceleration;

    (void)derivative(state, input, 0.0, &lateral_acceleration);
    measurement.speed = (float)input->speed;
    measurement.front_angle = (float)(state->steering_wheel_angle / steering_ratio);
    measurement.yaw_rate = (float)state->yaw_rate;
    measurement.rear_angle = (float)state->rear_angle;
    measurement.friction = (float)input->friction_estimate;
    measurement.lateral_acceleration = (float)lateral_acceleration;
    measurement.inhibit = (input->inhibit > 0.0) || (input->inhibit < 0.0);
    return ars_controller_step(controller, &ars_parameters_default, &measurement);
}

static void record_sample(
    const hand_state_t *state, const hand_input_t *input, const ars_command_t *command, double time, hand_record_t *record)
{
    const double forward = at_least(fabs(input->speed), wheel_speed_min);
    const double front_angle = state->steering_wheel_angle / steering_ratio;

    (void)derivative(state, input, 0.0, &record->lateral_acceleration);
    record->time = time;
    record->speed = input->speed;
    record->front_angle = front_angle;
    record->yaw_rate = state->yaw_rate;
    record->yaw_rate_reference = (double)command->yaw_rate_reference;
    record->sideslip_angle = atan(state->lateral_speed / forward);
    record->rear_angle_command = (double)command->rear_angle;
    record->rear_angle = state->rear_angle;
    record->slip_front = slip_angle(input->speed, state->lateral_speed + (front_arm * state->yaw_rate), front_angle);
    record->slip_rear = slip_angle(input->speed, state->lateral_speed - (rear_arm * state->yaw_rate), state->rear_angle);
    record->status = (double)command->status;
}

void hand_run(hand_state_t *state, uint32_t samples, const hand_input_t *inputs, hand_record_t *records)
{
    hand_state_t now = *state;
    ars_controller_t controller;
    uint32_t sample;
    uint32_t k;

    ars_controller_init(&controller, 0.0f);
    for (sample = 0u; sample < samples; sample++) {
        const hand_input_t *input = &inputs[sample * HAND_STEPS_PER_SAMPLE];
        const ars_command_t command = control(&controller, &now, input);

        record_sample(&now, input, &command, step * (double)(sample * HAND_STEPS_PER_SAMPLE), &records[sample]);
        for (k = 0u; k < HAND_STEPS_PER_SAMPLE; k++) {
            runge_kutta_4(&now, &input[k], (double)command.rear_angle);
        }
    }
    *state = now;
}
