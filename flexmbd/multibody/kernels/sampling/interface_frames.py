"""Motion of the interface frames of bodies with history, and what moves them, in inertial axes."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, load3, rotate, store3, store9
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics, frame_motion

# Columns of a frame's motion: origin, rotation, velocities, accelerations.
M_P, M_R, M_V, M_W, M_A, M_ALPHA, N_MOTION = 0, 3, 12, 15, 18, 21, 24


@kernel
def store_motions(plan, work, rows, x, v, a, out):
    """out[k] = motion of the frame in row ``rows[k]`` of ``plan.frames``, accelerations without gravity's."""
    g = load3(plan.gravity, 0)
    forward_kinematics(plan, work, x, v, a)
    for k in range(rows.shape[0]):
        p, R, velocity, spin, acceleration, turning = frame_motion(plan, work, rows[k])
        store3(out[k], M_P, p)
        store9(out[k], M_R, R)
        store3(out[k], M_V, rotate(R, velocity))
        store3(out[k], M_W, rotate(R, spin))
        store3(out[k], M_A, add3(rotate(R, acceleration), g))
        store3(out[k], M_ALPHA, rotate(R, turning))


@entry_kernel
def frame_motions(plan, work, rows, x, v, a, out):
    """``store_motions`` from Python: out (k, N_MOTION).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        rows: (k,) int64, rows of Plan.frames.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        a: (nv,) float64, accelerations.
        out: (k, N_MOTION) float64, output.
    """
    store_motions(plan, work, rows, x, v, a, out)


@entry_kernel
def frame_twists(plan, work, rows, x, unit, rest, out):
    """out (6 k, nv): velocity and angular velocity of each frame per unit of each generalised velocity.

    ``unit`` and ``rest`` are (nv,) zeros.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        rows: (k,) int64, rows of Plan.frames.
        x: (nx,) float64, configuration.
        unit: (nv,) float64, zeros.
        rest: (nv,) float64, zeros.
        out: (6 k, nv) float64, output.
    """
    for j in range(unit.shape[0]):
        unit[j] = 1.0
        forward_kinematics(plan, work, x, unit, rest)
        unit[j] = 0.0
        for k in range(rows.shape[0]):
            _, R, velocity, spin, _, _ = frame_motion(plan, work, rows[k])
            linear = rotate(R, velocity)
            angular = rotate(R, spin)
            for c in range(3):
                out[6 * k + c, j] = linear[c]
                out[6 * k + 3 + c, j] = angular[c]
