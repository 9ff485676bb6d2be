/* A whole machine: its kernels step it from one communication point to the next, with the inputs held. */
#include "machine.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model.h"

/* Numba's kernels call this to see contiguous arrays in another shape: strides follow from the shape alone. */
int numba_attempt_nocopy_reshape(intptr_t nd, const intptr_t *shape, const intptr_t *strides, intptr_t new_nd,
                                 const intptr_t *new_shape, intptr_t *new_strides, intptr_t itemsize, int fortran);

int numba_attempt_nocopy_reshape(intptr_t nd, const intptr_t *shape, const intptr_t *strides, intptr_t new_nd,
                                 const intptr_t *new_shape, intptr_t *new_strides, intptr_t itemsize, int fortran) {
    (void)nd, (void)shape, (void)strides;
    for (intptr_t k = new_nd - 1; k >= 0; k--) {
        new_strides[k] = itemsize;
        itemsize *= new_shape[k];
    }
    return !fortran;
}

static void take(void *memory, const double *given) {
    for (size_t k = 0; k < model_inputs; k++)
        memcpy((unsigned char *)memory + machine_input_places[k], &given[k], sizeof given[k]);
}

int model_begin(void *memory, void *scratch, double t, const double *given, char *message) {
    (void)scratch;
    if (machine_follows_time && t != machine_start_time) {
        snprintf(message, MESSAGE_SIZE, "the simulation begins at %g s; this machine follows the time and starts at %g s",
                 t, machine_start_time);
        return 1;
    }
    memcpy(memory, machine_image, model_memory);
    take(memory, given);
    double *numbers = (double *)((unsigned char *)memory + machine_numbers);
    numbers[machine_time] = t;
    return 0;
}

int model_advance(void *memory, void *scratch, double t, double h, const double *given, char *message) {
    (void)scratch;
    double *numbers = (double *)((unsigned char *)memory + machine_numbers);
    int64_t *counts = (int64_t *)((unsigned char *)memory + machine_counts);
    double steps = fmax(1.0, ceil(h / machine_step - 1e-9));
    if (steps > 1e9) {
        snprintf(message, MESSAGE_SIZE, "a step of %g s asks for %g steps of the integrator", h, steps);
        return 1;
    }
    take(memory, given);
    numbers[machine_time] = t;
    numbers[machine_time_end] = t + h;
    numbers[machine_step_size] = h / steps;
    int64_t code;
    do {
        counts[machine_stored] = 0;
        code = machine_run(memory);
    } while (code == machine_output);
    if (code == machine_done)
        return 0;
    snprintf(message, MESSAGE_SIZE, "the step at %g s failed (code %d): the machine cannot be there, or the integrator's "
             "step is too long for it", numbers[machine_time], (int)code);
    return 1;
}

int model_observe(void *memory, void *scratch, double t, const double *given, double *outputs, char *message) {
    (void)scratch, (void)t, (void)given;
    if (machine_frames(memory) != 0) {
        snprintf(message, MESSAGE_SIZE, "the frames' motion cannot be computed");
        return 1;
    }
    for (size_t k = 0; k < model_outputs; k++)
        memcpy(&outputs[k], (unsigned char *)memory + machine_output_places[k], sizeof outputs[k]);
    return 0;
}
