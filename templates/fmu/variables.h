/*
 * Table of the variables of the model. A value reference is an index into it.
 */
#ifndef VARIABLES_H
#define VARIABLES_H

#include <stddef.h>

#include "fmu_config.h"

/* Type of a variable in modelDescription.xml. */
typedef enum { TYPE_REAL, TYPE_INTEGER, TYPE_ENUMERATION, TYPE_BOOLEAN, TYPE_BINARY, TYPE_CLOCK } variable_type_t;

/* Type of the member of model_t; STORED_ELSEWHERE: binary variables and clocks have none. */
typedef enum { STORED_DOUBLE, STORED_FLOAT, STORED_INT32, STORED_UINT16, STORED_BOOL, STORED_ELSEWHERE } storage_t;

typedef enum {
    ROLE_TIME,
    ROLE_INPUT,
    ROLE_OUTPUT,
    ROLE_FIXED, /* a parameter until the initialization ends */
    ROLE_TUNABLE /* a parameter that may change between two steps */
} role_t;

typedef struct {
    const char *name;
    variable_type_t type;
    storage_t storage;
    role_t role;
    size_t offset; /* in model_t */
    double low; /* range of values that can be set, inclusive */
    double high;
} variable_t;

extern const variable_t variables[VARIABLES];

#endif /* VARIABLES_H */
