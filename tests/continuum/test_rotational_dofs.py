"""Rotations in explicit runs: tables and closed forms, the stable step, and what bonding to a rigid part gives."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dof_keys import everywhere, keys, matrix

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.interior.rotational_dofs import condensed_rotations, lumped_rotations
from flexmbd.continuum.matrices.fastest_vibration import largest_eigenvalue
from flexmbd.coupling import Coupling
from flexmbd.errors import FormulationError, InterfaceError
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.forms import plate_mitc as plate
from flexmbd.forms import solid_linear, solid_mixed

RULES = [condensed_rotations, lumped_rotations]
BAR = beam.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0))
SHEET = plate.Parameters(E=2.1e11, nu=0.3, rho=7800.0, t=0.01)


def euler_bernoulli(cells):
    """A beam of unit length, stiffness and mass whose shear has MacNeal's residual bending flexibility.

    1 / (k G A) = h^2 / (12 E I) makes of the linear cell with one point the cubic one without shear.
    """
    shear = 12.0 * cells**2 / 0.5
    return beam.Parameters(1.0, 0.0, 1.0, A=1.0, Iy=1.0, Iz=1.0, J=1.0, ky=shear, kz=shear, orientation=(0, 1, 0))


def rod(p, cells, interfaces=("start",), comm=MPI.COMM_WORLD):
    mesh = meshes.line(1.0, divisions=cells, comm=comm)
    return ContinuumModel(mesh, beam, p, degree=1, interfaces=[Interface(name) for name in interfaces])


def square(cells, cell="quadrilateral", interfaces=("x_min",), comm=MPI.COMM_WORLD):
    mesh = meshes.sheet(1.0, 1.0, divisions=(cells, cells), cell=cell, comm=comm)
    return ContinuumModel(mesh, plate, SHEET, degree=1, interfaces=[Interface(name) for name in interfaces])


def dense(operator, components=range(6)):
    """Stiffness between the moving dofs of some components, column by column, and their masses; one rank."""
    every = np.arange(len(operator.masses))
    chosen = np.flatnonzero(operator.moving & np.isin(every % 6, components))
    columns = []
    for i in chosen:
        u = (every == i).astype(float)
        operator.complete(u)
        columns.append(operator.force(u)[chosen])
    return np.array(columns).T, operator.masses[chosen]


def angular_frequencies(operator, components=range(6)):
    k, m = dense(operator, components)
    assert abs(k - k.T).max() < 1e-9 * abs(k).max()
    return np.sqrt(np.abs(scipy.linalg.eigvalsh(k / np.sqrt(np.outer(m, m)))))


# Signed errors of the first three frequencies of a cantilever, translations lumped and rotations condensed.
TABLE = {
    4: (-2.787e-2, -8.823e-2, -0.1377),
    8: (-7.118e-3, -2.419e-2, -3.920e-2),
    16: (-1.789e-3, -6.181e-3, -1.012e-2),
    32: (-4.479e-4, -1.553e-3, -2.549e-3),
    64: (-1.120e-4, -3.889e-4, -6.384e-4),
}


@pytest.mark.parametrize("cells", TABLE)
def test_condensed_cantilever_has_the_table_of_hermites_beam(cells):
    """Cubic beam elements with lumped translations: to the table's four digits."""
    exact = np.array([1.87510406871, 4.69409113297, 7.85475743824]) ** 2
    body = rod(euler_bernoulli(cells), cells, comm=MPI.COMM_SELF)
    for component in (1, 2):
        found = angular_frequencies(condensed_rotations(body), (component,))[:3]
        assert found / exact - 1 == pytest.approx(np.array(TABLE[cells]), rel=5e-4)


def wave(p, h, k):
    """Angular frequency of bending waves in an endless row of linear cells with one point, rotations condensed.

    rho A w^2 = E I s^4 / (c^2 + (E I / k G A) s^2) with s = 2 sin(k h / 2) / h, c = cos(k h / 2).
    """
    s, c = 2 * np.sin(k * h / 2) / h, np.cos(k * h / 2)
    shear = p.ky * p.A * p.E / (2 * (1 + p.nu))
    return np.sqrt(p.E * p.Iz / (p.rho * p.A) * s**4 / (c**2 + p.E * p.Iz / shear * s**2))


