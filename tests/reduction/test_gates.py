"""What holds of every form file on any number of ranks: from its matrices to the record and its point masses."""

import dataclasses
import functools
import itertools
import pkgutil
from typing import Any

from mpi4py import MPI

import basix
import numpy as np
import pytest
import scipy.linalg
import ufl
from dof_keys import everywhere, matrix
from dolfinx import fem
from machine_side import dynamic_stiffness, relative

import flexmbd.forms
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.contract import formulation
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.continuum.matrices.eigen import TOLERANCE
from flexmbd.record.point_masses import point_masses
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import Keep, craig_bampton

KEPT = Keep(modes=True)

SIZE = (1.0, 0.3, 0.2)
AXES = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [-0.4, 1.0, 0.5], [0.1, -0.3, 1.0]]))[0]
AXES *= np.linalg.det(AXES)

# what has no energy has a history, and is not reduced
NAMES = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__) if info.name[0] != "_"]
FORMS = [name for name in NAMES if hasattr(formulation.load_form(name), "strain_energy")]
CASES = [
    pytest.param((name, cell), id=f"{name}-{cell}") for name in FORMS for cell in formulation.load_form(name).CELLS
]


def part(cell, comm):
    """A small part of such cells, four along it, and its two ends."""
    if cell == "interval":
        return meshes.line(SIZE[0], divisions=4, comm=comm), ("start", "end")
    if cell in ("triangle", "quadrilateral"):
        return meshes.sheet(*SIZE[:2], divisions=(4, 1), cell=cell, comm=comm), ("x_min", "x_max")
    return meshes.block(*SIZE, divisions=(4, 1, 1), cell=cell, comm=comm), ("x_min", "x_max")


@dataclasses.dataclass(frozen=True)
class Case:
    """A form on all ranks together, or on each alone: its model, and bodies by their number of modes."""

    model: Any
    ends: tuple[str, str]

    @functools.cache  # noqa: B019  (a case lives as long as the tests)
    def body(self, modes: int = 6) -> ReducedBody:
        # with its geometric stiffness but once
        return craig_bampton(self.model, modes=modes, frame=self.ends[0], geometric_stiffness=modes == 6, keep=KEPT)

    @functools.cache  # noqa: B019
    def plain(self, modes: int) -> ReducedBody:
        # no modes but those that were asked for
        return craig_bampton(self.model, modes=modes, frame=self.ends[0], geometric_stiffness=False, keep=KEPT)

    @functools.cache  # noqa: B019
    def floating(self) -> ReducedBody:
        return craig_bampton(self.model, modes=6, frame=None, geometric_stiffness=False, keep=KEPT)


@functools.cache
def reduced(case, *, alone=False):
    name, cell = case
    comm = MPI.COMM_SELF if alone else MPI.COMM_WORLD
    form = formulation.load_form(name)
    parameters = form.reference().parameters
    if getattr(parameters, "nu", 0.0) > 0.49:
        # the closer to 1/2, the more a stiffness with volume terms amplifies its own rounding
        parameters = dataclasses.replace(parameters, nu=0.49)
    degree = max(formulation.orders(form, cell))
    mesh, ends = part(cell, comm)
    interfaces = [Interface(ends[0], axes=AXES), Interface(ends[1])]
    return Case(ContinuumModel(mesh, form, parameters, degree=degree, interfaces=interfaces), ends)


