#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

typedef enum { CREATED, INITIALISING, RUNNING, TERMINATED, FAILED } Phase;

/* Everything that an instance knows, in one block without pointers: a copy of it is the FMU's state. */
struct State {
    uint64_t size;     /* bytes of the whole block */
    uint64_t check;    /* of a serialised state: sum over token and block */
    double time;
    int32_t phase;
    int32_t begun;     /* the memory holds the start for the present values */
    int32_t observed;  /* the outputs are those of the present state and inputs */
    int32_t use;
    double content[];  /* values of inputs, parameters, outputs, states and derivatives; memory of the model */
};

struct Instance {
    Report report;
    void *environment, *function;
    State *state;
    void *scratch;
    char name[];
};

static size_t given_values(void) { return model_inputs + model_parameters; }
static size_t all_values(void) { return given_values() + model_outputs + 2 * model_states; }
static size_t state_size(void) { return sizeof(State) + all_values() * sizeof(double) + model_memory; }
static void *memory(Instance *instance) { return instance->state->content + all_values(); }

Status instance_error(Instance *instance, const char *text) {
    if (instance && instance->report)
        instance->report(instance->environment, instance->function, instance->name, text);
    return STATUS_ERROR;
}

Status instance_unsupported(Instance *instance, const char *function) {
    char text[MESSAGE_SIZE];
    snprintf(text, sizeof text, "%s is not provided by this FMU", function);
    return instance_error(instance, text);
}

static void clear(State *state) {
    int32_t use = state->use;
    memset(state, 0, state_size());
    state->use = use;
    state->size = state_size();
    memcpy(state->content, model_start, given_values() * sizeof(double));
}

Instance *instance_new(const char *name, const char *token, Use use, Report report, void *environment, void *function) {
    if (use == MODEL_EXCHANGE && model_states == 0) {
        if (report)
            report(environment, function, name ? name : "", "this FMU is for co-simulation");
        return NULL;
    }
    if (!name || !*name || !token || strcmp(token, model_token) != 0) {
        if (report)
            report(environment, function, name ? name : "",
                   name && *name ? "the token is not that of this FMU's modelDescription.xml"
                                 : "an instance needs a name");
        return NULL;
    }
    Instance *instance = calloc(1, sizeof(Instance) + strlen(name) + 1);
    State *state = calloc(1, state_size());
    void *scratch = calloc(1, model_scratch + 1);
    if (!instance || !state || !scratch) {
        free(instance);
        free(state);
        free(scratch);
        if (report)
            report(environment, function, name, "no memory for an instance");
        return NULL;
    }
    instance->report = report;
    instance->environment = environment;
    instance->function = function;
    instance->state = state;
    instance->scratch = scratch;
    strcpy(instance->name, name);
    state->use = (int32_t)use;
    clear(state);
    return instance;
}

void instance_free(Instance *instance) {
    if (!instance)
        return;
    free(instance->state);
    free(instance->scratch);
    free(instance);
}

static Status outcome(Instance *instance, int code, const char *message) {
    if (code == 0)
        return STATUS_OK;
    instance->state->phase = FAILED;
    return instance_error(instance, message);
}

static Status begin(Instance *instance) {
    State *state = instance->state;
    char message[MESSAGE_SIZE] = "";
    if (state->begun)
        return STATUS_OK;
    state->begun = 1;
    state->observed = 0;
    return outcome(instance, model_begin(memory(instance), instance->scratch, state->time, state->content, message),
                   message);
}

Status instance_set_start(Instance *instance, double t) {
    if (!instance)
        return STATUS_ERROR;
    if (instance->state->phase != CREATED)
        return instance_error(instance, "the start time is set before initialisation");
    if (!isfinite(t))
        return instance_error(instance, "the start time is not a finite number");
    instance->state->time = t;
    instance->state->begun = 0;
    return STATUS_OK;
}

Status instance_initialise(Instance *instance) {
    if (!instance)
        return STATUS_ERROR;
    if (instance->state->phase != CREATED)
        return instance_error(instance, "initialisation begins once, after instantiation or reset");
    instance->state->phase = INITIALISING;
    return STATUS_OK;
}

