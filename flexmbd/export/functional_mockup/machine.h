/* A machine's arrays and compiled kernels; written by the exporter. */
#ifndef FLEXMBD_MACHINE_H
#define FLEXMBD_MACHINE_H

#include <stddef.h>
#include <stdint.h>

extern const unsigned char machine_image[]; /* what an instance's memory is at the start */
extern const double machine_start_time;     /* s */
extern const int machine_follows_time;      /* whether anything but the inputs is a function of time */
extern const double machine_step;           /* s, the longest step of the integrator */
extern const size_t machine_breaks;         /* how many instants there are where functions of time jump or bend */
extern const double machine_break_times[];  /* s, ascending */
extern const size_t machine_impulses;       /* how many of them there are where a prescribed motion's rate jumps */
extern const double machine_impulse_times[];

/* Places in the memory: the integration's scalars, and accelerations (n of them). */
extern const size_t machine_numbers, machine_counts, machine_accelerations, machine_velocities;
/* Of arrays that the method remembers, their sizes in bytes, and of those among them that begin as accelerations. */
extern const size_t machine_own_arrays, machine_own_places[], machine_own_sizes[];
extern const size_t machine_histories, machine_history_places[];
extern const size_t machine_input_places[];
extern const size_t machine_output_places[];

/* Entries of numbers and counts: how many there are, and some. */
enum { MOST_ENTRIES = 64 };
extern const int machine_number_entries, machine_count_entries;
extern const int machine_time, machine_time_end, machine_step_size, machine_stored, machine_latest,
    machine_rest;
extern const int machine_full; /* what the integrator returns with a full record */

/* Puts addresses of this process into the memory. */
void machine_bind(unsigned char *memory);

/* Of model exchange: where x, v, the mass, damping and stiffness matrix lie, and the rows of `machine_frames`. */
extern const size_t machine_x, machine_v, machine_mass, machine_damping, machine_stiffness;
extern const size_t machine_frame_rows, machine_frame_places[];

/* Finds these matrices: derivatives of the residual by accelerations, velocities and positions; 0, or -1. */
int machine_tangents(unsigned char *memory);

/* Accelerations anew for the state and inputs as they are in the memory at t. */
int machine_accelerate(void *memory, double t, char *message);

/* One step of the integrator; its code, or -1. */
int64_t machine_run(unsigned char *memory);

/* One step of no motion, which brings accelerations and reactions up to date; its code, or -1. */
int64_t machine_refresh(unsigned char *memory);

/* Brings the frames among the outputs up to date; 0, or -1. */
int machine_frames(unsigned char *memory);

#endif
