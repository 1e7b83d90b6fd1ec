/*
 * One instance of the model: its variables, its time, and the permitted order of calls. Both versions of FMI use it. A function that
 * returns bool returns true on success; on failure it reports the reason and returns false.
 */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "variables.h"

typedef enum { PHASE_INSTANTIATED, PHASE_INITIALIZATION, PHASE_STEPPING, PHASE_EVENT, PHASE_TERMINATED } phase_t;

/* Complete state of a simulation, for saving and restoring. */
typedef struct {
    phase_t phase;
    bool stop_time_defined;
    double start_time; /* s */
    double stop_time; /* s */
    uint64_t steps; /* of the model, since start_time */
    double excess; /* s, since the last step of the model */
    model_t model;
} snapshot_t;

typedef void (*report_t)(void *receiver, const char *text);

typedef struct {
    snapshot_t now; /* present state */
    bool outputs_are_current;
    bool has_event_mode; /* the simulator handles events */
    report_t report; /* never null */
    void *receiver;
} instance_t;

/* Identifies the content of this FMU. */
extern const char instance_token[];

/* Initialise an instance. report is called with receiver and the text of each error. */
void instance_init(instance_t *self, report_t report, void *receiver);

/* Return to the state before the initialization, with the start values of all variables. */
void instance_reset(instance_t *self);

/* Report an error to the simulator; arguments as for printf(). Returns false. */
bool instance_refuse(const instance_t *self, const char *format, ...);

/* Set start and stop time, in s. Possible only before the initialization. */
bool instance_set_times(instance_t *self, double start_time, bool stop_time_defined, double stop_time);

/* Change the phase of the simulation. The end of the initialization also checks the parameters. */
bool instance_enter_initialization(instance_t *self);
bool instance_exit_initialization(instance_t *self);
bool instance_enter_event(instance_t *self);
bool instance_leave_event(instance_t *self);
bool instance_terminate(instance_t *self);

/* Check that lists of value references and of values have the same length and are not null. */
bool instance_check_lists(const instance_t *self, const void *references, size_t count, const void *values, size_t value_count);

/* Check that the model accepts its parameters. */
bool instance_check_parameters(const instance_t *self);

/* Find a variable by its value reference; type must be that of the variable. Returns null after reporting an error. */
const variable_t *instance_find(const instance_t *self, uint32_t reference, variable_type_t type);

/* Get and set one variable by its value reference; type must be that of the variable. A double represents all values of all types. */
bool instance_get(instance_t *self, uint32_t reference, variable_type_t type, double *value);
bool instance_set(instance_t *self, uint32_t reference, variable_type_t type, double value);

/* Simulate from time, which must be the present time, to time + size, in s. After a failure the state is unchanged. */
bool instance_step(instance_t *self, double time, double size);

/* Return the present time, in s. */
double instance_time(const instance_t *self);

/* Convert a snapshot to bytes and back, for another instance of the same FMU on the same kind of machine. */
size_t instance_serialized_size(void);
bool instance_serialize(const instance_t *self, const snapshot_t *snapshot, void *bytes, size_t size);
bool instance_deserialize(const instance_t *self, const void *bytes, size_t size, snapshot_t *snapshot);

#endif /* INSTANCE_H */