def mixed(case, count):
    """How much of the first mode left out may be in those kept: what is left of K^-1 M over the gap to it."""
    flexibility = case.plain(count + 2).frequencies(case.ends) ** -2.0
    return TOLERANCE * flexibility[0] / (flexibility[count - 1] - flexibility[count])


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_matrices_and_record_do_not_depend_on_the_number_of_ranks(case):
    together, alone = reduced(case), reduced(case, alone=True)
    for one, other in ((together.model.K, alone.model.K), (together.model.M, alone.model.M)):
        expected = matrix(alone.model, other)
        assert abs(matrix(together.model, one) - expected).max() < 1e-12 * abs(expected).max()
    body, expected = together.plain(6), alone.plain(6)
    for clamped in ((), together.ends[:1], together.ends):
        assert body.frequencies(clamped) == pytest.approx(expected.frequencies(clamped), rel=10.0 * mixed(alone, 6))
    # modes for stretch are differences of static responses, and carry more of the round-off
    body, expected = together.body(), alone.body()
    assert body.frequencies() == pytest.approx(expected.frequencies(), rel=1e-8)
    first = 2 * np.pi * expected.frequencies()[0]
    for omega in first * np.array([0.01, 0.3, 0.8, 1.7, 4.3]):
        assert relative(dynamic_stiffness(body, omega), dynamic_stiffness(expected, omega)) < 1e-8
    # by the rule of the signs even mode by mode; eigenvectors carry more of the round-off
    assert relative_to_fields(body.gram, expected.gram) < 1e-7
    assert abs(body.partition - expected.partition).max() < 1e-7 * abs(expected.partition).max()
    assert (body.geometric is None) == (expected.geometric is None)
    if body.geometric is not None:
        assert abs(body.geometric.K - expected.geometric.K).max() < 1e-7 * abs(expected.geometric.K).max()
    assert abs(body.p_MB_M - expected.p_MB_M).max() < 1e-13
    floating, expected = together.floating(), alone.floating()
    assert floating.frequencies() == pytest.approx(expected.frequencies(), rel=1e-10)
    assert relative_to_fields(floating.gram, expected.gram) < 1e-7


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_every_rank_has_the_same_bits(case):
    for body in (reduced(case).body(), reduced(case).floating()):
        mine = (body.fingerprint(), body.p_MB_M.tobytes(), body.R_MB.tobytes(), dict(body.provenance))
        assert all(other == mine for other in MPI.COMM_WORLD.allgather(mine))


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_some_rank_owns_none_of_an_interface(case):
    """Which is what the other tests are to have tried."""
    model = reduced(case).model
    for found in model.interfaces:
        owned = model.comm.allgather(np.count_nonzero(found.dofs < model.n_owned))
        assert sum(owned) > 0
        assert model.comm.size == 1 or 0 in owned


@dataclasses.dataclass(frozen=True)
class Full:
    """The whole model with its ends as rigid frames, dense, on every rank.

    K, M: over the six motions of each end along the body's axes, then the free dofs, pressures last.
    rigid: the six motions of the body, about the first end.
    pressures: how many there are.
    """

    K: np.ndarray
    M: np.ndarray
    rigid: np.ndarray
    pressures: int

    def frequencies(self):
        """The lowest ones, Hz, with the first end held."""
        k, m = self.K[6:, 6:], self.M[6:, 6:]
        n = len(k) - self.pressures
        assert not m[n:].any()
        k = k[:n, :n] - k[:n, n:] @ np.linalg.solve(k[n:, n:], k[n:, :n])
        # the other way round, for a shell's rotations about its normal have no mass
        periods = scipy.linalg.eigh(m[:n, :n], k, eigvals_only=True, subset_by_index=(n - 4, n - 1))
        return 1 / np.sqrt(periods[::-1]) / (2 * np.pi)


@functools.cache
def full(case):
    model = reduced(case).model
    kinematic = everywhere(model, model.layout.kinematic)
    free, columns = kinematic.copy(), []
    for found in model.interfaces:
        bound = np.zeros(model.layout.n_local, dtype=bool)
        bound[found.dofs] = True
        bound = everywhere(model, bound)
        columns.append(bound[:, None] * everywhere(model, model.rigid_motions(found.p, AXES)))
        free &= ~bound
    every = np.eye(len(free))
    t = np.hstack([*columns, every[:, free], every[:, ~kinematic]])
    k, m = (matrix(model, which) for which in (model.K, model.M))
    rigid = everywhere(model, model.rigid_motions(model.interfaces[0].p, AXES))
    # a rigid motion in the coordinates: those of the ends, and the values of the free dofs
    return Full(t.T @ k @ t, t.T @ m @ t, np.linalg.lstsq(t, rigid, rcond=None)[0], np.count_nonzero(~kinematic))


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_rigid_motions_and_orthonormality(case):
    whole, body = full(case), reduced(case).body()
    stiffness, mass = (whole.rigid.T @ a @ whole.rigid for a in (whole.K, whole.M))
    first = (2 * np.pi * body.frequencies()[0]) ** 2
    assert abs(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)).max() < 1e-8 * first
    assert float(body.provenance["rigid motion error"]) < 1e-9
    assert float(body.provenance["orthonormality error"]) < 1e-9
    assert abs(body.modal_mass() - np.eye(body.n_modes)).max() < 1e-10
    assert relative(body.mass_matrix()[:6, :6], mass) < 1e-10


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("modes", [0, 6])
def test_static_response_to_loads_on_an_interface_is_exact(case, modes):
    whole, body = full(case), reduced(case).body(modes)
    k = whole.K[6:, 6:]
    exact = np.linalg.solve(k, np.eye(len(k))[:, :6])
    rows = body.interface(reduced(case).ends[1]).modes
    assert relative((rows / body.stiffness) @ rows.T, exact[:6]) < 1e-9


