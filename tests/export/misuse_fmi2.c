/*
 * A simulator that does everything wrong, and then a run: compiled with the sources of an FMI 2.0 loop and the sanitizers.
 * Argument: the GUID.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"

static unsigned told;
static size_t blocks; /* that the FMU holds */

static void logger(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    told += (message != NULL) ? 1u : 0u;
}

static void *allocate(size_t count, size_t size)
{
    blocks++;
    return calloc(count, size);
}

static void release(void *memory)
{
    blocks--;
    free(memory);
}

static unsigned wrong;

static void want(int condition, int line)
{
    if (!condition) {
        fprintf(stderr, "line %d\n", line);
        wrong++;
    }
}
#define WANT(condition) want((condition), __LINE__)

static void misuse(fmi2Component c)
{
    const fmi2ValueReference references[] = { 0u, 1u, 17u, 100000u, 0xFFFFFFFFu };
    fmi2FMUstate state = NULL;
    fmi2Real real = NAN;
    fmi2Integer integer = -1;
    fmi2Boolean boolean = 7;
    fmi2String text = NULL;
    fmi2Byte bytes[8] = { 0 };
    size_t size = 0u;
    size_t k;

    for (k = 0u; k < sizeof(references) / sizeof(references[0]); k++) {
        WANT(fmi2SetReal(c, &references[k], 1u, &real) == fmi2Error);
        WANT(fmi2SetInteger(c, &references[k], 1u, &integer) == fmi2Error);
        WANT(fmi2SetBoolean(c, &references[k], 1u, &boolean) == fmi2Error);
        WANT(fmi2SetString(c, &references[k], 1u, &text) == fmi2Error);
        WANT(fmi2GetString(c, &references[k], 1u, &text) == fmi2Error);
        (void)fmi2GetReal(c, &references[k], 1u, &real);
        (void)fmi2GetInteger(c, &references[k], 1u, &integer);
        (void)fmi2GetBoolean(c, &references[k], 1u, &boolean);
        real = NAN;
        integer = -1;
    }
    WANT(fmi2GetReal(c, NULL, 3u, &real) == fmi2Error);
    WANT(fmi2GetReal(c, references, 3u, NULL) == fmi2Error);
    WANT(fmi2SetReal(c, references, 3u, NULL) == fmi2Error);
    WANT(fmi2DoStep(c, NAN, NAN, 0) == fmi2Error);
    WANT(fmi2DoStep(c, 0.0, 1e300, 0) == fmi2Error);
    WANT(fmi2DoStep(c, 0.0, -1e300, 0) == fmi2Error);
    WANT(fmi2SetupExperiment(c, 0, 0.0, NAN, 1, NAN) == fmi2Error);
    WANT(fmi2GetFMUstate(c, NULL) == fmi2Error);
    WANT(fmi2SetFMUstate(c, NULL) == fmi2Error);
    (void)fmi2FreeFMUstate(c, NULL);
    (void)fmi2FreeFMUstate(c, &state);
    WANT(fmi2SerializedFMUstateSize(c, NULL, &size) == fmi2Error);
    WANT(fmi2SerializeFMUstate(c, NULL, bytes, sizeof(bytes)) == fmi2Error);
    WANT(fmi2DeSerializeFMUstate(c, bytes, sizeof(bytes), &state) == fmi2Error);
    WANT(fmi2DeSerializeFMUstate(c, NULL, sizeof(bytes), &state) == fmi2Error);
    WANT(state == NULL);
    WANT(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, NULL) == fmi2Error);
    WANT(fmi2GetBooleanStatus(c, fmi2Terminated, NULL) == fmi2Error);
    WANT(fmi2SetDebugLogging(c, 1, 1u, &text) == fmi2Error);
    WANT(fmi2SetDebugLogging(c, 1, 1u, NULL) == fmi2Error);
    WANT(fmi2CancelStep(c) == fmi2Error);
}

static void run(fmi2Component c)
{
    const fmi2ValueReference speed[] = { 1u, 2u };
    const fmi2Real turn[] = { 25.0, 0.8 };
    fmi2FMUstate state = NULL;
    fmi2FMUstate copy = NULL;
    fmi2Byte *bytes;
    size_t size = 0u;
    int k;

    WANT(fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    WANT(fmi2EnterInitializationMode(c) == fmi2OK);
    WANT(fmi2SetReal(c, speed, 2u, turn) == fmi2OK);
    WANT(fmi2ExitInitializationMode(c) == fmi2OK);
    for (k = 0; k < 500; k++) {
        WANT(fmi2DoStep(c, 0.001 * k, 0.001, 0) == fmi2OK);
    }
    WANT(fmi2GetFMUstate(c, &state) == fmi2OK);
    WANT(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK);
    bytes = malloc(size);
    WANT(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    WANT(fmi2DeSerializeFMUstate(c, bytes, size, &copy) == fmi2OK);
    WANT(fmi2DeSerializeFMUstate(c, bytes, size, &copy) == fmi2OK);
    WANT(fmi2DeSerializeFMUstate(c, bytes, size - 1u, &copy) == fmi2Error);
    free(bytes);
    WANT(fmi2SetFMUstate(c, copy) == fmi2OK);
    WANT(fmi2DoStep(c, 0.5, 0.01, 0) == fmi2OK);
    WANT(fmi2GetFMUstate(c, &state) == fmi2OK);
    WANT(fmi2FreeFMUstate(c, &state) == fmi2OK);
    WANT(state == NULL);
    WANT(fmi2FreeFMUstate(c, &copy) == fmi2OK);
}

int main(int count, char **arguments)
{
    const fmi2CallbackFunctions functions = { logger, allocate, release, NULL, NULL };
    const fmi2CallbackFunctions none = { NULL, NULL, NULL, NULL, NULL };
    const char *token = (count > 1) ? arguments[1] : "";
    fmi2Component c;

    WANT(fmi2Instantiate("one", fmi2CoSimulation, token, NULL, NULL, 0, 0) == NULL);
    WANT(fmi2Instantiate(NULL, fmi2CoSimulation, token, NULL, &functions, 0, 0) == NULL);
    WANT(fmi2Instantiate("", fmi2CoSimulation, token, NULL, &functions, 0, 0) == NULL);
    WANT(fmi2Instantiate("one", fmi2CoSimulation, "another", NULL, &functions, 0, 0) == NULL);
    WANT(fmi2Instantiate("one", fmi2CoSimulation, NULL, NULL, &functions, 0, 0) == NULL);
    WANT(fmi2Instantiate("one", fmi2ModelExchange, token, NULL, &none, 0, 0) == NULL);
    WANT(told == 4u);
    misuse(NULL);
    fmi2FreeInstance(NULL);

    c = fmi2Instantiate("one", fmi2CoSimulation, token, NULL, &functions, 0, 0);
    WANT(c != NULL);
    misuse(c);
    run(c);
    misuse(c);
    WANT(fmi2Terminate(c) == fmi2OK);
    misuse(c);
    WANT(fmi2Reset(c) == fmi2OK);
    run(c);
    fmi2FreeInstance(c);
    WANT(blocks == 0u);

    c = fmi2Instantiate("two", fmi2CoSimulation, token, NULL, &none, 0, 0); /* no functions at all: its own memory, silence */
    misuse(c);
    run(c);
    fmi2FreeInstance(c);
    return (wrong == 0u) ? 0 : 1;
}
