/*
 * FMI 3.0, co-simulation: the functions of the standard, based on instance.h. Functions of unsupported features are in
 * fmi3_unsupported.c.
 */
#include <stdlib.h>
#include <string.h>

#include "events.h"
#include "fmi3Functions.h"
#include "instance.h"

static const char error_category[] = "logStatusError";

typedef struct {
    instance_t instance; /* first: fmi3_unsupported.c knows only this */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log_message;
    bool logging;
} component_t;

static component_t only;
static bool only_is_used;

/* Return a zeroed instance, or null: no memory, or there is one already. */
static component_t *allocate(void)
{
    if (FMU_SINGLE_INSTANCE == 0) {
        return calloc(1u, sizeof(component_t));
    }
    if (only_is_used) {
        return NULL;
    }
    memset(&only, 0, sizeof(only));
    only_is_used = true;
    return &only;
}

static void release(component_t *component)
{
    if (component == &only) {
        only_is_used = false;
    } else {
        free(component);
    }
}

/* The standard allows no messages while logging is off. */
static void report(void *receiver, const char *text)
{
    const component_t *component = receiver;

    if (component->logging && (component->log_message != NULL)) {
        component->log_message(component->environment, fmi3Error, error_category, text);
    }
}

static fmi3Status status_of(bool good)
{
    return good ? fmi3OK : fmi3Error;
}

static fmi3Status refuse(fmi3Instance instance, const char *text)
{
    const component_t *component = instance;

    return (component == NULL) ? fmi3Error : status_of(instance_refuse(&component->instance, "%s", text));
}

/* ---- life ---- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Reason why an instance cannot be made, or null. */
static const char *obstacle(fmi3String name, fmi3String token, bool event_mode, size_t intermediate)
{
    const char *text = NULL;

    if ((name == NULL) || (name[0] == '\0')) {
        text = "an instance needs a name";
    } else if ((token == NULL) || (strcmp(token, instance_token) != 0)) {
        text = "the instantiation token is not that of this binary: modelDescription.xml and the binary are of different FMUs";
    } else if (event_mode && !events_supported) {
        text = "there is no event mode";
    } else if (intermediate > 0u) {
        text = "there are no intermediate variables";
    } else {
        /* none */
    }
    return text;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
    fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3IntermediateUpdateCallback intermediateUpdate)
{
    component_t *component = allocate();
    const char *text;

    (void)resourcePath;
    (void)visible;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)intermediateUpdate;
    if (component == NULL) {
        if (loggingOn && (logMessage != NULL)) {
            logMessage(instanceEnvironment, fmi3Error, error_category,
                (FMU_SINGLE_INSTANCE != 0) ? "only one instance is possible in a process" : "out of memory");
        }
        return NULL;
    }
    component->environment = instanceEnvironment;
    component->log_message = logMessage;
    component->logging = loggingOn;
    text = obstacle(instanceName, instantiationToken, eventModeUsed, nRequiredIntermediateVariables);
    if (text != NULL) {
        report(component, text);
        release(component);
        return NULL;
    }
    instance_init(&component->instance, report, component);
    component->instance.has_event_mode = eventModeUsed;
    return component;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    release(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[])
{
    component_t *component = instance;
    bool good = component != NULL;
    size_t k;

    good = good && instance_check_lists(&component->instance, categories, nCategories, categories, nCategories);
    for (k = 0u; good && (k < nCategories); k++) {
        if ((categories[k] == NULL) || (strcmp(categories[k], error_category) != 0)) {
            good = instance_refuse(&component->instance, "the only category of messages is %s", error_category);
        }
    }
    if (good) {
        component->logging = loggingOn;
    }
    return status_of(good);
}

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance, fmi3Float64 startTime,
    fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    component_t *component = instance;

    (void)toleranceDefined;
    (void)tolerance;
    return status_of(
        (component != NULL) && instance_set_times(&component->instance, startTime, stopTimeDefined, stopTime)
        && instance_enter_initialization(&component->instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    component_t *component = instance;

    return status_of((component != NULL) && instance_exit_initialization(&component->instance));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    component_t *component = instance;

    return status_of((component != NULL) && instance_terminate(&component->instance));
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    component_t *component = instance;

    if (component == NULL) {
        return fmi3Error;
    }
    instance_reset(&component->instance);
    return fmi3OK;
}

/* ---- variables ---- */

/* Define fmi3Get<Name> and fmi3Set<Name>. TYPE: of the variables; AS_DOUBLE: values[k] as a double; AS_VALUE: number as that type. */
#define DEFINE_ACCESS(NAME, TYPE, AS_DOUBLE, AS_VALUE)                                                                        \
    fmi3Status fmi3Get##NAME(                                                                                                 \
        fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3##NAME values[],      \
        size_t nValues)                                                                                                       \
    {                                                                                                                         \
        component_t *component = instance;                                                                                    \
        bool good = (component != NULL)                                                                                       \
            && instance_check_lists(&component->instance, valueReferences, nValueReferences, values, nValues);                \
        size_t k;                                                                                                             \
                                                                                                                              \
        for (k = 0u; good && (k < nValues); k++) {                                                                            \
            double number;                                                                                                    \
                                                                                                                              \
            good = instance_get(&component->instance, valueReferences[k], TYPE, &number);                                     \
            if (good) {                                                                                                       \
                values[k] = AS_VALUE;                                                                                         \
            }                                                                                                                 \
        }                                                                                                                     \
        return status_of(good);                                                                                               \
    }                                                                                                                         \
                                                                                                                              \
    fmi3Status fmi3Set##NAME(                                                                                                 \
        fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,                           \
        const fmi3##NAME values[], size_t nValues)                                                                            \
    {                                                                                                                         \
        component_t *component = instance;                                                                                    \
        bool good = (component != NULL)                                                                                       \
            && instance_check_lists(&component->instance, valueReferences, nValueReferences, values, nValues);                \
        size_t k;                                                                                                             \
                                                                                                                              \
        for (k = 0u; good && (k < nValues); k++) {                                                                            \
            good = instance_set(&component->instance, valueReferences[k], TYPE, AS_DOUBLE);                                   \
        }                                                                                                                     \
        return status_of(good);                                                                                               \
    }

