/*
 * One instance of the model. See instance.h.
 */
#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum { TEXT_SIZE = 256 };

/* Tolerance of times, as a fraction of a step, for rounding in the simulator. */
static const double time_tolerance = 1e-3;

static const double steps_max = 1e15; /* larger counts are not exact in a double */

const char instance_token[] = FMU_TOKEN;

void instance_init(instance_t *self, report_t report, void *receiver)
{
    memset(self, 0, sizeof(*self));
    self->report = report;
    self->receiver = receiver;
    instance_reset(self);
}

void instance_reset(instance_t *self)
{
    memset(&self->now, 0, sizeof(self->now));
    self->now.phase = PHASE_INSTANTIATED;
    model_init(&self->now.model);
    self->outputs_are_current = false;
}

bool instance_refuse(const instance_t *self, const char *format, ...)
{
    char text[TEXT_SIZE];
    va_list arguments;

    va_start(arguments, format);
    (void)vsnprintf(text, sizeof(text), format, arguments);
    va_end(arguments);
    self->report(self->receiver, text);
    return false;
}

double instance_time(const instance_t *self)
{
    return self->now.start_time + (model_step_size * (double)self->now.steps) + self->now.excess;
}

bool instance_set_times(instance_t *self, double start_time, bool stop_time_defined, double stop_time)
{
    if (self->now.phase != PHASE_INSTANTIATED) {
        return instance_refuse(self, "the start time can only be set before the initialization");
    }
    if (!isfinite(start_time)) {
        return instance_refuse(self, "the start time is not a number");
    }
    if (stop_time_defined && !(stop_time >= start_time)) {
        return instance_refuse(self, "the stop time is not after the start time");
    }
    self->now.start_time = start_time;
    self->now.stop_time_defined = stop_time_defined;
    self->now.stop_time = stop_time_defined ? stop_time : 0.0;
    return true;
}

bool instance_enter_initialization(instance_t *self)
{
    if (self->now.phase != PHASE_INSTANTIATED) {
        return instance_refuse(self, "the initialization has been entered already; reset first");
    }
    self->now.phase = PHASE_INITIALIZATION;
    return true;
}

/* ---- variables ---- */

static double read_value(const model_t *model, const variable_t *variable)
{
    const void *place = (const char *)model + variable->offset;
    double value = 0.0;

    switch (variable->storage) {
    case STORED_DOUBLE:
        value = *(const double *)place;
        break;
    case STORED_FLOAT:
        value = (double)*(const float *)place;
        break;
    case STORED_INT32:
        value = (double)*(const int32_t *)place;
        break;
    case STORED_UINT16:
        value = (double)*(const uint16_t *)place;
        break;
    case STORED_BOOL:
        value = *(const bool *)place ? 1.0 : 0.0;
        break;
    case STORED_ELSEWHERE:
    default:
        break;
    }
    return value;
}

/* value must be in the range of the variable. */
static void write_value(model_t *model, const variable_t *variable, double value)
{
    void *place = (char *)model + variable->offset;

    switch (variable->storage) {
    case STORED_DOUBLE:
        *(double *)place = value;
        break;
    case STORED_FLOAT:
        *(float *)place = (float)value;
        break;
    case STORED_INT32:
        *(int32_t *)place = (int32_t)value;
        break;
    case STORED_UINT16:
        *(uint16_t *)place = (uint16_t)value;
        break;
    case STORED_BOOL:
        *(bool *)place = (value > 0.0) || (value < 0.0);
        break;
    case STORED_ELSEWHERE:
    default:
        break;
    }
}

const variable_t *instance_find(const instance_t *self, uint32_t reference, variable_type_t type)
{
    if (reference >= (uint32_t)VARIABLES) {
        (void)instance_refuse(self, "there is no variable with the value reference %lu", (unsigned long)reference);
        return NULL;
    }
    if (variables[reference].type != type) {
        (void)instance_refuse(self, "%s is of another type", variables[reference].name);
        return NULL;
    }
    return &variables[reference];
}

bool instance_check_lists(const instance_t *self, const void *references, size_t count, const void *values, size_t value_count)
{
    if (count != value_count) {
        return instance_refuse(
            self, "%lu value references and %lu values", (unsigned long)count, (unsigned long)value_count);
    }
    if ((count > 0u) && ((references == NULL) || (values == NULL))) {
        return instance_refuse(self, "a null pointer in place of value references or values");
    }
    return true;
}

bool instance_get(instance_t *self, uint32_t reference, variable_type_t type, double *value)
{
    const variable_t *variable = instance_find(self, reference, type);

    if (variable == NULL) {
        return false;
    }
    if (variable->role == ROLE_TIME) {
        *value = instance_time(self);
        return true;
    }
    if ((variable->role == ROLE_OUTPUT) && !self->outputs_are_current) {
        model_update(&self->now.model);
        self->outputs_are_current = true;
    }
    *value = read_value(&self->now.model, variable);
    return true;
}

