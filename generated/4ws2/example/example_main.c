/*
 * A minimal ECU project: self-test, initialise, step every 10 ms.
 *
 * The car is a first-order model, so that the example runs without hardware; replace it with your sensors and actuator.
 * Returns 0 if the self-test passes and the last status is TRACKING or LIMITED.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include <math.h>
#include <stdio.h>

#include "ars_controller.h"
#include "ars_sections.h"

ARS_SECTION_STATE static ars_controller_t controller;

int main(void)
{
    const float sampling_time = 0.01f; /* s */
    const float yaw_time_constant = 0.2f; /* s */
    const float yaw_gain = 3.7175996f; /* 1/s, steady yaw rate for each rad of front minus rear angle */
    ars_measurement_t measurement = {
        .speed = 11.666667f, /* m/s, 42 km/h */
        .front_angle = 0.08726646f, /* rad, 5 deg to the left */
        .yaw_rate = 0.0f,
        .rear_angle = 0.0f,
        .friction = (float)NAN, /* no estimate: the map's own */
        .lateral_acceleration = (float)NAN, /* not measured */
        .inhibit = false
    };
    float reference = 0.0f;
    ars_status_t status = ARS_STATUS_STANDBY;
    int sample;

    if (!ars_selftest()) {
        (void)printf("self-test failed\n");
        return 1;
    }
    ars_controller_init(&controller, measurement.rear_angle);
    for (sample = 0; sample < 500; sample++) {
        const ars_command_t command = ars_controller_step(&controller, &ars_parameters_default, &measurement);
        float steady;

        reference = command.yaw_rate_reference;
        status = command.status;
        measurement.rear_angle = command.rear_angle; /* an actuator without lag */
        steady = yaw_gain * (measurement.front_angle - measurement.rear_angle);
        measurement.yaw_rate += (sampling_time / yaw_time_constant) * (steady - measurement.yaw_rate);
    }
    (void)printf("after 5 s: yaw rate %.4f rad/s, reference %.4f rad/s, rear angle %.4f rad, status %d\n",
        (double)measurement.yaw_rate, (double)reference, (double)measurement.rear_angle, (int)status);
    return ((status == ARS_STATUS_TRACKING) || (status == ARS_STATUS_LIMITED)) ? 0 : 1;
}