DEFINE_ACCESS(Float64, TYPE_REAL, values[k], number)
DEFINE_ACCESS(Int32, TYPE_INTEGER, (double)values[k], (fmi3Int32)number)
DEFINE_ACCESS(Int64, TYPE_ENUMERATION, (double)values[k], (fmi3Int64)number)
DEFINE_ACCESS(Boolean, TYPE_BOOLEAN, values[k] ? 1.0 : 0.0, (number > 0.0))

/* ---- time ---- */

fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
    fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
    fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    component_t *component = instance;
    bool good;

    (void)noSetFMUStatePriorToCurrentPoint;
    if ((eventHandlingNeeded == NULL) || (terminateSimulation == NULL) || (earlyReturn == NULL)
        || (lastSuccessfulTime == NULL)) {
        return refuse(instance, "a null pointer in place of what a step answers");
    }
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    if (component == NULL) {
        return fmi3Error;
    }
    events_apply(&component->instance);
    good = instance_step(&component->instance, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = good && component->instance.has_event_mode && events_pending(&component->instance);
    *lastSuccessfulTime = instance_time(&component->instance);
    return status_of(good);
}

/* ---- states ---- */

/* A state to write into: the simulator's own, else a new one; null where there is no memory. */
static snapshot_t *room_for(fmi3FMUState *state)
{
    if (*state == NULL) {
        *state = calloc(1u, sizeof(snapshot_t));
    }
    return *state;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    const component_t *component = instance;

    if ((component == NULL) || (FMUState == NULL)) {
        return refuse(instance, "a null pointer in place of a state");
    }
    if (room_for(FMUState) == NULL) {
        return refuse(instance, "out of memory");
    }
    memcpy(*FMUState, &component->instance.now, sizeof(snapshot_t));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    component_t *component = instance;

    if ((component == NULL) || (FMUState == NULL)) {
        return refuse(instance, "a null pointer in place of a state");
    }
    memcpy(&component->instance.now, FMUState, sizeof(snapshot_t));
    component->instance.outputs_are_current = false;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if (instance == NULL) {
        return fmi3Error;
    }
    if (FMUState != NULL) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    if ((instance == NULL) || (FMUState == NULL) || (size == NULL)) {
        return refuse(instance, "a null pointer in place of a state or of its size");
    }
    *size = instance_serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    const component_t *component = instance;

    return status_of((component != NULL) && instance_serialize(&component->instance, FMUState, serializedState, size));
}

fmi3Status fmi3DeserializeFMUState(
    fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState)
{
    const component_t *component = instance;
    snapshot_t snapshot;

    if ((component == NULL) || (FMUState == NULL)) {
        return refuse(instance, "a null pointer in place of a state");
    }
    if (!instance_deserialize(&component->instance, serializedState, size, &snapshot)) {
        return fmi3Error;
    }
    if (room_for(FMUState) == NULL) {
        return refuse(instance, "out of memory");
    }
    memcpy(*FMUState, &snapshot, sizeof(snapshot));
    return fmi3OK;
}
