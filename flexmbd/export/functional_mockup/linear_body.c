/* A reduced body near rest, its frame B clamped: exact for inputs that are held over a communication step.

   With the static response q_s = K^-1 B u to the inputs held, (w (q - q_s), q') follows x' = A x with
   A = [[0, w], [-w, -D]] and w = sqrt(K), so that x(t + h) = exp(A h) x(t). Modes that no damping couples have
   matrices of two rows each. */
#include "linear_body.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model.h"

/* Outputs: r displacements and rotations, their r rates, six reactions. Two parameters: a damping ratio; the share of
   the static response to the first inputs that the body starts with. States: q and its rate. */

static size_t block_modes(void) { return body_coupled ? body_modes : 1; }
static size_t blocks(void) { return body_coupled ? 1 : body_modes; }
static size_t block_entries(void) { return 4 * block_modes() * block_modes(); }

static double damping(size_t i, size_t j, double ratio) {
    double added = i == j ? 2.0 * ratio * sqrt(body_stiffness[i]) : 0.0;
    return body_damping[i * body_modes + j] + added;
}

static double forces(const double *inputs, size_t mode) {
    double sum = 0.0;
    for (size_t j = 0; j < model_inputs; j++)
        sum += body_input[mode * model_inputs + j] * inputs[j];
    return sum;
}

static void multiply(const double *a, const double *b, double *out, size_t m) {
    memset(out, 0, m * m * sizeof *out);
    for (size_t i = 0; i < m; i++)
        for (size_t k = 0; k < m; k++)
            for (size_t j = 0; j < m; j++)
                out[i * m + j] += a[i * m + k] * b[k * m + j];
}

/* exp(a) - 1 of an (m, m) matrix, which is used up: a Taylor polynomial of a / 2^s, then squared s times. Without the
   one, slow modes keep their digits beside fast ones. */
static void exponential_less_one(double *a, double *out, double *power, size_t m) {
    double norm = 0.0;
    for (size_t i = 0; i < m; i++) {
        double row = 0.0;
        for (size_t j = 0; j < m; j++)
            row += fabs(a[i * m + j]);
        norm = row > norm ? row : norm;
    }
    int squarings = 0;
    for (; norm > 0.5 && squarings < 1000; squarings++)
        norm *= 0.5;
    for (size_t k = 0; k < m * m; k++)
        a[k] = ldexp(a[k], -squarings);
    /* a (1 + a/2 (1 + a/3 (...))), whose first term left out is below 1e-18 */
    memcpy(out, a, m * m * sizeof *out);
    for (size_t k = 0; k < m * m; k++)
        out[k] /= 15.0;
    for (int order = 14; order >= 1; order--) {
        for (size_t i = 0; i < m; i++)
            out[i * m + i] += 1.0;
        multiply(a, out, power, m);
        for (size_t k = 0; k < m * m; k++)
            out[k] = power[k] / order;
    }
    for (int k = 0; k < squarings; k++) {
        multiply(out, out, power, m);
        for (size_t j = 0; j < m * m; j++)
            out[j] = 2.0 * out[j] + power[j];
    }
}

/* Scratch: the step and the damping ratio that the matrices are for; for each block exp(A h) - 1; two matrices;
   a vector and its change. */
static double *propagators(double *scratch, double h, double ratio) {
    double *all = scratch + 2, *a = all + blocks() * block_entries(), *power = a + block_entries();
    if (scratch[0] == h && scratch[1] == ratio)
        return all;
    size_t n = block_modes(), m = 2 * n;
    for (size_t block = 0; block < blocks(); block++) {
        memset(a, 0, block_entries() * sizeof *a);
        for (size_t i = 0; i < n; i++) {
            double w = sqrt(body_stiffness[block * n + i]);
            a[i * m + n + i] = w * h;
            a[(n + i) * m + i] = -w * h;
            for (size_t j = 0; j < n; j++)
                a[(n + i) * m + n + j] = -damping(block * n + i, block * n + j, ratio) * h;
        }
        exponential_less_one(a, all + block * block_entries(), power, m);
    }
    scratch[0] = h;
    scratch[1] = ratio;
    return all;
}

int model_begin(void *memory, void *scratch, double t, const double *given, char *message) {
    (void)scratch, (void)t;
    double *q = memory;
    memset(memory, 0, model_memory);
    for (size_t i = 0; i < body_modes; i++)
        q[i] = given[model_inputs + 1] * forces(given, i) / body_stiffness[i];
    if (given[model_inputs] >= 0.0)
        return 0;
    snprintf(message, MESSAGE_SIZE, "damping_ratio is %g; it adds damping and is not negative", given[model_inputs]);
    return 1;
}

