/*
 * A simulator that does everything wrong, and then a run: compiled with the sources of an FMI 3.0 loop and the sanitizers.
 * Argument: the instantiation token.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi3Functions.h"

static unsigned told;
static unsigned wrong;

static void logger(void *environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    (void)status;
    (void)category;
    told += (message != NULL) ? 1u : 0u;
}

static void want(int condition, int line)
{
    if (!condition) {
        fprintf(stderr, "line %d\n", line);
        wrong++;
    }
}
#define WANT(condition) want((condition), __LINE__)

static fmi3Instance make(const char *name, const char *token, bool logging, bool events, size_t intermediate)
{
    const fmi3ValueReference reference[] = { 1u };

    return fmi3InstantiateCoSimulation(
        name, token, NULL, false, logging, events, false, reference, intermediate, NULL, logger, NULL);
}

static fmi3Status step(fmi3Instance instance, double time, double size)
{
    bool event = true;
    bool terminate = true;
    bool early = true;
    double reached = 0.0;
    const fmi3Status status = fmi3DoStep(instance, time, size, true, &event, &terminate, &early, &reached);

    WANT(!event && !terminate && !early);
    return status;
}

static void misuse(fmi3Instance c)
{
    const fmi3ValueReference references[] = { 0u, 1u, 17u, 100000u, 0xFFFFFFFFu };
    fmi3FMUState state = NULL;
    fmi3Float64 real = NAN;
    fmi3Float32 single = 0.0f;
    fmi3Int32 integer = -1;
    fmi3Int64 enumerated = 9;
    fmi3String text = NULL;
    fmi3Byte bytes[8] = { 0 };
    size_t size = 0u;
    size_t k;

    for (k = 0u; k < sizeof(references) / sizeof(references[0]); k++) {
        WANT(fmi3SetFloat64(c, &references[k], 1u, &real, 1u) == fmi3Error);
        WANT(fmi3SetInt32(c, &references[k], 1u, &integer, 1u) == fmi3Error);
        WANT(fmi3SetInt64(c, &references[k], 1u, &enumerated, 1u) == fmi3Error);
        WANT(fmi3SetFloat32(c, &references[k], 1u, &single, 1u) == fmi3Error);
        WANT(fmi3GetString(c, &references[k], 1u, &text, 1u) == fmi3Error);
        (void)fmi3GetFloat64(c, &references[k], 1u, &real, 1u);
        (void)fmi3GetInt64(c, &references[k], 1u, &enumerated, 1u);
        real = NAN;
        enumerated = 9;
    }
    WANT(fmi3GetFloat64(c, NULL, 3u, &real, 3u) == fmi3Error);
    WANT(fmi3GetFloat64(c, references, 3u, NULL, 3u) == fmi3Error);
    WANT(fmi3GetFloat64(c, references, 3u, &real, 1u) == fmi3Error);
    WANT(fmi3DoStep(c, 0.0, 0.001, true, NULL, NULL, NULL, NULL) == fmi3Error);
    WANT(step(c, NAN, NAN) == fmi3Error);
    WANT(step(c, 0.0, 1e300) == fmi3Error);
    WANT(fmi3EnterInitializationMode(c, false, 0.0, NAN, true, NAN) == fmi3Error);
    WANT(fmi3GetFMUState(c, NULL) == fmi3Error);
    WANT(fmi3SetFMUState(c, NULL) == fmi3Error);
    (void)fmi3FreeFMUState(c, NULL);
    (void)fmi3FreeFMUState(c, &state);
    WANT(fmi3SerializedFMUStateSize(c, NULL, &size) == fmi3Error);
    WANT(fmi3SerializeFMUState(c, NULL, bytes, sizeof(bytes)) == fmi3Error);
    WANT(fmi3DeserializeFMUState(c, bytes, sizeof(bytes), &state) == fmi3Error);
    WANT(state == NULL);
    WANT(fmi3EnterEventMode(c) == fmi3Error);
    WANT(fmi3EnterStepMode(c) == fmi3Error);
    WANT(fmi3EnterConfigurationMode(c) == fmi3Error);
    WANT(fmi3UpdateDiscreteStates(c, NULL, NULL, NULL, NULL, NULL, NULL) == fmi3Error);
    WANT(fmi3GetNumberOfVariableDependencies(c, 1u, NULL) == fmi3Error);
    WANT(fmi3GetClock(c, references, 1u, NULL) == fmi3Error);
    WANT(fmi3GetBinary(c, references, 1u, NULL, NULL, 1u) == fmi3Error);
    WANT(fmi3SetTime(c, 0.0) == fmi3Error);
    WANT(fmi3ActivateModelPartition(c, 0u, 0.0) == fmi3Error);
    WANT(fmi3SetDebugLogging(c, true, 1u, &text) == fmi3Error);
}

static void run(fmi3Instance c)
{
    const fmi3ValueReference speed[] = { 1u, 2u };
    const fmi3Float64 turn[] = { 25.0, 0.8 };
    fmi3FMUState state = NULL;
    fmi3FMUState copy = NULL;
    fmi3Byte *bytes;
    size_t size = 0u;
    int k;

    WANT(fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0) == fmi3OK);
    WANT(fmi3SetFloat64(c, speed, 2u, turn, 2u) == fmi3OK);
    WANT(fmi3ExitInitializationMode(c) == fmi3OK);
    for (k = 0; k < 500; k++) {
        WANT(step(c, 0.001 * k, 0.001) == fmi3OK);
    }
    WANT(fmi3GetFMUState(c, &state) == fmi3OK);
    WANT(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK);
    bytes = malloc(size);
    WANT(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK);
    WANT(fmi3DeserializeFMUState(c, bytes, size, &copy) == fmi3OK);
    WANT(fmi3DeserializeFMUState(c, bytes, size, &copy) == fmi3OK);
    WANT(fmi3DeserializeFMUState(c, bytes, size - 1u, &copy) == fmi3Error);
    free(bytes);
    WANT(fmi3SetFMUState(c, copy) == fmi3OK);
    WANT(step(c, 0.5, 0.01) == fmi3OK);
    WANT(fmi3GetFMUState(c, &state) == fmi3OK);
    WANT(fmi3FreeFMUState(c, &state) == fmi3OK);
    WANT(fmi3FreeFMUState(c, &copy) == fmi3OK);
    WANT((state == NULL) && (copy == NULL));
}

int main(int count, char **arguments)
{
    const char *token = (count > 1) ? arguments[1] : "";
    unsigned before;
    fmi3Instance c;

    WANT(make(NULL, token, true, false, 0u) == NULL);
    WANT(make("", token, true, false, 0u) == NULL);
    WANT(make("one", NULL, true, false, 0u) == NULL);
    WANT(make("one", "another", true, false, 0u) == NULL);
    WANT(make("one", token, true, true, 0u) == NULL);
    WANT(make("one", token, true, false, 1u) == NULL);
    WANT(told == 6u);
    WANT(fmi3InstantiateModelExchange("one", token, NULL, false, true, NULL, logger) == NULL);
    misuse(NULL);
    fmi3FreeInstance(NULL);

    c = make("one", token, true, false, 0u);
    WANT(c != NULL);
    misuse(c);
    run(c);
    misuse(c);
    WANT(fmi3Terminate(c) == fmi3OK);
    misuse(c);
    WANT(fmi3Reset(c) == fmi3OK);
    run(c);
    fmi3FreeInstance(c);

    before = told;
    c = make("two", token, false, false, 0u); /* silent: logging is off */
    misuse(c);
    run(c);
    WANT(told == before);
    WANT(fmi3SetDebugLogging(c, true, 0u, NULL) == fmi3OK);
    misuse(c);
    WANT(told > before);
    fmi3FreeInstance(c);
    return (wrong == 0u) ? 0 : 1;
}
