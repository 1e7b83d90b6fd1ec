/*
 * One instance of the model as a simulator sees it: its variables, its time, and what may be called when. Both versions of FMI
 * stand on it. Every function returns true, or false after telling why.
 */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "variables.h"

typedef enum { PHASE_INSTANTIATED, PHASE_INITIALIZATION, PHASE_STEPPING, PHASE_TERMINATED } phase_t;

/* All that a simulation depends on: what is saved and restored. */
typedef struct {
    phase_t phase;
    bool stop_time_defined;
    double start_time; /* s */
    double stop_time; /* s */
    uint64_t steps; /* of the model, since start_time */
    model_t model;
} snapshot_t;

typedef void (*report_t)(void *receiver, const char *text);

typedef struct {
    snapshot_t now;
    bool outputs_are_current;
    report_t report; /* never null */
    void *receiver;
} instance_t;

/* Of the content of this FMU. */
extern const char instance_token[];

void instance_init(instance_t *self, report_t report, void *receiver);
void instance_reset(instance_t *self);

/* Tell the simulator something; as printf. Returns false. */
bool instance_refuse(const instance_t *self, const char *format, ...);

bool instance_set_times(instance_t *self, double start_time, bool stop_time_defined, double stop_time);
bool instance_enter_initialization(instance_t *self);
bool instance_exit_initialization(instance_t *self);
bool instance_terminate(instance_t *self);

/* Whether a list of value references and one of values can be read. */
bool instance_check_lists(const instance_t *self, const void *references, size_t count, const void *values, size_t value_count);

/* One variable by its value reference; type must be its own. Every value of every type is exact in a double. */
bool instance_get(instance_t *self, uint32_t reference, variable_type_t type, double *value);
bool instance_set(instance_t *self, uint32_t reference, variable_type_t type, double value);

/* From time, which must be the one that was reached, to time + size. Where it fails, nothing has moved. */
bool instance_step(instance_t *self, double time, double size);

/* s, as reached */
double instance_time(const instance_t *self);

/* A snapshot as bytes, for another instance of the same FMU on the same kind of machine. */
size_t instance_serialized_size(void);
bool instance_serialize(const instance_t *self, const snapshot_t *snapshot, void *bytes, size_t size);
bool instance_deserialize(const instance_t *self, const void *bytes, size_t size, snapshot_t *snapshot);

#endif /* INSTANCE_H */