def test_condensed_beam_has_the_frequencies_of_its_waves():
    """Simply supported, all of them: half waves fit in."""
    cells = 12
    body = rod(dataclasses.replace(BAR, Iz=BAR.Iy * 400), cells, interfaces=(), comm=MPI.COMM_SELF)
    operator = lumped_rotations(body)
    # torsion and the ends are held by hand: what is condensed are the rotations about z
    k = matrix(body, body.K)
    order = everywhere(body, keys(body))
    inside = (order[:, 4] == 1) & (order[:, 1] > 1e-9) & (order[:, 1] < 1 - 1e-9)
    turning = order[:, 4] == 5
    condensed = k[np.ix_(inside, inside)] - k[np.ix_(inside, turning)] @ np.linalg.solve(
        k[np.ix_(turning, turning)], k[np.ix_(turning, inside)]
    )
    m = everywhere(body, operator.masses)[inside]
    found = np.sqrt(scipy.linalg.eigvalsh(condensed / np.sqrt(np.outer(m, m))))
    expected = wave(dataclasses.replace(BAR, Iz=BAR.Iy * 400), 1 / cells, np.pi * np.arange(1, cells))
    assert found == pytest.approx(np.sort(expected), rel=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_frequencies_go_to_those_of_the_consistent_mass_with_order_two(rule):
    """Of a beam, bending about both axes, and of a cantilever plate. Thin: condensed rotations have no inertia."""
    thin = beam.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.002, height=0.001, orientation=(0, 1, 0))
    fine = ContinuumModel(meshes.line(1.0, divisions=24, comm=MPI.COMM_SELF), beam, thin, degree=2)
    inside = everywhere(fine, keys(fine))[:, 1] > 1e-9
    k, m = (matrix(fine, which)[np.ix_(inside, inside)] for which in (fine.K, fine.M))
    d = 1 / np.sqrt(np.diag(k))
    # mass by stiffness: the lowest come out to the last digits
    values = scipy.linalg.eigh(d[:, None] * m * d, d[:, None] * k * d, eigvals_only=True)
    exact = 1 / np.sqrt(values[:-5:-1])
    errors = []
    for cells in (16, 32):
        found = angular_frequencies(rule(rod(thin, cells, comm=MPI.COMM_SELF)))[:4]
        errors.append(abs(found / exact - 1).max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    assert errors[1] < 2.5e-3
    f = angular_frequencies(rule(square(10, comm=MPI.COMM_SELF)))[:2] / (2 * np.pi)
    assert f == pytest.approx([8.7266, 21.3042], rel=0.02)


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_stable_step_is_that_of_the_fastest_vibration(rule):
    """Never above it, and below by a thousandth at most; on any number of ranks."""
    for make in (lambda comm: rod(BAR, 12, comm=comm), lambda comm: square(4, "triangle", comm=comm)):
        alone = rule(make(MPI.COMM_SELF))
        limit = 2 / angular_frequencies(alone)[-1]
        for operator in (alone, rule(make(MPI.COMM_WORLD))):
            assert limit * 0.999 < operator.stable_step() < limit * (1 + 1e-6)


def test_undamped_hermite_beam_has_root_48():
    """omega = sqrt(48) sqrt(E I / rho A) / h^2 of an endless row: 6.92 at 64 cells, and no more."""
    operator = condensed_rotations(rod(euler_bernoulli(64), 64))
    assert 2 / operator.stable_step() / 64**2 == pytest.approx(6.92, abs=0.005)


def peak(operator, h, steps):
    """Largest displacement of central differences from a random one, over the first."""
    u = np.zeros(len(operator.masses))
    moving, m = operator.moving, operator.masses[operator.moving]
    u[moving] = np.random.default_rng(1).standard_normal(len(m)) / np.sqrt(m)
    before, first, largest = u[moving].copy(), abs(u).max(), 0.0
    for _ in range(steps):
        operator.complete(u)
        now = u[moving]
        u[moving], before = 2 * now - before - h * h / m * operator.force(u)[moving], now
        largest = max(largest, abs(u[moving]).max())
        if largest > 1e6 * first:
            break
    return largest / first


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("make", [lambda: rod(BAR, 12), lambda: square(4)], ids=["beam", "plate"])
def test_stable_at_99_and_unstable_at_101_hundredths(make, rule):
    operator = rule(make())
    h = operator.stable_step()
    assert peak(operator, 0.99 * h, 1500) < 100
    assert peak(operator, 1.01 * h, 1500) > 1e6


@pytest.mark.mpi
def test_raised_inertia_keeps_rotations_from_ruling():
    """A thin beam's rotations alone would rule the step; raised, they take less than a third of it."""
    body = rod(BAR, 16, interfaces=())
    wave = (1 / 16) / np.sqrt(BAR.E / BAR.rho)
    assert lumped_rotations(body, raised=False).stable_step() < 0.2 * wave
    raised = lumped_rotations(body)
    assert 0.9 * wave < raised.stable_step() < 1.01 * wave
    for cell in plate.CELLS:
        body = square(4, cell, interfaces=())
        operator = lumped_rotations(body)
        turning = operator.rotations.ravel()
        held = np.setdiff1d(np.arange(len(operator.masses)), turning)
        alone = dataclasses.replace(operator, moving=np.isin(np.arange(len(operator.masses)), held))
        assert operator.stable_step() > 0.7 * alone.stable_step()


@pytest.mark.mpi
def test_inertia_that_is_not_raised_is_the_consistent_mass_lumped():
    """And raised it is the same about all axes and nowhere less; so are all ranks' numbers."""
    world, alone = (rod(BAR, 10, comm=comm) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    plain, raised = lumped_rotations(world, raised=False), lumped_rotations(world)
    assert (plain.masses == lumped_mass(world)).all()
    assert (raised.masses >= plain.masses).all()
    assert np.ptp(raised.masses[raised.rotations], axis=1).max(initial=0.0) == 0.0
    expected = everywhere(alone, lumped_rotations(alone).masses)
    assert everywhere(world, raised.masses) == pytest.approx(expected, rel=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("make", [lambda comm: rod(BAR, 10, comm=comm), lambda comm: square(3, comm=comm)])
def test_condensed_rotations_are_in_equilibrium(make):
    """Against dense algebra, with moments from outside; the same on all ranks."""
    body = make(MPI.COMM_WORLD)
    operator = condensed_rotations(body)
    order, k = everywhere(body, keys(body)), matrix(body, body.K)
    free = (order[:, 4] >= 3) & (order[:, 1] > 1e-9)
    rng = np.random.default_rng(3)
    u, load = rng.standard_normal((2, len(order)))
    u[order[:, 1] < 1e-9] = 0.0
    scattered = np.argsort(everywhere(body, own_places(body)))
    mine = scattered[body.K.getOwnershipRange()[0] :][: body.n_owned]
    local = u[mine]
    operator.complete(local, load[mine])
    expected = u.copy()
    expected[free] = np.linalg.solve(k[np.ix_(free, free)], (load - k[:, ~free] @ u[~free])[free])
    assert abs(everywhere(body, local) - expected).max() < 1e-8 * abs(expected).max()
    f = everywhere(body, operator.force(local))
    assert abs(f - k @ expected).max() < 1e-9 * abs(k @ expected).max()


def own_places(body):
    return body.K.getOwnershipRange()[0] + np.arange(body.n_owned)


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_bonded_nodes_react_with_force_and_moment(rule):
    """A cantilever pulled at its end: the reactions on the rigid part are the load and its moment (eq. 52-53)."""
    body = rod(BAR, 6)
    operator = rule(body)
    order, k = everywhere(body, keys(body)), matrix(body, body.K)
    free = order[:, 1] > 1e-9
    load = np.zeros(len(order))
    load[(abs(order[:, 1] - 1) < 1e-9) & (order[:, 4] < 3)] = 3.0, -4.0, 5.0
    u = np.zeros(len(order))
    u[free] = np.linalg.solve(k[np.ix_(free, free)], load[free])
    mine = np.argsort(everywhere(body, own_places(body)))[body.K.getOwnershipRange()[0] :][: body.n_owned]
    local = u[mine]
    operator.complete(local)
    (bond,) = operator.bonds
    reaction = -body.comm.allreduce(bond.columns.T @ operator.force(local)[bond.dofs])
    assert reaction == pytest.approx([3, -4, 5, 0, -5, -4], rel=1e-6, abs=1e-6)


def test_frames_that_move_are_in_the_stable_step():
    """A rod on a light and on a heavy rigid part, against the dense eigenproblem."""
    body = rod(BAR, 8, interfaces=("start", "end"), comm=MPI.COMM_SELF)
    for rule in RULES:
        operator = rule(body)
        frames = [np.diag([0.02, 0.02, 0.02, 1e-6, 2e-6, 3e-6]), np.diag([5, 5, 5, 0.1, 0.2, 0.3])]
        n = len(operator.masses)
        own = np.flatnonzero(operator.moving)
        columns = np.zeros((n, len(own) + 12))
        columns[own, np.arange(len(own))] = 1.0
        for i, bond in enumerate(operator.bonds):
            columns[bond.dofs, len(own) + 6 * i : len(own) + 6 * i + 6] = bond.columns
        completed = columns.T.copy()
        for u in completed:
            operator.complete(u)
        k = columns.T @ np.array([operator.force(u) for u in completed]).T
        m = scipy.linalg.block_diag(np.diag(operator.masses[own]), *frames)
        limit = 2 / np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[-1])
        assert limit * 0.999 < operator.stable_step(frames) < limit * (1 + 1e-6)
        assert operator.stable_step(frames) < 0.9 * operator.stable_step()


@pytest.mark.mpi
def test_largest_eigenvalue_of_a_known_operator():
    comm = MPI.COMM_WORLD
    values = np.arange(1.0, 8.0) + 10 * comm.rank
    shared = np.array([3.0, 1000.0])
    found = largest_eigenvalue(comm, lambda y: np.concatenate([values, shared]) * y, 7, shared=2)
    assert 1000.0 * (1 - 1e-12) < found < 1000.0 * (1 + 1e-4)


@pytest.mark.mpi
def test_bad_input():
    free = rod(BAR, 4, interfaces=())
    with pytest.raises(FormulationError, match="a rotation has no stiffness when all displacements are held"):
        condensed_rotations(free)
    with pytest.raises(FormulationError, match="no inertia to be lumped, as the drilling of a shell"):
        lumped_rotations(square(3), raised=False)
    averaged = [Interface("end", coupling=Coupling.AVERAGED)]
    body = ContinuumModel(meshes.line(1.0, divisions=4), beam, BAR, degree=1, interfaces=averaged)
    with pytest.raises(InterfaceError, match="interface 'end' is averaged"):
        lumped_rotations(body)
    p, mesh = solid_mixed.reference().parameters, meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 2), cell="tetrahedron")
    block = ContinuumModel(mesh, solid_mixed, p, degree=2)
    with pytest.raises(FormulationError, match="takes displacements, and three rotations a node"):
        condensed_rotations(block)
    with pytest.raises(InterfaceError, match="no inertia about an axis"):
        condensed_rotations(rod(BAR, 4)).stable_step([np.diag([1.0, 1, 1, 0, 1, 1])])


def test_a_solid_has_no_rotations():
    steel = solid_linear.Parameters(E=2e11, nu=0.3, rho=7800.0)
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(2, 1, 1), comm=MPI.COMM_SELF)
    body = ContinuumModel(mesh, solid_linear, steel, degree=1)
    one, other = (rule(body) for rule in RULES)
    assert one.stable_step() == other.stable_step()
    assert one.rotations.shape == (0, 3)
