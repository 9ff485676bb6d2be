/* A tree of joints whose rates are velocities, as a system of first order: states (x, v), derivatives (v, a).

   Directional derivatives are exact: of accelerations by the tangent of the residual, M da = -(K dx + C dv) + df, of
   places by velocities, which are linear in v, and of velocities by the accelerations that v alone causes, which are
   quadratic in it: d(J v)/dx w = (A(v + w) - A(v - w)) / 4, as second derivatives of a place commute. */
#include "lapack.h"
#include "machine.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

enum { PLACE = 0, AXES = 3, RATE = 12, SPIN = 15, ACCELERATION = 18, ROW = 21 }; /* of a frame's row */

static double *at(void *memory, size_t place) { return (double *)((unsigned char *)memory + place); }

static double largest(const double *values, size_t count) {
    double size = 0.0;
    for (size_t k = 0; k < count; k++)
        size = fmax(size, fabs(values[k]));
    return size;
}

static void put_inputs(void *memory, const double *given, const double *changes, double scale) {
    for (size_t k = 0; k < model_inputs; k++) {
        double value = given[k] + scale * changes[k];
        memcpy((unsigned char *)memory + machine_input_places[k], &value, sizeof value);
    }
}

void model_get_states(const void *memory, double *states) {
    size_t n = machine_velocities;
    memcpy(states, (const unsigned char *)memory + machine_x, n * sizeof *states);
    memcpy(states + n, (const unsigned char *)memory + machine_v, n * sizeof *states);
}

void model_set_states(void *memory, const double *states) {
    size_t n = machine_velocities;
    memcpy(at(memory, machine_x), states, n * sizeof *states);
    memcpy(at(memory, machine_v), states + n, n * sizeof *states);
}

int model_derivatives(void *memory, void *scratch, double t, const double *given, double *derivatives, char *message) {
    (void)scratch;
    size_t n = machine_velocities;
    machine_bind(memory);
    put_inputs(memory, given, given, 0.0);
    if (machine_accelerate(memory, t, message) != 0)
        return 1;
    memcpy(derivatives, at(memory, machine_v), n * sizeof *derivatives);
    memcpy(derivatives + n, at(memory, machine_accelerations), n * sizeof *derivatives);
    return 0;
}

/* Change of the accelerations (n), which are those of the state and the inputs; work holds 2 n numbers and n pivots. */
static int change_accelerations(void *memory, double t, const double *given, const double *input_changes,
                                const double *dx, const double *dv, double *da, double *work, int *pivot,
                                char *message) {
    size_t n = machine_velocities;
    int size = (int)n, one = 1, info;
    double *a = at(memory, machine_accelerations), *mass = at(memory, machine_mass), *before = work;
    const double *damping = at(memory, machine_damping), *stiffness = at(memory, machine_stiffness);
    if (machine_tangents(memory) != 0) {
        snprintf(message, MESSAGE_SIZE, "the tangent cannot be computed at %g s", t);
        return 1;
    }
    for (size_t i = 0; i < n; i++) {
        da[i] = 0.0;
        for (size_t j = 0; j < n; j++)
            da[i] -= stiffness[i * n + j] * dx[j] + damping[i * n + j] * dv[j];
    }
    machine_dgetrf(&size, &size, mass, &size, pivot, &info); /* column by column the same, as it is symmetric */
    if (info == 0)
        machine_dgetrs("T", &size, &one, mass, &size, pivot, da, &size, &info);
    if (info != 0) {
        snprintf(message, MESSAGE_SIZE, "the mass matrix is singular at %g s", t);
        return 1;
    }
    double change = largest(input_changes, model_inputs);
    if (change == 0.0)
        return 0;
    double scale = (1.0 + largest(given, model_inputs)) / change; /* accelerations are linear in the inputs */
    memcpy(before, a, n * sizeof *a);
    put_inputs(memory, given, input_changes, scale);
    int failed = machine_accelerate(memory, t, message);
    for (size_t i = 0; i < n; i++)
        da[i] += (a[i] - before[i]) / scale;
    put_inputs(memory, given, given, 0.0);
    return failed != 0 || machine_accelerate(memory, t, message) != 0;
}