int model_advance(void *memory, void *scratch, double t, double h, const double *given, char *message) {
    double *q = memory, *v = q + body_modes;
    double *change = propagators(scratch, h, given[model_inputs]);
    size_t n = block_modes(), m = 2 * n;
    double *x = (double *)scratch + 2 + (blocks() + 2) * block_entries(), *dx = x + m;
    double size = 0.0;
    for (size_t block = 0; block < blocks(); block++, change += block_entries()) {
        for (size_t i = 0; i < n; i++) {
            size_t mode = block * n + i;
            x[i] = sqrt(body_stiffness[mode]) * (q[mode] - forces(given, mode) / body_stiffness[mode]);
            x[n + i] = v[mode];
        }
        for (size_t i = 0; i < m; i++) {
            dx[i] = 0.0;
            for (size_t j = 0; j < m; j++)
                dx[i] += change[i * m + j] * x[j];
            size += fabs(dx[i]);
        }
        for (size_t i = 0; i < n; i++) {
            q[block * n + i] += dx[i] / sqrt(body_stiffness[block * n + i]);
            v[block * n + i] += dx[n + i];
        }
    }
    if (isfinite(size))
        return 0;
    snprintf(message, MESSAGE_SIZE, "the motion is no longer finite after %g s; look for a diverging input", t);
    return 1;
}

/* q'' of modes q that move with v, under a force on each mode */
static double acceleration(const double *q, const double *v, double force, size_t mode, double ratio) {
    double sum = force - body_stiffness[mode] * q[mode];
    for (size_t j = 0; j < body_modes; j++)
        sum -= damping(mode, j, ratio) * v[j];
    return sum;
}

/* The outputs, which are linear in q, v and the inputs. */
static void outputs_of(const double *q, const double *v, const double *inputs, double ratio, double *outputs) {
    size_t n = body_modes, rows = body_frame_rows;
    for (size_t k = 0; k < rows; k++) {
        outputs[k] = outputs[rows + k] = 0.0;
        for (size_t i = 0; i < n; i++) {
            outputs[k] += body_frames[k * n + i] * q[i];
            outputs[rows + k] += body_frames[k * n + i] * v[i];
        }
    }
    double *reaction = outputs + 2 * rows;
    for (size_t k = 0; k < 6; k++) {
        reaction[k] = 0.0;
        for (size_t j = 0; j < model_inputs; j++)
            reaction[k] -= body_applied[k * model_inputs + j] * inputs[j];
    }
    for (size_t i = 0; i < n; i++) {
        double a = acceleration(q, v, forces(inputs, i), i, ratio);
        for (size_t k = 0; k < 6; k++)
            reaction[k] += body_inertia[k * n + i] * a;
    }
}

/* The states' derivatives, linear likewise. */
static void derivatives_of(const double *q, const double *v, const double *inputs, double ratio, double *derivatives) {
    for (size_t i = 0; i < body_modes; i++) {
        derivatives[i] = v[i];
        derivatives[body_modes + i] = acceleration(q, v, forces(inputs, i), i, ratio);
    }
}

int model_observe(void *memory, void *scratch, double t, const double *given, double *outputs, char *message) {
    (void)scratch, (void)t, (void)message;
    const double *q = memory;
    outputs_of(q, q + body_modes, given, given[model_inputs], outputs);
    return 0;
}

void model_get_states(const void *memory, double *states) { memcpy(states, memory, model_memory); }

void model_set_states(void *memory, const double *states) { memcpy(memory, states, model_memory); }

int model_derivatives(void *memory, void *scratch, double t, const double *given, double *derivatives, char *message) {
    (void)scratch, (void)t, (void)message;
    const double *q = memory;
    derivatives_of(q, q + body_modes, given, given[model_inputs], derivatives);
    return 0;
}

int model_direction(void *memory, void *scratch, double t, const double *given, const double *input_changes,
                    const double *state_changes, double *output_changes, double *derivative_changes, char *message) {
    (void)memory, (void)scratch, (void)t, (void)message;
    const double *q = state_changes, *v = state_changes + body_modes;
    outputs_of(q, v, input_changes, given[model_inputs], output_changes);
    derivatives_of(q, v, input_changes, given[model_inputs], derivative_changes);
    return 0;
}