Status instance_run(Instance *instance) {
    if (!instance)
        return STATUS_ERROR;
    if (instance->state->phase != INITIALISING)
        return instance_error(instance, "initialisation ends where it has begun");
    if (begin(instance) != STATUS_OK)
        return STATUS_ERROR;
    instance->state->phase = RUNNING;
    return STATUS_OK;
}

Status instance_terminate(Instance *instance) {
    if (!instance)
        return STATUS_ERROR;
    if (instance->state->phase != RUNNING)
        return instance_error(instance, "only what runs can be terminated");
    instance->state->phase = TERMINATED;
    return STATUS_OK;
}

Status instance_reset(Instance *instance) {
    if (!instance)
        return STATUS_ERROR;
    clear(instance->state);
    return STATUS_OK;
}

/* Bring outputs, states and derivatives up to date. */
static Status observe(Instance *instance) {
    State *state = instance->state;
    char message[MESSAGE_SIZE] = "";
    if (state->observed)
        return STATUS_OK;
    if (begin(instance) != STATUS_OK)
        return STATUS_ERROR;
    double *outputs = state->content + given_values(), *states = outputs + model_outputs;
    int code = 0;
    if (model_states > 0) {
        model_get_states(memory(instance), states);
        code = model_derivatives(memory(instance), instance->scratch, state->time, state->content,
                                 states + model_states, message);
    }
    if (code == 0)
        code = model_observe(memory(instance), instance->scratch, state->time, state->content, outputs, message);
    if (outcome(instance, code, message) != STATUS_OK)
        return STATUS_ERROR;
    state->observed = 1;
    return STATUS_OK;
}

Status instance_get(Instance *instance, const uint32_t *references, size_t count, double *values) {
    if (!instance)
        return STATUS_ERROR;
    if (count > 0 && (!references || !values))
        return instance_error(instance, "no array of variables or values is given");
    State *state = instance->state;
    if (state->phase == FAILED)
        return instance_error(instance, "after a failed step there are no values; reset the instance or set a state");
    for (size_t k = 0; k < count; k++) {
        size_t reference = references[k];
        if (reference > all_values()) {
            char text[MESSAGE_SIZE];
            snprintf(text, sizeof text, "there is no variable of value reference %zu", reference);
            return instance_error(instance, text);
        }
        if (reference > given_values() && observe(instance) != STATUS_OK)
            return STATUS_ERROR;
        values[k] = reference == 0 ? state->time : state->content[reference - 1];
    }
    return STATUS_OK;
}

/* Sets all of the variables or, where one is refused, none. */
Status instance_set(Instance *instance, const uint32_t *references, size_t count, const double *values) {
    if (!instance)
        return STATUS_ERROR;
    if (count > 0 && (!references || !values))
        return instance_error(instance, "no array of variables or values is given");
    State *state = instance->state;
    if (state->phase == TERMINATED || state->phase == FAILED)
        return instance_error(instance, "values are set before and during a simulation, not after it");
    for (size_t k = 0; k < count; k++) {
        size_t reference = references[k];
        const char *fault = NULL;
        if (reference == 0 || reference > given_values())
            fault = "it is not an input or parameter";
        else if (reference > model_inputs && state->phase == RUNNING)
            fault = "a parameter is set before the simulation";
        else if (!isfinite(values[k]))
            fault = "the value is not a finite number";
        if (fault) {
            char text[MESSAGE_SIZE];
            snprintf(text, sizeof text, "value reference %zu cannot be set: %s", reference, fault);
            return instance_error(instance, text);
        }
    }
    for (size_t k = 0; k < count; k++)
        state->content[references[k] - 1] = values[k];
    state->observed = 0;
    if (state->phase != RUNNING)
        state->begun = 0;
    return STATUS_OK;
}

