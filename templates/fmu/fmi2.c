/*
 * FMI 2.0, co-simulation: the functions of the standard over instance.h.
 */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "instance.h"

static const char error_category[] = "logStatusError";

typedef struct {
    instance_t instance;
    fmi2CallbackFunctions functions;
    char *name;
} component_t;

/* ---- memory and messages ---- */

/* The memory functions of the simulator are optional. */
static void *allocate(const fmi2CallbackFunctions *functions, size_t size)
{
    const bool given = (functions->allocateMemory != NULL) && (functions->freeMemory != NULL);

    return given ? functions->allocateMemory(1u, size) : calloc(1u, size);
}

static void release(const fmi2CallbackFunctions *functions, void *memory)
{
    if (memory == NULL) {
        /* nothing to free */
    } else if ((functions->allocateMemory != NULL) && (functions->freeMemory != NULL)) {
        functions->freeMemory(memory);
    } else {
        free(memory);
    }
}

/* Errors are reported even if debug logging is off. No text contains a percent sign. */
static void log_error(const fmi2CallbackFunctions *functions, fmi2String name, const char *text)
{
    if (functions->logger != NULL) {
        functions->logger(functions->componentEnvironment, name, fmi2Error, error_category, text);
    }
}

static void report(void *receiver, const char *text)
{
    const component_t *component = receiver;

    log_error(&component->functions, component->name, text);
}

static fmi2Status status_of(bool good)
{
    return good ? fmi2OK : fmi2Error;
}

static fmi2Status unsupported(fmi2Component c, const char *text)
{
    const component_t *component = c;

    return (component == NULL) ? fmi2Error : status_of(instance_refuse(&component->instance, "%s", text));
}

/* ---- life ---- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Reason why an instance cannot be made, or null. */
static const char *obstacle(fmi2String name, fmi2Type type, fmi2String token)
{
    const char *text = NULL;

    if ((name == NULL) || (name[0] == '\0')) {
        text = "an instance needs a name";
    } else if (type != fmi2CoSimulation) {
        text = "this FMU is for co-simulation";
    } else if ((token == NULL) || (strcmp(token, instance_token) != 0)) {
        text = "the GUID is not that of this binary: modelDescription.xml and the binary are of different FMUs";
    } else {
        /* none */
    }
    return text;
}

fmi2Component fmi2Instantiate(
    fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
    component_t *component;
    const char *text;

    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    if (functions == NULL) {
        return NULL;
    }
    text = obstacle(instanceName, fmuType, fmuGUID);
    if (text != NULL) {
        log_error(functions, (instanceName == NULL) ? "" : instanceName, text);
        return NULL;
    }
    component = allocate(functions, sizeof(*component));
    if (component != NULL) {
        component->functions = *functions;
        component->name = allocate(functions, strlen(instanceName) + 1u);
    }
    if ((component == NULL) || (component->name == NULL)) {
        log_error(functions, instanceName, "out of memory");
        release(functions, component);
        return NULL;
    }
    memcpy(component->name, instanceName, strlen(instanceName) + 1u);
    instance_init(&component->instance, report, component);
    return component;
}

void fmi2FreeInstance(fmi2Component c)
{
    component_t *component = c;

    if (component != NULL) {
        const fmi2CallbackFunctions functions = component->functions;

        release(&functions, component->name);
        release(&functions, component);
    }
}

/* The only messages are errors, which are always reported. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
    const component_t *component = c;
    bool good = component != NULL;
    size_t k;

    (void)loggingOn;
    good = good && instance_check_lists(&component->instance, categories, nCategories, categories, nCategories);
    for (k = 0u; good && (k < nCategories); k++) {
        if ((categories[k] == NULL) || (strcmp(categories[k], error_category) != 0)) {
            good = instance_refuse(&component->instance, "the only category of messages is %s", error_category);
        }
    }
    return status_of(good);
}

fmi2Status fmi2SetupExperiment(
    fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime, fmi2Boolean stopTimeDefined,
    fmi2Real stopTime)
{
    component_t *component = c;

    (void)toleranceDefined;
    (void)tolerance;
    return status_of(
        (component != NULL)
        && instance_set_times(&component->instance, startTime, stopTimeDefined != fmi2False, stopTime));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    component_t *component = c;

    return status_of((component != NULL) && instance_enter_initialization(&component->instance));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    component_t *component = c;

    return status_of((component != NULL) && instance_exit_initialization(&component->instance));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    component_t *component = c;

    return status_of((component != NULL) && instance_terminate(&component->instance));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    component_t *component = c;

    if (component == NULL) {
        return fmi2Error;
    }
    instance_reset(&component->instance);
    return fmi2OK;
}

/* ---- variables ---- */

