/* The matrices of a reduced body near rest: q'' + D q' + K q = B u, with K diagonal; written by the exporter. */
#ifndef FLEXMBD_LINEAR_BODY_H
#define FLEXMBD_LINEAR_BODY_H

#include <stddef.h>

extern const size_t body_modes;      /* n */
extern const size_t body_frame_rows; /* r: six for each interface that moves */
extern const int body_coupled;       /* whether D has entries beside its diagonal */
extern const double body_stiffness[]; /* (n) 1/s^2 */
extern const double body_damping[];   /* (n, n) 1/s */
extern const double body_input[];     /* (n, inputs) forces on the modes per unit of an input */
extern const double body_frames[];    /* (r, n) displacements and rotations of the interfaces per mode */
extern const double body_inertia[];   /* (6, n) force and moment about B's origin per acceleration of a mode */
extern const double body_applied[];   /* (6, inputs) force and moment about B's origin per unit of an input */

#endif
