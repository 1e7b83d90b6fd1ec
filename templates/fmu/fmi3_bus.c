/*
 * FMI 3.0: binary variables, clocks and events of an FMU with one CAN bus by FMI-LS-BUS. See fmi3.c, events.h and can_node.h.
 *
 * Operations that the simulator does not read stay in the buffer and are announced again after the next step. The receive clock may also
 * tick between two events, which the standard does not provide for: the SIL Kit FMU Importer sets received frames before a step without an
 * event. They are processed at the beginning of that step, as if in an event at that time.
 *
 * A model may have one periodic clock, with the value reference PERIODIC_CLOCK; without one, no variable has this value reference. The model
 * runs what it clocks at once, so that operations that were received in the same event count afterwards.
 */
#include <string.h>

#include "events.h"
#include "fmi3Functions.h"
#include "instance.h"

const bool events_supported = true;

/* An instance of fmi3.c begins with this part of it. */
static can_node_t *node_of(instance_t *self)
{
    return &self->now.model.node;
}

static fmi3Status status_of(bool good)
{
    return good ? fmi3OK : fmi3Error;
}

bool events_pending(const instance_t *self)
{
    const can_node_t *node = &self->now.model.node;

    return node->frames_are_due || (node->transmit.size > 0u);
}

static bool is_in_event(const instance_t *self)
{
    return self->now.phase == PHASE_EVENT;
}

/* Let the model pass its frames to the node. */
static void send_frames(instance_t *self)
{
    if (node_of(self)->frames_are_due) {
        node_of(self)->frames_are_due = false;
        model_send(&self->now.model);
    }
}

static void on_frame(void *owner, uint32_t id, const uint8_t *data, uint8_t length)
{
    model_on_frame(owner, id, data, length);
}

static void process_received(instance_t *self)
{
    can_node_t *node = node_of(self);

    if (node->receive_clock) {
        can_node_process(node, on_frame, &self->now.model);
    }
    node->receive.size = 0u;
    node->received_from = 0u;
    node->receive_clock = false;
}

void events_apply(instance_t *self)
{
    if ((self->now.phase == PHASE_STEPPING) && node_of(self)->receive_clock) {
        process_received(self);
        self->outputs_are_current = false;
    }
}

/* ---- binary variables ---- */

fmi3Status fmi3GetBinary(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, size_t valueSizes[],
    fmi3Binary values[], size_t nValues)
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, values, nValues)
        && instance_check_lists(self, valueReferences, nValueReferences, valueSizes, nValues);
    size_t k;

    for (k = 0u; good && (k < nValues); k++) {
        const variable_t *variable = instance_find(self, valueReferences[k], TYPE_BINARY);

        good = variable != NULL;
        if (good && (variable->role == ROLE_INPUT)) {
            values[k] = node_of(self)->receive.bytes;
            valueSizes[k] = node_of(self)->receive.size;
        } else if (good && is_in_event(self)) {
            send_frames(self);
            node_of(self)->read_size = node_of(self)->transmit.size;
            values[k] = node_of(self)->transmit.bytes;
            valueSizes[k] = node_of(self)->transmit.size;
        } else if (good) { /* its clock does not tick */
            values[k] = node_of(self)->transmit.bytes;
            valueSizes[k] = 0u;
        } else {
            /* reported */
        }
    }
    return status_of(good);
}

static bool set_operations(instance_t *self, fmi3ValueReference reference, fmi3Binary bytes, size_t size)
{
    const variable_t *variable = instance_find(self, reference, TYPE_BINARY);

    if (variable == NULL) {
        return false;
    }
    if (variable->role != ROLE_INPUT) {
        return instance_refuse(self, "%s cannot be set, it is computed", variable->name);
    }
    if ((size > 0u) && (bytes == NULL)) {
        return instance_refuse(self, "a null pointer in place of the bytes of %s", variable->name);
    }
    if (!can_node_receive(node_of(self), bytes, size)) {
        return instance_refuse(
            self, "%s has room for %d bytes in an event, not for %lu more", variable->name, (int)CAN_BUFFER_SIZE, (unsigned long)size);
    }
    return true;
}

fmi3Status fmi3SetBinary(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, const size_t valueSizes[],
    const fmi3Binary values[], size_t nValues)
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, values, nValues)
        && instance_check_lists(self, valueReferences, nValueReferences, valueSizes, nValues);
    size_t k;

    for (k = 0u; good && (k < nValues); k++) {
        good = set_operations(self, valueReferences[k], values[k], valueSizes[k]);
    }
    return status_of(good);
}

/* ---- clocks ---- */

fmi3Status fmi3GetClock(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Clock values[])
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, values, nValueReferences);
    size_t k;

    for (k = 0u; good && (k < nValueReferences); k++) {
        const variable_t *variable = instance_find(self, valueReferences[k], TYPE_CLOCK);

        good = variable != NULL;
        if (good && (valueReferences[k] == (fmi3ValueReference)PERIODIC_CLOCK)) {
            values[k] = node_of(self)->periodic_clock;
        } else if (good && (variable->role == ROLE_INPUT)) {
            values[k] = node_of(self)->receive_clock;
        } else if (good) {
            values[k] = is_in_event(self) && events_pending(self) && !node_of(self)->is_announced;
            node_of(self)->is_announced = node_of(self)->is_announced || values[k];
        } else {
            /* reported */
        }
    }
    return status_of(good);
}

