/*
 * FMI 3.0: functions of binary variables, clocks and events, of an FMU that has none. See fmi3.c.
 */
#include "events.h"
#include "fmi3Functions.h"
#include "instance.h"

const bool events_supported = false;

void events_apply(instance_t *self)
{
    (void)self;
}

bool events_pending(const instance_t *self)
{
    (void)self;
    return false;
}

/* An instance of fmi3.c begins with this part of it. */
static fmi3Status unsupported(const instance_t *instance, const char *text)
{
    if (instance != NULL) {
        (void)instance_refuse(instance, "%s", text);
    }
    return fmi3Error;
}

/* An empty list is no error, whatever the type. */
static fmi3Status no_such_variable(const instance_t *instance, size_t count)
{
    return ((instance != NULL) && (count == 0u)) ? fmi3OK : unsupported(instance, "no variable is of this type");
}

fmi3Status fmi3GetBinary(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, size_t valueSizes[],
    fmi3Binary values[], size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return no_such_variable(instance, nValueReferences);
}

fmi3Status fmi3SetBinary(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, const size_t valueSizes[],
    const fmi3Binary values[], size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return no_such_variable(instance, nValueReferences);
}

fmi3Status fmi3GetClock(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Clock values[])
{
    (void)valueReferences;
    (void)nValueReferences;
    (void)values;
    return unsupported(instance, "there are no clocks");
}

fmi3Status fmi3SetClock(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, const fmi3Clock values[])
{
    (void)valueReferences;
    (void)nValueReferences;
    (void)values;
    return unsupported(instance, "there are no clocks");
}

fmi3Status fmi3GetIntervalDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64 intervals[],
    fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences;
    (void)nValueReferences;
    (void)intervals;
    (void)qualifiers;
    return unsupported(instance, "there are no clocks");
}

fmi3Status fmi3GetShiftDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64 shifts[])
{
    (void)valueReferences;
    (void)nValueReferences;
    (void)shifts;
    return unsupported(instance, "there are no clocks");
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return unsupported(instance, "there is no event mode");
}

fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
    fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    (void)discreteStatesNeedUpdate;
    (void)terminateSimulation;
    (void)nominalsOfContinuousStatesChanged;
    (void)valuesOfContinuousStatesChanged;
    (void)nextEventTimeDefined;
    (void)nextEventTime;
    return unsupported(instance, "there is no event mode");
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return unsupported(instance, "there is no event mode to come from");
}
