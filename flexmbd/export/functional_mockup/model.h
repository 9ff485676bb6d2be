/* What a model gives to the layers of FMI 2 and FMI 3. Its variables are real numbers, by value reference: 0 the time,
   then its inputs, its parameters and its outputs, in this order. */
#ifndef FLEXMBD_MODEL_H
#define FLEXMBD_MODEL_H

#include <stddef.h>

#define MESSAGE_SIZE 256

extern const char model_token[];      /* as in modelDescription.xml */
extern const size_t model_inputs;     /* numbers of variables */
extern const size_t model_parameters;
extern const size_t model_outputs;
extern const double model_start[];    /* of inputs and parameters */
extern const size_t model_memory;     /* bytes of an instance's state: no pointers, as it is copied and stored */
extern const size_t model_scratch;    /* bytes of what can be computed again from state and arguments; zero at first */

/* Each returns 0, or writes a message and returns something else. "given" are the inputs, then the parameters. */
int model_begin(void *memory, void *scratch, double t, const double *given, char *message);
int model_advance(void *memory, void *scratch, double t, double h, const double *given, char *message);
int model_observe(void *memory, void *scratch, double t, const double *given, double *outputs, char *message);

#endif
