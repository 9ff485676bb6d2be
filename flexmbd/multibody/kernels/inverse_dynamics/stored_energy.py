"""Whether an element's wrench is the derivative of the energy that it says it stores."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, exp_rotation, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.elements.table import element_wrench, frame_energy
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import relative_rates
from flexmbd.multibody.kernels.physics.constraint_laws import unit

_ZERO = (0.0, 0.0, 0.0)


@entry_kernel
def energy_slopes(plan, work, i, step, out):
    """Of element i, between frames, at rest where ``work`` has its frames: out[0, :6] its wrench on G, in F's axes.

    out[1, :6], out[2, :6]: the energy's slopes by d (N) and by turns of G (N m), from ``step`` (m; rad) before to here,
    and from here to as far behind.  out[3, 0]: the energy (J).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        i: int64, row of Plan.elements.
        step: (2,) float64, m and rad.
        out: (4, 6) float64, output.
    """
    row = plan.elements[i]
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    force, torque = element_wrench(plan, work, row, d, R, _ZERO, _ZERO)
    here = frame_energy(plan, work, row, d, R, _ZERO, _ZERO)
    out[3, 0] = here
    for k in range(3):
        out[0, k] = force[k]
        out[0, 3 + k] = torque[k]
        for side in range(2):
            sign = 2.0 * side - 1.0
            moved = scale3(sign * step[0], unit(k))
            turn = exp_rotation(scale3(sign * step[1], unit(k)))
            there = frame_energy(plan, work, row, add3(d, moved), R, _ZERO, _ZERO)
            turned = frame_energy(plan, work, row, d, compose(turn, R), _ZERO, _ZERO)
            out[1 + side, k] = sign * (there - here) / step[0]
            out[1 + side, 3 + k] = sign * (turned - here) / step[1]