@pytest.mark.parametrize("case", CASES)
def test_frequencies_fall_to_those_of_the_full_model(case):
    whole, name = full(case), reduced(case).ends[0]
    exact = whole.frequencies()
    found = [reduced(case).plain(modes).frequencies([name])[:4] for modes in (0, 6, 14)]
    assert (found[2] >= exact * (1 - 1e-9)).all()
    for more, fewer in zip(found[1:], found[:-1], strict=True):
        assert (more <= fewer * (1 + 1e-9)).all()
    assert found[2] == pytest.approx(exact, rel=3e-3)


def material_points(model):
    """Section coordinates of points that stand for a section, where the form has any, and their density."""
    p = model.groups[0].parameters
    if not model.has_sections:
        return [None], p.rho
    if hasattr(p, "micro_inertia"):
        # eight points with its second moments
        return list(itertools.product(np.sqrt(p.micro_inertia / 2) * np.array([-1.0, 1.0]), repeat=3)), p.rho / 8
    if hasattr(p, "t"):
        return [(side * p.t / np.sqrt(12),) for side in (-1, 1)], p.rho * p.t / 2
    # four points with the second moments of a beam's section
    reach = np.sqrt([p.Iz / p.A, p.Iy / p.A])
    return [reach * signs for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1))], p.rho * p.A / 4


def by_quadrature(model, body):
    """(4 + 3 n, 4 + 3 n) mass integrals by the values of position and modes at points, in the body's axes."""
    mesh, u = model.mesh.mesh, fem.Function(model.space)
    points, weights = basix.make_quadrature(basix.CellType[mesh.topology.cell_name()], 8)
    cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
    x = ufl.SpatialCoordinate(mesh)
    xi = fem.Constant(mesh, np.zeros((3 - mesh.topology.dim or 3) if model.has_sections else 2))
    moved = ufl.as_vector([u[i] for i in range(3)])
    if model.has_sections:
        moved = model.formulation.motion(u, xi, model.groups[0].symbols)
    places, measure, motion = (
        fem.Expression(what, points) for what in (x, abs(ufl.JacobianDeterminant(mesh)), moved)
    )
    at = places.eval(mesh, cells).reshape(-1, 3)
    by = (measure.eval(mesh, cells).reshape(-1, len(weights)) * weights).reshape(-1)
    modes = nodal_modes(body, model)
    sections, density = material_points(model)
    gram = np.zeros((4 + 3 * body.n_modes,) * 2)
    for offset in sections:
        place = at
        if offset is not None:
            xi.value[:] = offset
        if offset is not None and len(offset) == 3:
            place = at + np.array(offset)
        elif offset is not None and len(offset) == 1:
            normals = fem.Expression(ufl.CellNormal(mesh), points).eval(mesh, cells).reshape(-1, 3)
            place = at + offset[0] * normals
        elif offset is not None:
            y = np.array([0.0, *model.groups[0].parameters.orientation[1:]])
            y /= np.linalg.norm(y)
            place = at + offset[0] * y + offset[1] * np.cross([1.0, 0.0, 0.0], y)
        values = [np.ones((len(at), 1)), (place - body.p_MB_M) @ body.R_MB]
        for mode in modes.T:
            u.x.array[:] = mode
            values.append(motion.eval(mesh, cells).reshape(-1, 3) @ body.R_MB)
        fields = np.hstack(values)
        gram += density * (fields * by[:, None]).T @ fields
    return model.comm.allreduce(gram)


def mesh_dimension(case):
    return reduced(case).model.mesh.mesh.topology.dim


def relative_to_fields(found, gram):
    """Largest difference of mass integrals, by the sizes of the two fields."""
    squares = np.diag(gram)
    size = np.sqrt(np.concatenate([squares[:1], np.repeat(squares[1:].reshape(-1, 3).sum(axis=1), 3)]))
    return (abs(found - gram) / np.outer(size, size)).max()


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_inertia_integrals_by_quadrature_and_by_point_masses(case):
    body = reduced(case).body()
    # a thin shell bends so much more easily than it stretches that its modes carry more round-off
    limit = 1e-12 if mesh_dimension(case) != 2 else 1e-10
    assert relative_to_fields(by_quadrature(reduced(case).model, body), body.gram) < limit
    found = point_masses(body)
    assert len(found.mass) <= 4 + 3 * body.n_modes
    phi = found.phi.swapaxes(1, 2).reshape(len(found.mass), -1)
    fields = np.hstack([np.ones((len(found.mass), 1)), found.x, phi])
    assert relative_to_fields((fields * found.mass[:, None]).T @ fields, body.gram) < limit
