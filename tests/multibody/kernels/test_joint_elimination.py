"""Eliminating a joint's coordinates one by one against numpy's elimination of all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from flexmbd.multibody.kernels.algebra.spatial import load6, store6
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.multi_dof_joints import (
    accelerate_multi_dof_joint,
    eliminate_joint_forces,
    eliminate_multi_dof_joint,
)
from flexmbd.multibody.kernels.physics.joint_elimination import screw_column


@dataclass(frozen=True, eq=False)
class Work(ArrayStruct):
    """The arrays of ArticulatedWork that a joint of several coordinates has."""

    subspace: np.ndarray
    force: np.ndarray
    required: np.ndarray


@entry_kernel
def eliminate(aw, link, a, b, m, torque, force):
    return eliminate_multi_dof_joint(aw, link, a, b, m, torque, force)


@entry_kernel
def pass_forces(aw, link, rhs, torque, force):
    return eliminate_joint_forces(aw, link, rhs, torque, force)


@entry_kernel
def accelerate(aw, link, angular, linear, out):
    return accelerate_multi_dof_joint(aw, link, angular, linear, out)


@entry_kernel
def column_about_z(a, b, m, turn, slide, out):
    store6(out, 0, screw_column(a, b, m, turn, slide))
    return load6(out, 0)


def blocks(inertia: Any) -> tuple[Any, Any, Any]:
    """(A, B, M) as kernels have them: six, nine and six numbers."""
    upper = np.triu_indices(3)
    a, b, m = inertia[:3, :3], inertia[:3, 3:], inertia[3:, 3:]
    return tuple(a[upper]), tuple(b.ravel()), tuple(m[upper])


def full(a, b, m):
    """(6, 6) of the blocks."""
    rows = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    B = np.array(b).reshape(3, 3)
    return np.block([[np.array(a)[rows], B], [B.T, np.array(m)[rows]]])


def joint(S, applied, *, ball):
    """Work arrays and the link of a joint whose motion subspace is S (6, n), with the forces that it requires."""
    n = S.shape[1]
    work = Work(np.zeros((1, 2, 6, 6)), np.zeros((1, 2, 6)), -applied)
    work.subspace[0, 0, :n] = S.T
    link = np.zeros(to.N_LINK, np.int64)
    link[to.FREEDOMS], link[to.ADDS] = n, 0 if ball else n
    return work, link


def drawn(seed, n, *, ball):
    """An inertia, a bias force, an acceleration of the inner side, S, and the coordinates' forces."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((6, 6))
    S = np.vstack([np.eye(3), np.zeros((3, 3))]) if ball else rng.standard_normal((6, n))
    return root @ root.T + np.eye(6), rng.standard_normal(6), rng.standard_normal(6), S, rng.standard_normal(n)


@pytest.mark.parametrize(("n", "ball"), [(2, False), (3, False), (3, True), (5, False)])
@pytest.mark.parametrize("seed", [1, 2])
def test_one_by_one_is_all_at_once(seed, n, ball):
    """Featherstone 2008, equations 7.21 to 7.25, with the inverse of D."""
    inertia, bias, inner, S, applied = drawn(seed, n, ball=ball)
    U = inertia @ S
    D = S.T @ U
    left = applied - S.T @ bias
    work, link = joint(S, applied, ball=ball)
    a, b, m, torque, force = eliminate(work, link, *blocks(inertia), tuple(bias[:3]), tuple(bias[3:]))
    np.testing.assert_allclose(full(a, b, m), inertia - U @ np.linalg.solve(D, U.T), rtol=0, atol=1e-12)
    np.testing.assert_allclose([*torque, *force], bias + U @ np.linalg.solve(D, left), rtol=0, atol=1e-12)
    out = np.zeros(n)
    angular, linear = accelerate(work, link, tuple(inner[:3]), tuple(inner[3:]), out)
    expected = np.linalg.solve(D, left - U.T @ inner)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose([*angular, *linear], inner + S @ expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ball", [False, True])
def test_other_forces_with_the_factors_at_hand(ball):
    """The bias force that is passed on, and the accelerations, for forces and a bias that come later."""
    inertia, bias, inner, S, applied = drawn(3, 3, ball=ball)
    work, link = joint(S, np.zeros(3), ball=ball)
    eliminate(work, link, *blocks(inertia), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    torque, force = pass_forces(work, link, applied, tuple(bias[:3]), tuple(bias[3:]))
    U = inertia @ S
    D, left = S.T @ U, applied - S.T @ bias
    np.testing.assert_allclose([*torque, *force], bias + U @ np.linalg.solve(D, left), rtol=0, atol=1e-12)
    out = np.zeros(3)
    accelerate(work, link, tuple(inner[:3]), tuple(inner[3:]), out)
    np.testing.assert_allclose(out, np.linalg.solve(D, left - U.T @ inner), rtol=0, atol=1e-12)


def test_column_of_a_screw():
    inertia, *_ = drawn(4, 1, ball=False)
    motion = np.array([0.0, 0.0, 0.7, 0.0, 0.0, 0.3])
    found = column_about_z(*blocks(inertia), 0.7, 0.3, np.zeros(6))
    np.testing.assert_allclose(found, inertia @ motion, rtol=0, atol=1e-13)
