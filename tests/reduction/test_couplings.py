"""Rigid and averaged interfaces, an attached and a floating body frame, against all dofs of the model."""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from bracket import GROUPS, INTERFACES, bracket
from full_model import FullModel
from machine_side import dynamic_stiffness, motions, relative

import flexmbd as fm
from flexmbd.continuum import Interface
from flexmbd.continuum.nodes import node_numbers
from flexmbd.reduction import craig_bampton

RIGID, AVERAGED = fm.Coupling.RIGID, fm.Coupling.AVERAGED


def coupled(couplings, *, comm=MPI.COMM_SELF, degree=1):
    """The bracket with some of its interfaces, each coupled as said."""
    return bracket(
        interfaces=[
            Interface(name, INTERFACES[name].origin, INTERFACES[name].axes, coupling)
            for name, coupling in couplings.items()
        ],
        comm=comm,
        degree=degree,
    )


class Dense:
    """The unreduced model in free coordinates z, u = T z: motions J z of its interfaces, in `axes`."""

    def __init__(self, model, axes):
        full = FullModel(model)
        rigid = [one for one in model.interfaces if not hasattr(one, "average")]
        t = full.bound([(GROUPS[one.name](full.x.T), one.p) for one in rigid]).toarray()
        self.K, self.M = t.T @ full.K @ t, t.T @ full.M @ t
        numbers = node_numbers(model)
        turn = np.kron(np.eye(2), axes.T)
        self.J = {}
        for one in model.interfaces:
            if hasattr(one, "average"):
                c = np.zeros((6, len(t)))
                c[:, 3 * numbers[one.dofs // 3] + one.dofs % 3] = one.average.T
                self.J[one.name] = turn @ c @ t
            else:
                at = 6 * rigid.index(one)
                self.J[one.name] = turn @ np.eye(6, t.shape[1], at)

    def flexibility(self, held, names):
        """Motions of interfaces under unit loads on them, with others held, by one large system."""
        n = len(self.K)
        j = np.vstack([self.J[name] for name in names])
        rows = np.vstack([np.zeros((0, n)), *(self.J[name] for name in held)])
        zero = np.zeros((len(rows), len(rows)))
        whole = np.block([[self.K, rows.T], [rows, zero]])
        right = np.vstack([j.T, np.zeros((len(rows), len(j)))])
        return j @ np.linalg.solve(whole, right)[:n]

    def dynamic_stiffness(self, omega, names):
        j = np.vstack([self.J[name] for name in names])
        return np.linalg.inv(j @ np.linalg.solve(self.K - omega**2 * self.M, j.T))


MIXTURES = [
    {"root": RIGID, "tip": AVERAGED, "pad": RIGID},
    {"root": AVERAGED, "tip": RIGID, "pad": AVERAGED},
    {"root": AVERAGED, "tip": AVERAGED, "pad": AVERAGED},
]


@pytest.mark.parametrize(("couplings", "frame"), product(MIXTURES, ["root", "tip", None]))
def test_static_response_to_interface_loads_is_exact(couplings, frame):
    model = coupled(couplings, degree=2)
    body = craig_bampton(model, modes=2, frame=frame)
    held = frame or "root"
    axes = model.interface(frame).R if frame else np.eye(3)
    names = [one.name for one in body.interfaces]
    j = motions(body)
    rows = np.repeat([name == held for name in names], 6)
    # the body moves so that the held one stays at rest
    k = np.zeros((6 + body.n_modes,) * 2)
    k[6:, 6:] = np.diag(body.stiffness)
    free = scipy.linalg.null_space(j[rows])
    found = j[~rows] @ free @ np.linalg.solve(free.T @ k @ free, free.T @ j[~rows].T)
    moving = [name for name in names if name != held]
    assert relative(found, Dense(model, axes).flexibility([held], moving)) < 1e-8


ALONE = [{"tip": AVERAGED}, {"tip": RIGID}, {"tip": AVERAGED, "root": AVERAGED}]


@pytest.mark.parametrize(("couplings", "frame"), product([*MIXTURES, *ALONE], ["tip", None]))
def test_all_modes_are_the_full_model(couplings, frame):
    model = coupled(couplings)
    axes = model.interface(frame).R if frame else np.eye(3)
    dense = Dense(model, axes)
    modes = len(dense.K) - 6 * len(couplings)
    body = craig_bampton(model, modes=modes, frame=frame)
    assert body.n_modes == len(dense.K) - 6
    exact = scipy.linalg.eigh(dense.K, dense.M, eigvals_only=True)[6:]
    assert body.frequencies() == pytest.approx(np.sqrt(exact) / (2 * np.pi), rel=1e-8)
    names = [one.name for one in body.interfaces]
    for omega in 2 * np.pi * np.array([10.0, 300.0, 2000.0, 9000.0]):
        exact = dense.dynamic_stiffness(omega, names)
        assert relative(dynamic_stiffness(body, omega), exact) < 1e-7