Status instance_step(Instance *instance, double t, double h) {
    if (!instance)
        return STATUS_ERROR;
    State *state = instance->state;
    char message[MESSAGE_SIZE] = "";
    if (state->phase != RUNNING || state->use != CO_SIMULATION)
        return instance_error(instance, "a step is taken in co-simulation, after initialisation and before termination");
    if (!(h > 0.0) || !isfinite(h) || !isfinite(t) || !isfinite(t + h))
        return instance_error(instance, "a communication step is a positive finite number");
    if (fabs(t - state->time) > 1e-3 * h + 1e-9 * fabs(t)) {
        snprintf(message, sizeof message, "a step is asked for at %.17g s, the instance is at %.17g s", t, state->time);
        return instance_error(instance, message);
    }
    int code = model_advance(memory(instance), instance->scratch, t, h, state->content, message);
    if (outcome(instance, code, message) != STATUS_OK)
        return STATUS_ERROR;
    state->time = t + h;
    state->observed = 0;
    return STATUS_OK;
}

Status instance_exchange(Instance *instance) {
    if (!instance)
        return STATUS_ERROR;
    if (instance->state->use != MODEL_EXCHANGE)
        return instance_error(instance, "this is a function of model exchange, and the instance is for co-simulation");
    if (instance->state->phase == FAILED || instance->state->phase == TERMINATED)
        return instance_error(instance, "the instance no longer runs; reset it or set a state");
    return STATUS_OK;
}

Status instance_set_time(Instance *instance, double t) {
    if (instance_exchange(instance) != STATUS_OK)
        return STATUS_ERROR;
    if (!isfinite(t) || instance->state->phase != RUNNING)
        return instance_error(instance, "a finite time is set after initialisation");
    instance->state->observed = instance->state->observed && instance->state->time == t;
    instance->state->time = t;
    return STATUS_OK;
}

Status instance_count_states(Instance *instance, size_t *count) {
    if (instance_exchange(instance) != STATUS_OK || !count)
        return STATUS_ERROR;
    *count = model_states;
    return STATUS_OK;
}

/* Whether there is a place for the states, or the model has none. */
static Status check_states(Instance *instance, const double *states, size_t count) {
    if (instance_exchange(instance) != STATUS_OK)
        return STATUS_ERROR;
    return count == model_states && states ? STATUS_OK
                                           : instance_error(instance, "there are as many numbers as continuous states");
}

Status instance_get_states(Instance *instance, double *states, size_t count) {
    if (check_states(instance, states, count) != STATUS_OK || begin(instance) != STATUS_OK)
        return STATUS_ERROR;
    model_get_states(memory(instance), states);
    return STATUS_OK;
}

Status instance_set_states(Instance *instance, const double *states, size_t count) {
    if (check_states(instance, states, count) != STATUS_OK)
        return STATUS_ERROR;
    if (instance->state->phase != RUNNING)
        return instance_error(instance, "states are set after initialisation");
    for (size_t k = 0; k < count; k++)
        if (!isfinite(states[k]))
            return instance_error(instance, "a state is not a finite number");
    model_set_states(memory(instance), states);
    instance->state->observed = 0;
    return STATUS_OK;
}

