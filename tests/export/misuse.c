/*
 * A simulator that misuses every function and then runs. Compiled with the sources of a loop, in the long tier with sanitizers.
 * FMI is 2 or 3; the argument is the GUID or instantiation token.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static const unsigned inputs[] = { 1u, 2u }; /* speed and steering wheel */
static unsigned wrong;

static void want(int condition, int line)
{
    if (!condition) {
        fprintf(stderr, "line %d\n", line);
        wrong++;
    }
}
#define WANT(condition) want((condition), __LINE__)
#define REFUSED(call) want((call) == ERROR, __LINE__)

/* One interface for both versions. */
#if FMI == 2
#include "fmi2Functions.h"
typedef fmi2Component instance_t;
typedef fmi2FMUstate state_t;
typedef fmi2Byte octet_t;
#define OK fmi2OK
#define ERROR fmi2Error
#define FMI_(name) fmi2##name
#define LISTS(at, count, values) (at), (count), (values)
#define STATE(name) fmi2##name##FMUstate
#define DESERIALIZE fmi2DeSerializeFMUstate
#define SIZE_OF_STATE fmi2SerializedFMUstateSize
#define SET_INTEGER SetInteger
#define GET_REAL GetReal
#define SET_REAL SetReal

static void logger(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)environment;
    (void)name;
    (void)category;
    want((status == fmi2Error) && (message != NULL), __LINE__);
}

static int do_step(instance_t c, double time, double size)
{
    return fmi2DoStep(c, time, size, 0);
}

static int initialize(instance_t c, double start, int stops, double stop)
{
    const int status = fmi2SetupExperiment(c, 0, 0.0, start, stops, stop);

    return (status == OK) ? fmi2EnterInitializationMode(c) : status;
}

static instance_t make(const char *name, const char *token, const fmi2CallbackFunctions *functions)
{
    return fmi2Instantiate(name, fmi2CoSimulation, token, NULL, functions, 0, 0);
}
#else
#include "fmi3Functions.h"
typedef fmi3Instance instance_t;
typedef fmi3FMUState state_t;
typedef fmi3Byte octet_t;
#define OK fmi3OK
#define ERROR fmi3Error
#define FMI_(name) fmi3##name
#define LISTS(at, count, values) (at), (count), (values), (count)
#define STATE(name) fmi3##name##FMUState
#define DESERIALIZE fmi3DeserializeFMUState
#define SIZE_OF_STATE fmi3SerializedFMUStateSize
#define SET_INTEGER SetInt32
#define GET_REAL GetFloat64
#define SET_REAL SetFloat64

static void logger(void *environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    (void)category;
    want((status == fmi3Error) && (message != NULL), __LINE__);
}

static int do_step(instance_t c, double time, double size)
{
    bool event = true;
    bool terminate = true;
    bool early = true;
    double reached = 0.0;
    const int status = fmi3DoStep(c, time, size, true, &event, &terminate, &early, &reached);

    WANT(!event && !terminate && !early);
    return status;
}

static int initialize(instance_t c, double start, int stops, double stop)
{
    return fmi3EnterInitializationMode(c, false, 0.0, start, stops != 0, stop);
}

static instance_t make(const char *name, const char *token, bool events, size_t intermediate)
{
    return fmi3InstantiateCoSimulation(
        name, token, NULL, false, true, events, false, inputs, intermediate, NULL, logger, NULL);
}

#endif

#define CALL(name) FMI_(name) /* a second expansion, for names that are macros */

