/*
 * Events of the model, such as frames on its bus. fmi3_bus.c has them; an FMU without a bus has fmi3_no_events.c.
 */
#ifndef EVENTS_H
#define EVENTS_H

#include <stdbool.h>

#include "instance.h"

/* Whether the simulator may handle events. */
extern const bool events_supported;

/* Process what the simulator has set since the last event, before a step. */
void events_apply(instance_t *self);

/* Return whether the simulator must handle an event after the step. */
bool events_pending(const instance_t *self);

#endif /* EVENTS_H */
