/* FMI 3.0 for co-simulation and model exchange. */
#include "fmi3.h"

#include <string.h>

#include "instance.h"

#define REFERENCES fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr

static void report(void *environment, void *function, const char *name, const char *text) {
    (void)name;
    fmi3LogMessageCallback message;
    memcpy(&message, &function, sizeof message);
    message(environment, fmi3Error, "logStatusError", text);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count,
                                      const fmi3String categories[]) {
    (void)on;
    return (fmi3Status)instance_log_categories(instance, count, categories);
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                                fmi3Boolean early_return, const fmi3ValueReference between[],
                                                size_t n_between, fmi3InstanceEnvironment environment,
                                                fmi3LogMessageCallback message,
                                                fmi3IntermediateUpdateCallback intermediate) {
    (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return, (void)between;
    (void)intermediate;
    void *function = NULL;
    memcpy(&function, &message, sizeof function);
    if (n_between > 0) {
        if (message)
            message(environment, fmi3Error, "logStatusError", "there are no intermediate variables in this FMU");
        return NULL;
    }
    return instance_new(name, token, CO_SIMULATION, message ? report : NULL, environment, function);
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback message) {
    (void)resources, (void)visible, (void)logging;
    void *function = NULL;
    memcpy(&function, &message, sizeof function);
    return instance_new(name, token, MODEL_EXCHANGE, message ? report : NULL, environment, function);
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback message, fmi3ClockUpdateCallback clock,
                                                      fmi3LockPreemptionCallback lock,
                                                      fmi3UnlockPreemptionCallback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    if (message)
        message(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation and model exchange");
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance) { instance_free(instance); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerant, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop) {
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    Status status = instance_set_start(instance, start);
    return (fmi3Status)(status == STATUS_OK ? instance_initialise(instance) : status);
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { return (fmi3Status)instance_run(instance); }

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance) { return (fmi3Status)instance_terminate(instance); }

EXPORT fmi3Status fmi3Reset(fmi3Instance instance) { return (fmi3Status)instance_reset(instance); }

EXPORT fmi3Status fmi3GetFloat64(REFERENCES, fmi3Float64 values[], size_t count) {
    if (count != nvr)
        return (fmi3Status)instance_error(instance, "there are as many values as variables");
    return (fmi3Status)instance_get(instance, vr, nvr, values);
}

EXPORT fmi3Status fmi3SetFloat64(REFERENCES, const fmi3Float64 values[], size_t count) {
    if (count != nvr)
        return (fmi3Status)instance_error(instance, "there are as many values as variables");
    return (fmi3Status)instance_set(instance, vr, nvr, values);
}

/* There are no variables of other types. */
#define NO_VARIABLES(function) \
    return nvr == 0 && instance ? fmi3OK : (fmi3Status)instance_unsupported(instance, function)

#define OTHER_TYPE(name)                                                                                              \
    EXPORT fmi3Status fmi3Get##name(REFERENCES, fmi3##name values[], size_t count) {                                  \
        (void)vr, (void)values, (void)count;                                                                          \
        NO_VARIABLES("fmi3Get" #name);                                                                                \
    }                                                                                                                 \
    EXPORT fmi3Status fmi3Set##name(REFERENCES, const fmi3##name values[], size_t count) {                            \
        (void)vr, (void)values, (void)count;                                                                          \
        NO_VARIABLES("fmi3Set" #name);                                                                                \
    }

OTHER_TYPE(Float32)
OTHER_TYPE(Int8)
OTHER_TYPE(UInt8)
OTHER_TYPE(Int16)
OTHER_TYPE(UInt16)
OTHER_TYPE(Int32)
OTHER_TYPE(UInt32)
OTHER_TYPE(Int64)
OTHER_TYPE(UInt64)
OTHER_TYPE(Boolean)
OTHER_TYPE(String)

EXPORT fmi3Status fmi3GetBinary(REFERENCES, size_t sizes[], fmi3Binary values[], size_t count) {
    (void)vr, (void)sizes, (void)values, (void)count;
    NO_VARIABLES("fmi3GetBinary");
}

EXPORT fmi3Status fmi3SetBinary(REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t count) {
    (void)vr, (void)sizes, (void)values, (void)count;
    NO_VARIABLES("fmi3SetBinary");
}

EXPORT fmi3Status fmi3GetClock(REFERENCES, fmi3Clock values[]) {
    (void)vr, (void)values;
    NO_VARIABLES("fmi3GetClock");
}

EXPORT fmi3Status fmi3SetClock(REFERENCES, const fmi3Clock values[]) {
    (void)vr, (void)values;
    NO_VARIABLES("fmi3SetClock");
}

EXPORT fmi3Status fmi3GetIntervalDecimal(REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void)vr, (void)intervals, (void)qualifiers;
    NO_VARIABLES("fmi3GetIntervalDecimal");
}

EXPORT fmi3Status fmi3GetIntervalFraction(REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                          fmi3IntervalQualifier qualifiers[]) {
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    NO_VARIABLES("fmi3GetIntervalFraction");
}

EXPORT fmi3Status fmi3GetShiftDecimal(REFERENCES, fmi3Float64 shifts[]) {
    (void)vr, (void)shifts;
    NO_VARIABLES("fmi3GetShiftDecimal");
}

EXPORT fmi3Status fmi3GetShiftFraction(REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    NO_VARIABLES("fmi3GetShiftFraction");
}

EXPORT fmi3Status fmi3SetIntervalDecimal(REFERENCES, const fmi3Float64 intervals[]) {
    (void)vr, (void)intervals;
    NO_VARIABLES("fmi3SetIntervalDecimal");
}

EXPORT fmi3Status fmi3SetIntervalFraction(REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    NO_VARIABLES("fmi3SetIntervalFraction");
}

EXPORT fmi3Status fmi3SetShiftDecimal(REFERENCES, const fmi3Float64 shifts[]) {
    (void)vr, (void)shifts;
    NO_VARIABLES("fmi3SetShiftDecimal");
}

EXPORT fmi3Status fmi3SetShiftFraction(REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    NO_VARIABLES("fmi3SetShiftFraction");
}

EXPORT fmi3Status fmi3GetOutputDerivatives(REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t count) {
    (void)vr, (void)orders, (void)values, (void)count;
    NO_VARIABLES("fmi3GetOutputDerivatives");
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    return (fmi3Status)instance_keep(instance, (State **)state);
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    return (fmi3Status)instance_restore(instance, state);
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    return (fmi3Status)instance_forget(instance, (State **)state);
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    return (fmi3Status)instance_size(instance, state, size);
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return (fmi3Status)instance_serialise(instance, state, bytes, size);
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                          fmi3FMUState *state) {
    return (fmi3Status)instance_deserialise(instance, bytes, size, (State **)state);
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
    return (fmi3Status)instance_unsupported(instance, "fmi3EnterStepMode");
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_return,
                             fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)no_return;
    Status status = instance_step(instance, t, h);
    if (event)
        *event = false;
    if (terminate)
        *terminate = false;
    if (early)
        *early = false;
    if (reached && instance)
        *reached = instance_time(instance);
    return (fmi3Status)status;
}