static bool may_tick(const instance_t *self)
{
    return is_in_event(self) || (self->has_event_mode && (self->now.phase == PHASE_STEPPING));
}

/* Set the periodic clock. It ticks once in an event, however often it is set. */
static bool set_periodic_clock(instance_t *self, const char *name, bool value)
{
    bool *ticks = &node_of(self)->periodic_clock;

    if (value == *ticks) {
        return true;
    }
    if (!value) {
        return instance_refuse(self, "%s cannot be deactivated", name);
    }
    if (!is_in_event(self)) {
        return instance_refuse(self, "%s can only tick in an event", name);
    }
    if (!instance_check_parameters(self)) {
        return false;
    }
    if (!model_tick(&self->now.model)) {
        return instance_refuse(self, "%s cannot tick again within %.9g s", name, periodic_clock_interval);
    }
    *ticks = true;
    self->outputs_are_current = false;
    return true;
}

static bool set_clock(instance_t *self, fmi3ValueReference reference, bool value)
{
    const variable_t *variable = instance_find(self, reference, TYPE_CLOCK);

    if (variable == NULL) {
        return false;
    }
    if (variable->role != ROLE_INPUT) {
        return instance_refuse(self, "%s cannot be set, it is computed", variable->name);
    }
    if (reference == (fmi3ValueReference)PERIODIC_CLOCK) {
        return set_periodic_clock(self, variable->name, value);
    }
    if (value && !may_tick(self)) {
        return instance_refuse(self, "%s can only tick after the initialization, in a simulator that handles events", variable->name);
    }
    node_of(self)->receive_clock = value;
    return true;
}

fmi3Status fmi3SetClock(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, const fmi3Clock values[])
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, values, nValueReferences);
    size_t k;

    for (k = 0u; good && (k < nValueReferences); k++) {
        good = set_clock(self, valueReferences[k], values[k]);
    }
    return status_of(good);
}

/* Return whether a variable is the periodic clock. */
static bool is_periodic(const instance_t *self, fmi3ValueReference reference)
{
    const variable_t *variable = instance_find(self, reference, TYPE_CLOCK);

    return (variable != NULL)
        && ((reference == (fmi3ValueReference)PERIODIC_CLOCK) || instance_refuse(self, "%s has no interval", variable->name));
}

fmi3Status fmi3GetIntervalDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64 intervals[],
    fmi3IntervalQualifier qualifiers[])
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, intervals, nValueReferences)
        && instance_check_lists(self, valueReferences, nValueReferences, qualifiers, nValueReferences);
    size_t k;

    for (k = 0u; good && (k < nValueReferences); k++) {
        good = is_periodic(self, valueReferences[k]);
        if (good) {
            intervals[k] = periodic_clock_interval;
            qualifiers[k] = fmi3IntervalUnchanged;
        }
    }
    return status_of(good);
}

fmi3Status fmi3GetShiftDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64 shifts[])
{
    instance_t *self = instance;
    bool good = (self != NULL) && instance_check_lists(self, valueReferences, nValueReferences, shifts, nValueReferences);
    size_t k;

    for (k = 0u; good && (k < nValueReferences); k++) {
        good = is_periodic(self, valueReferences[k]);
        if (good) {
            shifts[k] = periodic_clock_shift;
        }
    }
    return status_of(good);
}

/* ---- events ---- */

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return status_of((instance != NULL) && instance_enter_event(instance));
}

fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
    fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    instance_t *self = instance;
    can_node_t *node;

    if (self == NULL) {
        return fmi3Error;
    }
    if ((discreteStatesNeedUpdate == NULL) || (terminateSimulation == NULL) || (nominalsOfContinuousStatesChanged == NULL)
        || (valuesOfContinuousStatesChanged == NULL) || (nextEventTimeDefined == NULL) || (nextEventTime == NULL)) {
        return status_of(instance_refuse(self, "a null pointer in place of what an event answers"));
    }
    if (!is_in_event(self)) {
        return status_of(instance_refuse(self, "there is no event to update states in"));
    }
    *discreteStatesNeedUpdate = false;
    *terminateSimulation = false;
    *nominalsOfContinuousStatesChanged = false;
    *valuesOfContinuousStatesChanged = false;
    *nextEventTimeDefined = false;
    *nextEventTime = 0.0;
    node = node_of(self);
    send_frames(self);
    node->transmit.size -= node->read_size;
    memmove(node->transmit.bytes, &node->transmit.bytes[node->read_size], node->transmit.size); /* added after the reading */
    node->read_size = 0u;
    process_received(self);
    node->is_announced = false;
    node->periodic_clock = false;
    self->outputs_are_current = false;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return status_of((instance != NULL) && instance_leave_event(instance));
}
