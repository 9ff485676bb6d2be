/* A whole machine: its kernels step it from one communication point to the next, with the inputs held.
 * Steps end at the breaks of its functions of time and begin anew there, as flexmbd's stepping.py does it. */
#include "machine.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model.h"

/* Kernels call this to see contiguous arrays in another shape: strides follow from the shape alone. Whole numbers and
   addresses come as they do in the kernels, without a sign. */
uint32_t numba_attempt_nocopy_reshape(uint64_t nd, uint64_t shape, uint64_t strides, uint64_t new_nd, uint64_t new_shape,
                                      uint64_t new_strides, uint64_t itemsize, uint32_t fortran);

uint32_t numba_attempt_nocopy_reshape(uint64_t nd, uint64_t shape, uint64_t strides, uint64_t new_nd, uint64_t new_shape,
                                      uint64_t new_strides, uint64_t itemsize, uint32_t fortran) {
    const int64_t *sizes = (const int64_t *)(uintptr_t)new_shape;
    int64_t *found = (int64_t *)(uintptr_t)new_strides, step = (int64_t)itemsize;
    (void)nd, (void)shape, (void)strides;
    for (uint64_t k = new_nd; k-- > 0;) {
        found[k] = step;
        step *= sizes[k];
    }
    return !fortran;
}

static const double sliver = 1e-6; /* of a step: what rounding of the time leaves, no step of its own */

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

/* How far from a break at t is beside it: more than rounding of a product or a quotient there. */
static double beside(double t) {
    double size = fmax(fabs(t), 1.0);
    return 8.0 * (nextafter(size, 2.0 * size) - size);
}

static double first_after(const double *times, size_t count, double t) {
    size_t low = 0, high = count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (times[middle] > t)
            high = middle;
        else
            low = middle + 1;
    }
    return low < count ? times[low] : INFINITY;
}

/* The first break after t; infinite where there is none. */
static double break_after(double t) {
    return first_after(machine_break_times, machine_breaks, t);
}

/* After a jump of the inputs or a break: accelerations and reactions anew, by a method that remembers nothing. */
static int restart(void *memory, double t, char *message) {
    unsigned char *bytes = memory;
    double *numbers = numbers_of(memory), kept_numbers[MOST_ENTRIES];
    int64_t *counts = counts_of(memory), kept_counts[MOST_ENTRIES];
    memcpy(kept_numbers, numbers, (size_t)machine_number_entries * sizeof *numbers);
    memcpy(kept_counts, counts, (size_t)machine_count_entries * sizeof *counts);
    prepare(memory, t, 1.0);
    numbers[machine_latest] = INFINITY;
    int64_t code = machine_refresh(bytes);
    memcpy(numbers, kept_numbers, (size_t)machine_number_entries * sizeof *numbers);
    memcpy(counts, kept_counts, (size_t)machine_count_entries * sizeof *counts);
    if (code != machine_full) {
        snprintf(message, MESSAGE_SIZE, "no accelerations can be found at %g s (code %d)", t, (int)code);
        return 1;
    }
    for (size_t k = 0; k < machine_own_arrays; k++)
        memcpy(bytes + machine_own_places[k], machine_image + machine_own_places[k], machine_own_sizes[k]);
    for (size_t k = 0; k < machine_histories; k++)
        memcpy(bytes + machine_history_places[k], bytes + machine_accelerations, machine_velocities * sizeof(double));
    return 0;
}

int machine_accelerate(void *memory, double t, char *message) { return restart(memory, t, message); }

/* One step from a to b, or what functions of time divide it into; a break lies at neither's far side. */
static int move(void *memory, double a, double b, double size, char *message) {
    double *numbers = numbers_of(memory), ahead = break_after(a + sliver * size);
    numbers[machine_latest] = ahead <= b + sliver * size ? ahead - beside(ahead) : INFINITY;
    prepare(memory, a, fabs(b - a - size) <= 1e-9 * size ? size : b - a);
    do {
        counts_of(memory)[machine_stored] = 0;
        int64_t code = machine_run(memory);
        if (code != machine_full) {
            snprintf(message, MESSAGE_SIZE, "the step at %g s failed (code %d): the machine cannot be there, or the "
                     "integrator's step is too long for it", numbers[machine_time], (int)code);
            return 1;
        }
    } while (numbers[machine_rest] > 0.0);
    return 0;
}

/* Steps from a to b that end and begin at each break between them. */
static int cross(void *memory, double a, double b, double size, char *message) {
    for (double next = break_after(a - sliver * size); next < b - sliver * size; next = break_after(next)) {
        if (next > a + sliver * size) {
            if (move(memory, a, next, size, message) != 0)
                return 1;
            a = next;
        }
        double impulse = first_after(machine_impulse_times, machine_impulses, next - beside(next));
        if (next > machine_start_time && impulse <= next) {
            snprintf(message, MESSAGE_SIZE, "the rate of a prescribed motion jumps at %g s, and the impulse of that is "
                     "not known here", next);
            return 1;
        }
        if (restart(memory, next + beside(next), message) != 0)
            return 1;
    }
    return move(memory, a, b, size, message);
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
        if (cross(memory, t + k * size, t + (k + 1.0) * size, size, message) != 0)
            return 1;
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