/* Define fmi2Get<Name> and fmi2Set<Name>. TYPE: of the variables; AS_DOUBLE: value[k] as a double. */
#define DEFINE_ACCESS(NAME, TYPE, AS_DOUBLE)                                                                                  \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##NAME value[])                  \
    {                                                                                                                         \
        component_t *component = c;                                                                                           \
        bool good = (component != NULL) && instance_check_lists(&component->instance, vr, nvr, value, nvr);                   \
        size_t k;                                                                                                             \
                                                                                                                              \
        for (k = 0u; good && (k < nvr); k++) {                                                                                \
            double number;                                                                                                    \
                                                                                                                              \
            good = instance_get(&component->instance, vr[k], TYPE, &number);                                                  \
            if (good) {                                                                                                       \
                value[k] = (fmi2##NAME)number;                                                                                \
            }                                                                                                                 \
        }                                                                                                                     \
        return status_of(good);                                                                                               \
    }                                                                                                                         \
                                                                                                                              \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##NAME value[])            \
    {                                                                                                                         \
        component_t *component = c;                                                                                           \
        bool good = (component != NULL) && instance_check_lists(&component->instance, vr, nvr, value, nvr);                   \
        size_t k;                                                                                                             \
                                                                                                                              \
        for (k = 0u; good && (k < nvr); k++) {                                                                                \
            good = instance_set(&component->instance, vr[k], TYPE, AS_DOUBLE);                                                \
        }                                                                                                                     \
        return status_of(good);                                                                                               \
    }

DEFINE_ACCESS(Real, TYPE_REAL, value[k])
DEFINE_ACCESS(Integer, TYPE_INTEGER, (double)value[k])
DEFINE_ACCESS(Boolean, TYPE_BOOLEAN, (value[k] != fmi2False) ? 1.0 : 0.0)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr;
    (void)value;
    return ((c != NULL) && (nvr == 0u)) ? fmi2OK : unsupported(c, "there are no strings");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return ((c != NULL) && (nvr == 0u)) ? fmi2OK : unsupported(c, "there are no strings");
}

/* ---- time ---- */

fmi2Status fmi2DoStep(
    fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
    fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    component_t *component = c;

    (void)noSetFMUStatePriorToCurrentPoint;
    return status_of(
        (component != NULL) && instance_step(&component->instance, currentCommunicationPoint, communicationStepSize));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return unsupported(c, "a step is done when fmi2DoStep returns, and cannot be cancelled");
}

fmi2Status fmi2SetRealInputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return unsupported(c, "inputs are held over a step, they have no derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return unsupported(c, "there are no derivatives of outputs");
}

fmi2Status fmi2GetDirectionalDerivative(
    fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown, const fmi2ValueReference vKnown_ref[],
    size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return unsupported(c, "there are no directional derivatives");
}

/* Every step ends inside fmi2DoStep, so that no step is pending. The standard requires fmi2Discard where there is no status. */
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    const component_t *component = c;

    if ((component == NULL) || (value == NULL)) {
        return unsupported(c, "a null pointer in place of a value");
    }
    if (s != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = instance_time(&component->instance);
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if ((c == NULL) || (value == NULL)) {
        return unsupported(c, "a null pointer in place of a value");
    }
    if (s != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False; /* the model never ends by itself */
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : fmi2Discard;
}

/* ---- states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    const component_t *component = c;

    if ((component == NULL) || (FMUstate == NULL)) {
        return unsupported(c, "a null pointer in place of a state");
    }
    if (*FMUstate == NULL) {
        *FMUstate = allocate(&component->functions, sizeof(snapshot_t));
    }
    if (*FMUstate == NULL) {
        return unsupported(c, "out of memory");
    }
    memcpy(*FMUstate, &component->instance.now, sizeof(snapshot_t));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    component_t *component = c;

    if ((component == NULL) || (FMUstate == NULL)) {
        return unsupported(c, "a null pointer in place of a state");
    }
    memcpy(&component->instance.now, FMUstate, sizeof(snapshot_t));
    component->instance.outputs_are_current = false;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    const component_t *component = c;

    if (component == NULL) {
        return fmi2Error;
    }
    if (FMUstate != NULL) {
        release(&component->functions, *FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    if ((c == NULL) || (FMUstate == NULL) || (size == NULL)) {
        return unsupported(c, "a null pointer in place of a state or of its size");
    }
    *size = instance_serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    const component_t *component = c;

    return status_of((component != NULL) && instance_serialize(&component->instance, FMUstate, serializedState, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate)
{
    const component_t *component = c;
    snapshot_t snapshot;

    if ((component == NULL) || (FMUstate == NULL)) {
        return unsupported(c, "a null pointer in place of a state");
    }
    if (!instance_deserialize(&component->instance, serializedState, size, &snapshot)) {
        return fmi2Error;
    }
    if (*FMUstate == NULL) {
        *FMUstate = allocate(&component->functions, sizeof(snapshot));
    }
    if (*FMUstate == NULL) {
        return unsupported(c, "out of memory");
    }
    memcpy(*FMUstate, &snapshot, sizeof(snapshot));
    return fmi2OK;
}