/* Model exchange, without events. */
EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance instance) { return (fmi3Status)instance_exchange(instance); }

EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) { return (fmi3Status)instance_exchange(instance); }

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *update, fmi3Boolean *terminate,
                                           fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *event,
                                           fmi3Float64 *time) {
    fmi3Boolean *told[] = {update, terminate, nominals, values, event};
    for (size_t k = 0; k < sizeof told / sizeof *told; k++)
        if (told[k])
            *told[k] = false;
    (void)time;
    return (fmi3Status)instance_exchange(instance);
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_return, fmi3Boolean *event,
                                              fmi3Boolean *terminate) {
    (void)no_return;
    if (event)
        *event = false;
    if (terminate)
        *terminate = false;
    return (fmi3Status)instance_exchange(instance);
}

EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    return (fmi3Status)instance_set_time(instance, time);
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t count) {
    return (fmi3Status)instance_set_states(instance, states, count);
}

EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t count) {
    return (fmi3Status)instance_get_states(instance, states, count);
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t count) {
    return (fmi3Status)instance_get_derivatives(instance, derivatives, count);
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t count) {
    return (fmi3Status)instance_get_nominals(instance, nominals, count);
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *count) {
    return (fmi3Status)instance_count_states(instance, count);
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *count) {
    if (count)
        *count = 0;
    return (fmi3Status)instance_exchange(instance);
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t count) {
    (void)indicators;
    return (fmi3Status)(count == 0 ? instance_exchange(instance)
                                   : instance_error(instance, "there are no event indicators"));
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                               size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns,
                                               const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[],
                                               size_t n_sensitivity) {
    if (n_seed != n_knowns || n_sensitivity != n_unknowns)
        return (fmi3Status)instance_error(instance, "there are as many values as variables");
    return (fmi3Status)instance_direction(instance, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

/* What an FMU without events and clocks does not provide: parameters follow the instance. */
#define NOT_PROVIDED(function, parameters)                                                                            \
    EXPORT fmi3Status function parameters { return (fmi3Status)instance_unsupported(instance, #function); }

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

NOT_PROVIDED(fmi3GetAdjointDerivative,
             (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
              const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
              fmi3Float64 sensitivity[], size_t n_sensitivity))
NOT_PROVIDED(fmi3GetNumberOfVariableDependencies, (fmi3Instance instance, fmi3ValueReference vr, size_t *count))
NOT_PROVIDED(fmi3GetVariableDependencies,
             (fmi3Instance instance, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[],
              size_t their_elements[], fmi3DependencyKind kinds[], size_t count))
NOT_PROVIDED(fmi3EnterConfigurationMode, (fmi3Instance instance))
NOT_PROVIDED(fmi3ExitConfigurationMode, (fmi3Instance instance))
NOT_PROVIDED(fmi3EvaluateDiscreteStates, (fmi3Instance instance))
NOT_PROVIDED(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time))