static void misuse(instance_t c)
{
    const unsigned at[] = { 0u, 1u, 17u, 100000u, 0xFFFFFFFFu };
    const double not_a_number = NAN;
    const int negative = -1;
    state_t state = NULL;
    const char *text = NULL;
    octet_t bytes[8] = { 0 };
    double many[3];
    size_t size = 0u;
    size_t k;

    for (k = 0u; k < sizeof(at) / sizeof(at[0]); k++) {
        double real = 0.0;

        REFUSED(CALL(SET_REAL)(c, LISTS(&at[k], 1u, &not_a_number)));
        REFUSED(CALL(SET_INTEGER)(c, LISTS(&at[k], 1u, &negative)));
        REFUSED(CALL(GetString)(c, LISTS(&at[k], 1u, &text)));
        (void)CALL(GET_REAL)(c, LISTS(&at[k], 1u, &real));
    }
    REFUSED(CALL(GET_REAL)(c, LISTS(NULL, 3u, many)));
    REFUSED(CALL(GET_REAL)(c, LISTS(at, 3u, NULL)));
    REFUSED(do_step(c, NAN, NAN));
    REFUSED(do_step(c, 0.0, 1e300));
    REFUSED(do_step(c, 0.0, -1e300));
    REFUSED(initialize(c, NAN, 1, NAN));
    REFUSED(STATE(Get)(c, NULL));
    REFUSED(STATE(Set)(c, NULL));
    (void)STATE(Free)(c, NULL);
    (void)STATE(Free)(c, &state);
    REFUSED(SIZE_OF_STATE(c, NULL, &size));
    REFUSED(STATE(Serialize)(c, NULL, bytes, sizeof(bytes)));
    REFUSED(DESERIALIZE(c, bytes, sizeof(bytes), &state));
    REFUSED(DESERIALIZE(c, NULL, sizeof(bytes), &state));
    WANT(state == NULL);
    REFUSED(CALL(SetDebugLogging)(c, 1, 1u, &text));
}

static void run(instance_t c)
{
    const double turn[] = { 25.0, 0.8 };
    state_t state = NULL;
    state_t copy = NULL;
    octet_t *bytes;
    size_t size = 0u;
    int k;

    WANT(initialize(c, 0.0, 0, 0.0) == OK);
    WANT(CALL(SET_REAL)(c, LISTS(inputs, 2u, turn)) == OK);
    WANT(CALL(SET_REAL)(c, LISTS(NULL, 0u, NULL)) == OK);
    WANT(CALL(ExitInitializationMode)(c) == OK);
    for (k = 0; k < 500; k++) {
        WANT(do_step(c, 0.001 * k, 0.001) == OK);
    }
    WANT(STATE(Get)(c, &state) == OK);
    WANT(SIZE_OF_STATE(c, state, &size) == OK);
    bytes = malloc(size);
    WANT(STATE(Serialize)(c, state, bytes, size) == OK);
    WANT(DESERIALIZE(c, bytes, size, &copy) == OK);
    WANT(DESERIALIZE(c, bytes, size, &copy) == OK);
    REFUSED(DESERIALIZE(c, bytes, size - 1u, &copy));
    free(bytes);
    WANT(STATE(Set)(c, copy) == OK);
    WANT(do_step(c, 0.5, 0.01) == OK);
    WANT(STATE(Get)(c, &state) == OK);
    WANT(STATE(Free)(c, &state) == OK);
    WANT(STATE(Free)(c, &copy) == OK);
    WANT((state == NULL) && (copy == NULL));
}

static void use_and_free(instance_t c)
{
    WANT(c != NULL);
    misuse(c);
    run(c);
    misuse(c);
    WANT(CALL(Terminate)(c) == OK);
    misuse(c);
    WANT(CALL(Reset)(c) == OK);
    run(c);
    CALL(FreeInstance)(c);
}

int main(int count, char **arguments)
{
    const char *token = (count > 1) ? arguments[1] : "";
#if FMI == 2
    const fmi2CallbackFunctions functions = { logger, calloc, free, NULL, NULL };
    const fmi2CallbackFunctions none = { NULL, NULL, NULL, NULL, NULL };

    WANT(make("one", token, NULL) == NULL);
    WANT(make("", token, &functions) == NULL);
    WANT(make("one", NULL, &functions) == NULL);
    WANT(fmi2Instantiate("one", fmi2ModelExchange, token, NULL, &none, 0, 0) == NULL);
    use_and_free(make("one", token, &functions));
    use_and_free(make("two", token, &none)); /* no callbacks: its own memory, no log */
#else
    WANT(make("", token, false, 0u) == NULL);
    WANT(make("one", NULL, false, 0u) == NULL);
    WANT(make("one", token, true, 0u) == NULL);
    WANT(make("one", token, false, 1u) == NULL);
    WANT(fmi3InstantiateModelExchange("one", token, NULL, false, true, NULL, logger) == NULL);
    use_and_free(make("one", token, false, 0u));
#endif
    misuse(NULL);
    CALL(FreeInstance)(NULL);
    return (wrong == 0u) ? 0 : 1;
}