bool instance_set(instance_t *self, uint32_t reference, variable_type_t type, double value)
{
    const variable_t *variable = instance_find(self, reference, type);
    const bool started = self->now.phase >= PHASE_STEPPING;

    if (variable == NULL) {
        return false;
    }
    if ((variable->role == ROLE_TIME) || (variable->role == ROLE_OUTPUT)) {
        return instance_refuse(self, "%s cannot be set, it is computed", variable->name);
    }
    if ((variable->role == ROLE_FIXED) && started) {
        return instance_refuse(self, "%s cannot be set after the initialization", variable->name);
    }
    if (self->now.phase == PHASE_TERMINATED) {
        return instance_refuse(self, "%s cannot be set, the simulation has ended", variable->name);
    }
    if (!((value >= variable->low) && (value <= variable->high))) {
        return instance_refuse(
            self, "%s = %.9g is not a number from %.9g to %.9g", variable->name, value, variable->low, variable->high);
    }
    write_value(&self->now.model, variable, value);
    self->outputs_are_current = false;
    return true;
}

/* ---- parameters that the model refuses ---- */

static bool is_changed(const model_t *model, const model_t *built, const variable_t *variable)
{
    const double value = read_value(model, variable);
    const double start = read_value(built, variable);

    return (variable->role == ROLE_TUNABLE) && ((value > start) || (value < start));
}

/* Return whether the model is ready with one parameter changed to value. */
static bool is_ready_with(const model_t *model, const variable_t *variable, double value)
{
    model_t tried = *model;

    write_value(&tried, variable, value);
    return model_is_ready(&tried);
}

/* Find the parameter that makes a set invalid: the one whose value at build would make the set valid; otherwise the first one that is
 * invalid on its own; otherwise the first changed one. Null if none was changed. */
static const variable_t *culprit(const model_t *model, const model_t *built)
{
    const variable_t *first = NULL;
    const variable_t *alone = NULL;
    size_t k;

    for (k = 0u; k < (size_t)VARIABLES; k++) {
        const variable_t *variable = &variables[k];

        if (is_changed(model, built, variable)) {
            if (is_ready_with(model, variable, read_value(built, variable))) {
                return variable;
            }
            if ((alone == NULL) && !is_ready_with(built, variable, read_value(model, variable))) {
                alone = variable;
            }
            if (first == NULL) {
                first = variable;
            }
        }
    }
    return (alone != NULL) ? alone : first;
}

bool instance_check_parameters(const instance_t *self)
{
    const variable_t *variable;
    model_t built;

    if (model_is_ready(&self->now.model)) {
        return true;
    }
    model_init(&built);
    variable = culprit(&self->now.model, &built);
    if (variable == NULL) {
        return instance_refuse(self, "the parameters of the build are not valid");
    }
    return instance_refuse(
        self, "the parameters are not valid: %s = %.9g is out of range or does not go with the others", variable->name,
        read_value(&self->now.model, variable));
}

/* ---- time ---- */

bool instance_exit_initialization(instance_t *self)
{
    if (self->now.phase != PHASE_INITIALIZATION) {
        return instance_refuse(self, "there is no initialization to leave");
    }
    if (!instance_check_parameters(self)) {
        return false;
    }
    model_start(&self->now.model);
    self->now.phase = self->has_event_mode ? PHASE_EVENT : PHASE_STEPPING;
    self->outputs_are_current = false;
    return true;
}

bool instance_enter_event(instance_t *self)
{
    if (!self->has_event_mode || (self->now.phase != PHASE_STEPPING)) {
        return instance_refuse(self, "events can only be handled between two steps, and if the simulator announced it");
    }
    self->now.phase = PHASE_EVENT;
    return true;
}

bool instance_leave_event(instance_t *self)
{
    if (self->now.phase != PHASE_EVENT) {
        return instance_refuse(self, "there is no event to leave");
    }
    self->now.phase = PHASE_STEPPING;
    return true;
}

bool instance_terminate(instance_t *self)
{
    if ((self->now.phase != PHASE_STEPPING) && (self->now.phase != PHASE_EVENT)) {
        return instance_refuse(self, "there is no simulation to end");
    }
    self->now.phase = PHASE_TERMINATED;
    return true;
}

static bool is_finite(const model_t *model)
{
    bool finite = true;
    size_t k;

    for (k = 0u; k < (size_t)VARIABLES; k++) {
        finite = finite && ((variables[k].role != ROLE_OUTPUT) || isfinite(read_value(model, &variables[k])));
    }
    return finite;
}

/* Steps of the model in a communication step, and the rest of it. */
typedef struct {
    uint64_t count;
    double excess; /* s */
} plan_t;

