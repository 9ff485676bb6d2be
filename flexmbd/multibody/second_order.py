"""The second-order displacement of a reduced body that its geometric stiffness implies.

A mode shape displaces points along straight lines; a bending beam would grow longer.  The missing part
is g(x) = q^T G(x) q / 2, and the work of a load c f on it, c (integral of f . g), is -q^T (c K) q / 2 with
the load's geometric stiffness K.  So K gives the weighted integrals of G that the equations of motion
need, and using them for motion and forces alike keeps the energy, which adding K to the modal stiffness
alone does not.  Such a displacement is there only if the stress follows the motion at once; the record
says which part of K that is (`following`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.reduced import FRAME_DOFS, ReducedBody

FloatArray = NDArray[np.float64]


def inertia_bend(record: ReducedBody) -> FloatArray:
    """Integrals of rho G, zero where the record has no geometric stiffness.

    Args:
        record: the loads on B's acceleration, angular acceleration and angular velocity.

    Returns:
        (12, n, n): rho G_a at a, then rho G_a x_b at 3 + 3 a + b; in B.
    """
    n = record.n_modes
    S = np.array([_stiffness(record, f"acceleration {a}") for a in "xyz"])
    A = [_stiffness(record, f"angular acceleration {a}") for a in "xyz"]
    C = {ab: _stiffness(record, f"angular velocity {ab}") for ab in ("xx", "yy", "zz", "xy", "xz", "yz")}
    N = np.zeros((3, 3, n, n))
    # -rho w x (w x r) does the work w_a w_b N_ab - w^2 tr(N), -rho dw x r the work of r x g against dw
    trace = -0.5 * (C["xx"] + C["yy"] + C["zz"])
    for a, aa in enumerate(("xx", "yy", "zz")):
        N[a, a] = C[aa] + trace
    for a, b, c, ab in ((0, 1, 2, "xy"), (1, 2, 0, "yz"), (2, 0, 1, "xz")):
        N[b, a] = 0.5 * (C[ab] + A[c])
        N[a, b] = 0.5 * (C[ab] - A[c])
    return np.concatenate([S, N.reshape(9, n, n)])


def interface_bend(record: ReducedBody, name: str) -> FloatArray | None:
    """Second derivatives of an interface's six displacements, (6, n, n) in B, or None if not known."""
    if record.geometric is None or f"{name}.{FRAME_DOFS[0]}" not in record.geometric.loads:
        return None
    bend = -np.array([_stiffness(record, f"{name}.{dof}") for dof in FRAME_DOFS])
    return bend if bend.any() else None


def _stiffness(record: ReducedBody, load: str) -> FloatArray:
    geometric = record.geometric
    if geometric is None or load not in geometric.loads:
        return np.zeros((record.n_modes, record.n_modes))
    return geometric.following[geometric.loads.index(load)]