Status instance_get_derivatives(Instance *instance, double *derivatives, size_t count) {
    if (check_states(instance, derivatives, count) != STATUS_OK || observe(instance) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(derivatives, instance->state->content + all_values() - model_states, count * sizeof *derivatives);
    return STATUS_OK;
}

Status instance_get_nominals(Instance *instance, double *nominals, size_t count) {
    if (check_states(instance, nominals, count) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(nominals, model_nominal, count * sizeof *nominals);
    return STATUS_OK;
}

Status instance_direction(Instance *instance, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                          size_t n_knowns, const double *seed, double *sensitivity) {
    if (instance_exchange(instance) != STATUS_OK || observe(instance) != STATUS_OK)
        return STATUS_ERROR;
    size_t outputs = given_values() + 1, states = outputs + model_outputs, derivatives = states + model_states;
    for (size_t k = 0; k < n_unknowns; k++)
        if (unknowns[k] < outputs || unknowns[k] > all_values() || (unknowns[k] >= states && unknowns[k] < derivatives))
            return instance_error(instance, "derivatives are those of outputs and of the states' rates");
    for (size_t k = 0; k < n_knowns; k++)
        if (knowns[k] == 0 || (knowns[k] > model_inputs && knowns[k] < states) || knowns[k] >= derivatives)
            return instance_error(instance, "derivatives are by inputs and states");
    double *work = calloc(all_values() + 1, sizeof *work); /* by value reference */
    if (!work)
        return instance_error(instance, "no memory for a derivative");
    for (size_t k = 0; k < n_knowns; k++)
        work[knowns[k]] += seed[k];
    char message[MESSAGE_SIZE] = "";
    int code = model_direction(memory(instance), instance->scratch, instance->state->time, instance->state->content,
                               work + 1, work + states, work + outputs, work + derivatives, message);
    for (size_t k = 0; k < n_unknowns; k++)
        sensitivity[k] = work[unknowns[k]];
    free(work);
    return code == 0 ? STATUS_OK : instance_error(instance, message);
}

double instance_time(const Instance *instance) { return instance->state->time; }

Status instance_log_categories(Instance *instance, size_t count, const char *const *categories) {
    if (!instance)
        return STATUS_ERROR;
    for (size_t k = 0; k < count; k++)
        if (!categories || !categories[k] || strcmp(categories[k], "logStatusError") != 0)
            return instance_error(instance, "the one category of messages is logStatusError");
    return STATUS_OK;
}

Status instance_keep(Instance *instance, State **kept) {
    if (!instance || !kept)
        return instance_error(instance, "no place for a state is given");
    State *state = *kept ? *kept : malloc(state_size());
    if (!state)
        return instance_error(instance, "no memory for a state");
    memcpy(state, instance->state, state_size());
    *kept = state;
    return STATUS_OK;
}

Status instance_restore(Instance *instance, const State *kept) {
    if (!instance || !kept || kept->size != state_size())
        return instance_error(instance, "this is not a state of the FMU");
    memcpy(instance->state, kept, state_size());
    return STATUS_OK;
}

Status instance_forget(Instance *instance, State **kept) {
    if (!instance)
        return STATUS_ERROR;
    if (kept) {
        free(*kept);
        *kept = NULL;
    }
    return STATUS_OK;
}

Status instance_size(Instance *instance, const State *kept, size_t *size) {
    if (!instance || !kept || !size || kept->size != state_size())
        return instance_error(instance, "this is not a state of the FMU");
    *size = state_size();
    return STATUS_OK;
}

/* FNV-1a over the token and a block whose own sum is zero. */
static uint64_t sum(const State *state) {
    uint64_t hash = 14695981039346656037u;
    for (const char *c = model_token; *c; c++)
        hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    const unsigned char *bytes = (const unsigned char *)state;
    for (size_t k = 0; k < state_size(); k++)
        hash = (hash ^ bytes[k]) * 1099511628211u;
    return hash;
}

Status instance_serialise(Instance *instance, const State *kept, unsigned char *bytes, size_t size) {
    if (!instance || !kept || !bytes || kept->size != state_size() || size < state_size())
        return instance_error(instance, "this is not a state of the FMU, or no room for it");
    State *copy = malloc(state_size());
    if (!copy)
        return instance_error(instance, "no memory for a state");
    memcpy(copy, kept, state_size());
    copy->check = 0;
    copy->check = sum(copy);
    memcpy(bytes, copy, state_size());
    free(copy);
    return STATUS_OK;
}

Status instance_deserialise(Instance *instance, const unsigned char *bytes, size_t size, State **kept) {
    if (!instance || !bytes || !kept || size != state_size())
        return instance_error(instance, "these bytes are not a state of this FMU");
    State *state = malloc(state_size());
    if (!state)
        return instance_error(instance, "no memory for a state");
    memcpy(state, bytes, state_size());
    uint64_t check = state->check;
    state->check = 0;
    if (state->size != state_size() || check != sum(state)) {
        free(state);
        return instance_error(instance, "these bytes are not a state of this FMU");
    }
    *kept = state;
    return STATUS_OK;
}