/* Rows of the frames with these velocities in place of the state's, and these accelerations; 0, or -1. */
static int frames_with(void *memory, const double *v, const double *w, double scale, double *rows) {
    size_t n = machine_velocities;
    double *there = at(memory, machine_v), *a = at(memory, machine_accelerations);
    for (size_t i = 0; i < n; i++) {
        there[i] = (v ? v[i] : 0.0) + scale * w[i];
        a[i] = 0.0;
    }
    int failed = machine_frames(memory);
    for (size_t f = 0; f < machine_frame_rows; f++)
        memcpy(rows + f * ROW, at(memory, machine_frame_places[f]), ROW * sizeof *rows);
    return failed;
}

/* Put the change of each frame's row into its place; velocities and accelerations in the memory are used up. */
static int change_frames(void *memory, const double *v, const double *dx, const double *dv, double *rows) {
    size_t count = machine_frame_rows * ROW, n = machine_velocities;
    double *moved = rows, *faster = rows + count, *ahead = rows + 2 * count, *behind = rows + 3 * count;
    double speed = largest(v, n), size = largest(dx, n), scale = size > 0.0 && speed > 0.0 ? speed / size : 0.0;
    int failed = frames_with(memory, NULL, dv, 1.0, faster);
    failed |= frames_with(memory, v, dx, scale, ahead);
    failed |= frames_with(memory, v, dx, -scale, behind);
    failed |= frames_with(memory, NULL, dx, 1.0, moved);
    for (size_t f = 0; f < machine_frame_rows; f++) {
        double *row = at(memory, machine_frame_places[f]), axes[9];
        const double *turn = moved + f * ROW + SPIN;
        memcpy(axes, row + AXES, sizeof axes);
        for (size_t k = 0; k < 3; k++) {
            size_t next = (k + 1) % 3, last = (k + 2) % 3, here = f * ROW + k;
            row[PLACE + k] = moved[here + RATE];
            for (size_t j = 0; j < 3; j++)
                row[AXES + 3 * k + j] = turn[next] * axes[3 * last + j] - turn[last] * axes[3 * next + j];
            row[RATE + k] = faster[here + RATE];
            if (scale > 0.0)
                row[RATE + k] += (ahead[here + ACCELERATION] - behind[here + ACCELERATION]) / (4.0 * scale);
        }
    }
    return failed;
}

int model_direction(void *memory, void *scratch, double t, const double *given, const double *input_changes,
                    const double *state_changes, double *output_changes, double *derivative_changes, char *message) {
    (void)scratch;
    size_t n = machine_velocities, states = 2 * n;
    const double *dx = state_changes, *dv = state_changes + n;
    double *da = derivative_changes + n, *x = at(memory, machine_x), *v = at(memory, machine_v);
    double *a = at(memory, machine_accelerations);
    double *work = malloc((states + 3 * n + 4 * machine_frame_rows * ROW) * sizeof *work);
    int *pivot = malloc((n + 1) * sizeof *pivot);
    int failed = !work || !pivot;
    if (failed)
        snprintf(message, MESSAGE_SIZE, "no memory for a derivative");
    else {
        double *kept = work, *kept_a = work + states, *rows = work + states + 3 * n;
        memcpy(derivative_changes, dv, n * sizeof *dv);
        model_get_states(memory, kept);
        memcpy(kept_a, a, n * sizeof *a);
        failed = change_accelerations(memory, t, given, input_changes, dx, dv, da, kept_a + n, pivot, message);
        if (!failed && change_frames(memory, kept + n, dx, dv, rows) != 0) {
            failed = 1;
            snprintf(message, MESSAGE_SIZE, "the frames' motion cannot be computed");
        }
        memcpy(x, dx, n * sizeof *x);
        memcpy(v, dv, n * sizeof *v);
        memcpy(a, da, n * sizeof *a);
        for (size_t k = 0; k < model_outputs; k++)
            memcpy(&output_changes[k], (unsigned char *)memory + machine_output_places[k], sizeof *output_changes);
        model_set_states(memory, kept);
        memcpy(a, kept_a, n * sizeof *a);
    }
    free(work);
    free(pivot);
    return failed;
}
