/*
 * The simulated car alone. See model.h and plant.h.
 */
#include "fmu_config.h"
#include "model.h"

#include <string.h>

static plant_input_t plant_input_of(const model_t *self)
{
    plant_input_t input;

    input.speed = self->speed;
    input.steering_wheel_command = self->steering_wheel_command;
    input.rear_angle_command = self->rear_angle_command;
    input.friction = self->friction;
    input.yaw_moment = self->yaw_moment;
    input.lateral_force = 0.0;
    return input;
}

void model_init(model_t *self)
{
    memset(self, 0, sizeof(*self));
    MODEL_START_VALUES(self);
}

/* There are no parameters. */
bool model_is_ready(const model_t *self)
{
    (void)self;
    return true;
}

/* The car starts straight ahead. */
void model_start(model_t *self)
{
    (void)self;
}

void model_update(model_t *self)
{
    const plant_input_t input = plant_input_of(self);

    plant_output(&self->plant, &input, &self->output);
}

/* The inputs do not change within a step. */
void model_hold(model_t *self)
{
    (void)self;
}

void model_step(model_t *self)
{
    const plant_input_t input = plant_input_of(self);

    plant_step(&self->plant, &input, model_step_size);
}
