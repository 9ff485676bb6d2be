/* FMI 2.0 for co-simulation and model exchange. */
#include "fmi2.h"

#include <string.h>

#include "instance.h"

#define REFERENCES fmi2Component c, const fmi2ValueReference vr[], size_t nvr

static void report(void *environment, void *function, const char *name, const char *text) {
    fmi2CallbackLogger logger;
    memcpy(&logger, &function, sizeof logger);
    logger(environment, name, fmi2Error, "logStatusError", text);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)on;
    return (fmi2Status)instance_log_categories(c, count, categories);
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    void *logger = NULL;
    if (functions)
        memcpy(&logger, &functions->logger, sizeof logger);
    Use use = type == fmi2ModelExchange ? MODEL_EXCHANGE : CO_SIMULATION;
    return instance_new(name, guid, use, logger ? report : NULL, functions ? functions->componentEnvironment : NULL, logger);
}

EXPORT void fmi2FreeInstance(fmi2Component c) { instance_free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean stops, fmi2Real stop) {
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    return (fmi2Status)instance_set_start(c, start);
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (fmi2Status)instance_initialise(c); }

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (fmi2Status)instance_run(c); }

EXPORT fmi2Status fmi2Terminate(fmi2Component c) { return (fmi2Status)instance_terminate(c); }

EXPORT fmi2Status fmi2Reset(fmi2Component c) { return (fmi2Status)instance_reset(c); }

EXPORT fmi2Status fmi2GetReal(REFERENCES, fmi2Real value[]) { return (fmi2Status)instance_get(c, vr, nvr, value); }

EXPORT fmi2Status fmi2SetReal(REFERENCES, const fmi2Real value[]) {
    return (fmi2Status)instance_set(c, vr, nvr, value);
}

/* There are no variables of other types. */
#define OTHER_TYPE(name, type)                                                                                        \
    EXPORT fmi2Status fmi2Get##name(REFERENCES, type value[]) {                                                       \
        (void)vr, (void)value;                                                                                        \
        return nvr == 0 && c ? fmi2OK : (fmi2Status)instance_unsupported(c, "fmi2Get" #name);                         \
    }                                                                                                                 \
    EXPORT fmi2Status fmi2Set##name(REFERENCES, const type value[]) {                                                 \
        (void)vr, (void)value;                                                                                        \
        return nvr == 0 && c ? fmi2OK : (fmi2Status)instance_unsupported(c, "fmi2Set" #name);                         \
    }

OTHER_TYPE(Integer, fmi2Integer)
OTHER_TYPE(Boolean, fmi2Boolean)
OTHER_TYPE(String, fmi2String)

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (fmi2Status)instance_keep(c, (State **)state);
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return (fmi2Status)instance_restore(c, state);
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (fmi2Status)instance_forget(c, (State **)state);
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return (fmi2Status)instance_size(c, state, size);
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return (fmi2Status)instance_serialise(c, state, (unsigned char *)bytes, size);
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return (fmi2Status)instance_deserialise(c, (const unsigned char *)bytes, size, (State **)state);
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                               const fmi2ValueReference known[], size_t n_known,
                                               const fmi2Real change[], fmi2Real found[]) {
    return (fmi2Status)instance_direction(c, unknown, n_unknown, known, n_known, change, found);
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(REFERENCES, const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return (fmi2Status)instance_unsupported(c, "fmi2SetRealInputDerivatives");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(REFERENCES, const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return (fmi2Status)instance_unsupported(c, "fmi2GetRealOutputDerivatives");
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_return) {
    (void)no_return;
    return (fmi2Status)instance_step(c, t, h);
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return (fmi2Status)instance_unsupported(c, "fmi2CancelStep"); }

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!c || !value || kind != fmi2LastSuccessfulTime)
        return (fmi2Status)instance_unsupported(c, "fmi2GetRealStatus of this kind");
    *value = instance_time(c);
    return fmi2OK;
}

/* A step is never pending. */
#define OTHER_STATUS(name, type)                                                                                      \
    EXPORT fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind kind, type *value) {                        \
        (void)kind, (void)value;                                                                                      \
        return (fmi2Status)instance_unsupported(c, "fmi2Get" #name);                                                  \
    }

OTHER_STATUS(Status, fmi2Status)
OTHER_STATUS(IntegerStatus, fmi2Integer)
OTHER_STATUS(BooleanStatus, fmi2Boolean)
OTHER_STATUS(StringStatus, fmi2String)

/* Model exchange, without events. */
EXPORT fmi2Status fmi2EnterEventMode(fmi2Component c) { return (fmi2Status)instance_exchange(c); }

EXPORT fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return (fmi2Status)instance_exchange(c); }

EXPORT fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    if (info)
        memset(info, 0, sizeof *info);
    return (fmi2Status)instance_exchange(c);
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_return, fmi2Boolean *event,
                                              fmi2Boolean *terminate) {
    (void)no_return;
    if (event)
        *event = 0;
    if (terminate)
        *terminate = 0;
    return (fmi2Status)instance_exchange(c);
}

EXPORT fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { return (fmi2Status)instance_set_time(c, t); }

EXPORT fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real states[], size_t count) {
    return (fmi2Status)instance_set_states(c, states, count);
}

EXPORT fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real states[], size_t count) {
    return (fmi2Status)instance_get_states(c, states, count);
}

EXPORT fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t count) {
    return (fmi2Status)instance_get_derivatives(c, derivatives, count);
}

EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t count) {
    return (fmi2Status)instance_get_nominals(c, nominals, count);
}

EXPORT fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t count) {
    (void)indicators;
    return count == 0 ? (fmi2Status)instance_exchange(c) : (fmi2Status)instance_error(c, "there are no event indicators");
}
