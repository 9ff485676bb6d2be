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

static double *numbers_of(void *memory) { return (double *)((unsigned char *)memory + machine_numbers); }
static int64_t *counts_of(void *memory) { return (int64_t *)((unsigned char *)memory + machine_counts); }

/* Put the inputs where the kernels read them; whether any has changed. */
static int take(void *memory, const double *given) {
    int changed = 0;
    for (size_t k = 0; k < model_inputs; k++) {
        unsigned char *place = (unsigned char *)memory + machine_input_places[k];
        changed |= memcmp(place, &given[k], sizeof given[k]) != 0;
        memcpy(place, &given[k], sizeof given[k]);
    }
    machine_bind(memory);
    return changed;
}

/* Ask for one step of this very size: the record takes one, and the end lies beyond it. */
static void prepare(void *memory, double t, double size) {
    double *numbers = numbers_of(memory);
    numbers[machine_time] = t;
    numbers[machine_time_end] = t + 2.0 * size;
    numbers[machine_step_size] = size;
    counts_of(memory)[machine_stored] = 0;
}

/* After a jump of the inputs: accelerations and reactions anew, and a method that remembers nothing of before. */
static int restart(void *memory, double t, char *message) {
    unsigned char *bytes = memory;
    double *numbers = numbers_of(memory), kept_numbers[MOST_ENTRIES];
    int64_t *counts = counts_of(memory), kept_counts[MOST_ENTRIES];
    memcpy(kept_numbers, numbers, (size_t)machine_number_entries * sizeof *numbers);
    memcpy(kept_counts, counts, (size_t)machine_count_entries * sizeof *counts);
    prepare(memory, t, 1.0);
    int64_t code = machine_refresh(bytes);
    memcpy(numbers, kept_numbers, (size_t)machine_number_entries * sizeof *numbers);
    memcpy(counts, kept_counts, (size_t)machine_count_entries * sizeof *counts);
    if (code != machine_full) {
        snprintf(message, MESSAGE_SIZE, "no accelerations can be found at %g s (code %d)", t, (int)code);
        return 1;
    }
    const unsigned char *first = machine_image;
    for (int k = machine_own_numbers; k < machine_number_entries; k++)
        memcpy(&numbers[k], first + machine_numbers + (size_t)k * sizeof *numbers, sizeof *numbers);
    for (int k = machine_own_counts; k < machine_count_entries; k++)
        memcpy(&counts[k], first + machine_counts + (size_t)k * sizeof *counts, sizeof *counts);
    size_t row = machine_velocities * sizeof(double);
    for (size_t k = 0; k < machine_history_rows; k++)
        memcpy(bytes + machine_history + k * row, bytes + machine_accelerations, row);
    return 0;
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
    numbers_of(memory)[machine_time] = t;
    return restart(memory, t, message);
}

int model_advance(void *memory, void *scratch, double t, double h, const double *given, char *message) {
    (void)scratch;
    double steps = fmax(1.0, ceil(h / machine_step - 1e-9)), size = h / steps;
    if (steps > 1e9) {
        snprintf(message, MESSAGE_SIZE, "a step of %g s asks for %g steps of the integrator", h, steps);
        return 1;
    }
    if (fabs(size - machine_step) <= 1e-9 * machine_step)
        size = machine_step; /* rounding alone is between them, and methods keep what belongs to a size */
    if (take(memory, given) && restart(memory, t, message) != 0)
        return 1;
    for (double k = 0.0; k < steps; k += 1.0) {
        prepare(memory, t + k * size, size);
        int64_t code = machine_run(memory);
        if (code != machine_full) {
            snprintf(message, MESSAGE_SIZE, "the step at %g s failed (code %d): the machine cannot be there, or the "
                     "integrator's step is too long for it", t + k * size, (int)code);
            return 1;
        }
    }
    return 0;
}

int model_observe(void *memory, void *scratch, double t, const double *given, double *outputs, char *message) {
    (void)scratch;
    if (take(memory, given) && restart(memory, t, message) != 0)
        return 1;
    if (machine_frames(memory) != 0) {
        snprintf(message, MESSAGE_SIZE, "the frames' motion cannot be computed");
        return 1;
    }
    for (size_t k = 0; k < model_outputs; k++)
        memcpy(&outputs[k], (unsigned char *)memory + machine_output_places[k], sizeof outputs[k]);
    return 0;
}