/* Divide a communication step into steps of the model. */
static bool plan_step(const instance_t *self, double size, plan_t *plan)
{
    const double tolerance = time_tolerance * model_step_size;
    const double total = self->now.excess + size;
    const double count = floor((total + tolerance) / model_step_size);
    const double rest = total - (count * model_step_size);
    const bool is_whole = (rest <= tolerance) && (count >= 1.0);

    if (!((size > 0.0) && (count <= steps_max) && (is_whole || (FMU_ANY_STEP_SIZE != 0)))) {
        return instance_refuse(self, (FMU_ANY_STEP_SIZE != 0) ? "a step of %.9g s is not possible"
                                                               : "a step of %.9g s is no whole multiple of %.9g s", size, model_step_size);
    }
    plan->count = (uint64_t)count;
    plan->excess = (rest > tolerance) ? rest : 0.0;
    return true;
}

/* Check a communication step against phase, present time and stop time. */
static bool check_step(const instance_t *self, double time, double size)
{
    const double reached = instance_time(self);
    const double tolerance = time_tolerance * model_step_size;

    if (self->now.phase == PHASE_EVENT) {
        return instance_refuse(self, "no step can be done while an event is handled");
    }
    if (self->now.phase != PHASE_STEPPING) {
        return instance_refuse(self, "no step can be done before the initialization has ended or after the simulation has");
    }
    if (!(fabs(time - reached) <= tolerance)) {
        return instance_refuse(self, "the step begins at %.9g s, and the time is %.9g s", time, reached);
    }
    if (self->now.stop_time_defined && ((reached + size) > (self->now.stop_time + tolerance))) {
        return instance_refuse(self, "the step ends at %.9g s, after the stop time %.9g s", reached + size, self->now.stop_time);
    }
    return true;
}

bool instance_step(instance_t *self, double time, double size)
{
    plan_t plan = { 0u, 0.0 };
    bool is_begun = self->now.excess > 0.0;
    model_t next = self->now.model;
    uint64_t k;

    if (!check_step(self, time, size) || !plan_step(self, size, &plan) || !instance_check_parameters(self)) {
        return false;
    }
    for (k = 0u; k < plan.count; k++) {
        if (!is_begun) {
            model_hold(&next);
        }
        model_step(&next);
        is_begun = false;
    }
    if ((plan.excess > 0.0) && !is_begun) {
        model_hold(&next);
    }
    model_update(&next);
    if (!is_finite(&next)) {
        return instance_refuse(self, "the motion from %.9g s on is not finite with these inputs", instance_time(self));
    }
    self->now.model = next;
    self->now.steps += plan.count;
    self->now.excess = plan.excess;
    self->outputs_are_current = true;
    return true;
}

/* ---- snapshots as bytes ---- */

typedef struct {
    char token[sizeof(instance_token)];
    uint64_t size;
    double one; /* differs on a machine with another format of doubles */
    uint64_t checksum;
} header_t;

/* FNV-1a, 64 bits. It detects damage; it does not protect against manipulation. */
static uint64_t checksum_of(const void *bytes, size_t size)
{
    const unsigned char *byte = bytes;
    uint64_t sum = UINT64_C(0xCBF29CE484222325);
    size_t k;

    for (k = 0u; k < size; k++) {
        sum = (sum ^ byte[k]) * UINT64_C(0x100000001B3);
    }
    return sum;
}

static void make_header(header_t *header, const void *content)
{
    memset(header, 0, sizeof(*header));
    memcpy(header->token, instance_token, sizeof(instance_token));
    header->size = sizeof(snapshot_t);
    header->one = 1.0;
    header->checksum = checksum_of(content, sizeof(snapshot_t));
}

size_t instance_serialized_size(void)
{
    return sizeof(header_t) + sizeof(snapshot_t);
}

bool instance_serialize(const instance_t *self, const snapshot_t *snapshot, void *bytes, size_t size)
{
    header_t header;

    if ((snapshot == NULL) || (bytes == NULL)) {
        return instance_refuse(self, "a null pointer in place of a state or of its bytes");
    }
    if (size < instance_serialized_size()) {
        return instance_refuse(self, "a state needs %lu bytes, and there are %lu", (unsigned long)instance_serialized_size(),
            (unsigned long)size);
    }
    make_header(&header, snapshot);
    memcpy(bytes, &header, sizeof(header));
    memcpy((char *)bytes + sizeof(header), snapshot, sizeof(*snapshot));
    return true;
}

bool instance_deserialize(const instance_t *self, const void *bytes, size_t size, snapshot_t *snapshot)
{
    header_t expected;

    if (bytes == NULL) {
        return instance_refuse(self, "a null pointer in place of the bytes of a state");
    }
    if (size != instance_serialized_size()) {
        return instance_refuse(self, "the bytes are no state of this FMU: %lu in place of %lu", (unsigned long)size,
            (unsigned long)instance_serialized_size());
    }
    make_header(&expected, (const char *)bytes + sizeof(expected));
    if (memcmp(bytes, &expected, sizeof(expected)) != 0) {
        return instance_refuse(self, "the bytes are no state of this FMU, or are damaged");
    }
    memcpy(snapshot, (const char *)bytes + sizeof(expected), sizeof(*snapshot));
    return true;
}
