"""Gyroscopic forces of a reduced body: a formulation's kinetic energy linear in the rates, on the modes and on B.

The force of rates w on a virtual motion d is g(w, d) = T1(w, d) - T1(d, w), skew.  With the modes phi and the rotations
r_k of the whole body about B's axes it gives

    G_ij = g(phi_j, phi_i),    H_ki = g(phi_i, r_k),    g(r_j, r_k) = e_k . (e_j x h),

h being the angular momentum of the rotors inside the undeformed body.  That h + H q turns with B makes the forces of a
body that turns far: they follow from the kinetic energy w . (h + H q) + qd^T A q, A - A^T = G, by Lagrange's equations
in the rates of B (Wittenburg 2008, section 5.5, on gyrostats).
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import Gyroscopic


def has_gyroscopic(model: LinearModel) -> bool:
    """Whether formulations of the model have kinetic energy linear in the rates."""
    return any(group.optional.gyroscopic is not None for group in model.groups)


def check_gyroscopic(model: LinearModel) -> None:
    """Refuse gyroscopic forces about a loaded state; the same on every rank, not collective.

    Raises:
        ReductionError: the model is prestressed.
    """
    if model.state is not None and has_gyroscopic(model):
        raise ReductionError(
            f"the gyroscopic forces of {model.form_name} are those of small motions about rest, and the body is "
            "reduced about a loaded state; give the form no gyroscopic(u, v, p)"
        )


def gyroscopic_group(model: LinearModel, *, modes: FloatArray, p: FloatArray, R: FloatArray) -> Gyroscopic | None:
    """The group of a record; None where no formulation has such forces. Collective, the same on every rank.

    Args:
        model: the body.
        modes: (owned dofs, n) in normal form, in the mesh's axes.
        p: (3,) m, B's origin in the mesh's axes.
        R: (3, 3) rotation from B's axes to the mesh's.
    """
    if not has_gyroscopic(model):
        return None
    forms = assembly.gyroscopic(model.groups, model.space)
    (matrix,) = assembly.assemble({"gyroscopic matrix": forms}, model.groups, model.space)
    matrix.setOption(matrix.Option.SYMMETRIC, False)
    motions = np.hstack([model.rigid_motions(p, R)[:, 3:], modes])
    felt = inner(model.comm, motions, multiply(matrix, motions))
    matrix.destroy()
    skew = 0.5 * (felt - felt.T)
    # g(r_j, r_k) stands in row k and column j: e_k . (e_j x h) = -[h]x
    momentum = np.array([skew[1, 2], skew[2, 0], skew[0, 1]])
    return Gyroscopic(momentum, skew[:3, 3:], skew[3:, 3:])
