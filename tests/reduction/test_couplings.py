"""Rigid and averaged interfaces, an attached and a floating body frame, against all dofs of the model.

And against closed forms: the exact solutions of a bar in tension and bending pass an averaged interface undisturbed.
"""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from bracket import GROUPS
from coupled_part import AVERAGED, RIGID, coupled
from full_model import FullModel
from machine_side import dynamic_stiffness, motions, relative

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, craig_bampton, guyan


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


@pytest.mark.mpi
@pytest.mark.parametrize(("couplings", "frame"), [(MIXTURES[1], "root"), (MIXTURES[2], None)])
def test_averages_spread_over_ranks(couplings, frame):
    """One of which owns nothing of an interface."""
    body = craig_bampton(model := coupled(couplings, comm=MPI.COMM_WORLD), modes=3, frame=frame)
    if model.comm.size > 1:
        own = [int(np.sum(one.dofs < model.n_owned)) for one in model.interfaces]
        assert min(map(min, model.comm.allgather(own))) == 0
    alone = craig_bampton(coupled(couplings), modes=3, frame=frame)
    assert body.stiffness == pytest.approx(alone.stiffness, rel=1e-10)
    assert abs(body.gram - alone.gram).max() < 1e-10 * abs(alone.gram).max()
    for one, other in zip(body.interfaces, alone.interfaces, strict=True):
        assert abs(one.modes - other.modes).max() < 1e-10 * abs(other.modes).max(initial=1e-3)


BAR = (0.6, 0.1, 0.2)
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def bar(size, divisions, *interfaces, part=lambda x: x[0] > -1.0, distorted=0.0):
    """Those cells of a box, its section centred, whose middles lie in a part of it."""
    source = meshes.block(*size, divisions=divisions, cell="tetrahedron", comm=MPI.COMM_SELF).mesh
    x, cells = source.geometry.x.copy(), cell_nodes(source)
    half = np.array([0.0, size[1] / 2, size[2] / 2])
    inside = ((x + half > 1e-9) & (x + half < np.array(size) - 1e-9)).all(axis=1)
    x[inside] += distorted * np.random.default_rng(3).uniform(-1.0, 1.0, size=(inside.sum(), 3))
    cells = cells[part(x[cells].mean(axis=1).T)]
    used, cells = np.unique(cells, return_inverse=True)
    ends = {
        "start": lambda x: x[0] < 1e-9,
        "joint": lambda x: abs(x[0] - size[0] / 2) < 1e-9,
        "end": lambda x: x[0] > size[0] - 1e-9,
    }
    groups = {one.name: ends[one.name] for one in interfaces}
    mesh = from_arrays(MPI.COMM_SELF, x[used], cells.reshape(-1, 4), degree=1, facet_groups=groups)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=interfaces)


def test_patch_of_averaged_interfaces():
    """Tension and pure bending of a bar between two averages: stress and displacement are St Venant's, everywhere."""
    _, width, height = BAR
    ends = [Interface(name, coupling=AVERAGED) for name in ("start", "end")]
    body = guyan(bar(BAR, (3, 2, 2), *ends, distorted=0.02), frame="start", keep=Keep(modes=True, stress=True))
    E, nu = STEEL.E, STEEL.nu
    x, y, z = body.modes.x.T
    area, about_y, about_z = width * height, width * height**3 / 12, height * width**3 / 12
    middle = (height**2 - width**2) / 12
    # force x, moment y, moment z of size one: curvature times E, and what is exact
    exact = {
        0: (np.stack([x, -nu * y, -nu * z]) / (E * area), np.ones_like(x) / area),
        4: (
            np.stack([x * z, -nu * y * z, -(x**2 + nu * (z**2 - y**2 - middle)) / 2]) / (E * about_y),
            z / about_y,
        ),
        5: (
            np.stack([-x * y, (x**2 + nu * (y**2 - z**2 + middle)) / 2, nu * y * z]) / (E * about_z),
            -y / about_z,
        ),
    }
    for load, (u, stress) in exact.items():
        q = body.interface("end").modes[load] / body.stiffness
        assert abs(body.modes.phi @ q - u.T).max() < 1e-9 * abs(u).max()
        sigma = np.zeros((len(x), 6))
        sigma[:, 0] = stress
        assert abs(body.stress.sigma @ q - sigma).max() < 1e-8 * abs(stress).max()


SHORT = (0.2, 0.1, 0.1)


def joined_compliance(coupling):
    """Of the bar's end with its start held, both rigid, where two halves meet in frames."""
    start, joint, end = Interface("start"), Interface("joint", coupling=coupling), Interface("end")
    first = guyan(bar(SHORT, (4, 2, 2), start, joint, part=lambda x: x[0] < 0.1), frame="start")
    second = guyan(bar(SHORT, (4, 2, 2), joint, end, part=lambda x: x[0] > 0.1), frame="joint")
    one, two = first.interface("joint").modes, second.interface("end").modes
    carried = motions(second)[6:, :6] @ one
    return carried @ np.diag(1 / first.stiffness) @ carried.T + two @ np.diag(1 / second.stiffness) @ two.T


def test_rigid_and_averaged_joints_bracket_the_stiffness_of_the_whole():
    """All of the joint's motions go in step in the uncut bar; a rigid joint forbids some, averages tie fewer."""
    whole = FullModel(bar(SHORT, (4, 2, 2), Interface("start"), Interface("end")))
    ends = [(whole.x[:, 0] < 1e-9, np.zeros(3)), (whole.x[:, 0] > 0.2 - 1e-9, np.array([0.2, 0.0, 0.0]))]
    t = whole.bound(ends)[:, 6:]
    k = (t.T @ whole.K @ t).tocsc()
    exact = scipy.sparse.linalg.spsolve(k, np.eye(k.shape[0], 6))[:6]
    size = 1 / np.sqrt(np.diag(exact))
    scale = np.outer(size, size)
    softer = np.linalg.eigvalsh((joined_compliance(AVERAGED) - exact) * scale)
    stiffer = np.linalg.eigvalsh((exact - joined_compliance(RIGID)) * scale)
    # in every direction of force and moment
    assert 1e-5 < softer[0] < softer[-1] < 0.02
    assert 1e-3 < stiffer[0] < stiffer[-1] < 0.1
