/* An instance of the model, as both versions of FMI see it. */
#ifndef FLEXMBD_INSTANCE_H
#define FLEXMBD_INSTANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* The numbers are those of fmi2Status and fmi3Status. */
typedef enum { STATUS_OK = 0, STATUS_ERROR = 3 } Status;

typedef struct Instance Instance;
typedef struct State State;

/* Called with each error; the text has no percent signs. */
typedef void (*Report)(void *environment, void *function, const char *name, const char *text);

/* How an instance is used: its host takes communication steps, or has the solver. */
typedef enum { CO_SIMULATION, MODEL_EXCHANGE } Use;

Instance *instance_new(const char *name, const char *token, Use use, Report report, void *environment, void *function);
void instance_free(Instance *instance);
Status instance_error(Instance *instance, const char *text);
Status instance_unsupported(Instance *instance, const char *function);

Status instance_set_start(Instance *instance, double t);
Status instance_initialise(Instance *instance);
Status instance_run(Instance *instance);
Status instance_terminate(Instance *instance);
Status instance_reset(Instance *instance);
Status instance_get(Instance *instance, const uint32_t *references, size_t count, double *values);
Status instance_set(Instance *instance, const uint32_t *references, size_t count, const double *values);
Status instance_step(Instance *instance, double t, double h);
double instance_time(const Instance *instance);
Status instance_log_categories(Instance *instance, size_t count, const char *const *categories);

/* Of model exchange alone. */
Status instance_exchange(Instance *instance); /* whether this is one */
Status instance_set_time(Instance *instance, double t);
Status instance_count_states(Instance *instance, size_t *count);
Status instance_get_states(Instance *instance, double *states, size_t count);
Status instance_set_states(Instance *instance, const double *states, size_t count);
Status instance_get_derivatives(Instance *instance, double *derivatives, size_t count);
Status instance_get_nominals(Instance *instance, double *nominals, size_t count);
Status instance_direction(Instance *instance, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                          size_t n_knowns, const double *seed, double *sensitivity);

Status instance_keep(Instance *instance, State **kept);
Status instance_restore(Instance *instance, const State *kept);
Status instance_forget(Instance *instance, State **kept);
Status instance_size(Instance *instance, const State *kept, size_t *size);
Status instance_serialise(Instance *instance, const State *kept, unsigned char *bytes, size_t size);
Status instance_deserialise(Instance *instance, const unsigned char *bytes, size_t size, State **kept);

#endif
