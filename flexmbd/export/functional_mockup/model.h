/* What a model gives to the layers of FMI 2 and FMI 3. Its variables are real numbers, by value reference: 0 the time,
   then its inputs, its parameters, its outputs, its continuous states and their derivatives, in this order. */
#ifndef FLEXMBD_MODEL_H
#define FLEXMBD_MODEL_H

#include <stddef.h>

#define MESSAGE_SIZE 256

extern const char model_token[];      /* as in modelDescription.xml */
extern const size_t model_inputs;     /* numbers of variables */
extern const size_t model_parameters;
extern const size_t model_outputs;
extern const size_t model_states;     /* of model exchange; none where the unit is for co-simulation alone */
extern const double model_nominal[];  /* of the states: sizes that a solver's absolute tolerances follow */
extern const double model_start[];    /* of inputs and parameters */
extern const size_t model_memory;     /* bytes of an instance's state: no pointers, as it is copied and stored */
extern const size_t model_scratch;    /* bytes of what can be computed again from state and arguments; zero at first */

/* Each returns 0, or writes a message and returns something else. "given" are the inputs, then the parameters. */
int model_begin(void *memory, void *scratch, double t, const double *given, char *message);
int model_advance(void *memory, void *scratch, double t, double h, const double *given, char *message);
int model_observe(void *memory, void *scratch, double t, const double *given, double *outputs, char *message);

/* Of model exchange. The derivatives are found first, then what else is observed; a directional derivative is taken
   where the derivatives were found last. */
void model_get_states(const void *memory, double *states);
void model_set_states(void *memory, const double *states);
int model_derivatives(void *memory, void *scratch, double t, const double *given, double *derivatives, char *message);
int model_direction(void *memory, void *scratch, double t, const double *given, const double *input_changes,
                    const double *state_changes, double *output_changes, double *derivative_changes, char *message);

#endif
