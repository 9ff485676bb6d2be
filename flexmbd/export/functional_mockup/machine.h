/* A machine's arrays and compiled kernels; written by the exporter. */
#ifndef FLEXMBD_MACHINE_H
#define FLEXMBD_MACHINE_H

#include <stddef.h>
#include <stdint.h>

extern const unsigned char machine_image[];  /* what an instance's memory is at the start */
extern const double machine_start_time;      /* s */
extern const int machine_follows_time;       /* whether anything but the inputs is a function of time */
extern const double machine_step;            /* s, the longest step of the integrator */
extern const size_t machine_numbers;         /* places in the memory: scalars of the integration, */
extern const size_t machine_counts;
extern const size_t machine_flag;            /* what functions of time report, */
extern const size_t machine_input_places[];  /* each input's value, */
extern const size_t machine_output_places[]; /* each output's */
extern const int machine_time, machine_time_end, machine_step_size, machine_stored; /* entries of numbers and counts */
extern const int machine_done, machine_output; /* what the integrator returns: at its end, with a full record */

/* Runs the integrator up to its end; its code, or -1. */
int64_t machine_run(unsigned char *memory);

/* Brings the frames among the outputs up to date; 0, or -1. */
int machine_frames(unsigned char *memory);

#endif
