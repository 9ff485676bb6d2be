"""What stress adds to the stiffness: by tensors, by forms, by hand, and by finite differences of the tangent."""

import dataclasses
import types

from mpi4py import MPI

import dolfinx.fem.petsc
import dolfinx.mesh
import numpy as np
import pytest
import ufl
from dolfinx import fem
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.forms import solid_linear, solid_nearly_incompressible
from flexmbd.reduction.stiffening import stress_stiffness as module
from flexmbd.reduction.stiffening.stress_stiffness import stress_stiffness

MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0)
KINDS = [("tetrahedron", 1, 2), ("tetrahedron", 2, 2), ("hexahedron", 1, 1)]


def block(cell, degree, comm=MPI.COMM_WORLD):
    return meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell=cell, degree=degree, comm=comm)


def variant(**functions):
    """A form like solid_linear, with other functions."""
    form = types.ModuleType("variant")
    public = {name: value for name, value in vars(solid_linear).items() if not name.startswith("__")}
    form.__dict__.update(public, **functions)
    return form


def fields(model, count):
    """Fields that no partition changes, (local dofs, count)."""
    x = model.node_x @ np.array([[5.0, 1.0, -2.0], [3.0, -7.0, 4.0], [1.0, 6.0, 8.0]])
    columns = []
    for k in range(count):
        field = np.zeros(model.layout.n_local)
        field[model.displacement_dofs] = np.sin((1.0 + 0.3 * k) * x + k) @ np.roll(np.eye(3), k, axis=0)
        columns.append(field + 0.2 * k)
    return np.stack(columns, axis=1)


def relative(found, expected):
    return abs(found - expected).max() / abs(expected).max()


def by_forms(monkeypatch):
    """The general path, as for a density that is not the same in every point."""
    monkeypatch.setattr(module, "gradient_tensor", lambda term, u: None)


def hooke(h, material):
    lam = material.E * material.nu / ((1 + material.nu) * (1 - 2 * material.nu))
    mu = material.E / (2 * (1 + material.nu))
    return lam * ufl.tr(h) * ufl.Identity(3) + mu * (h + h.T)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "geometry", "degree"), KINDS)
def test_three_ways_agree(cell, geometry, degree, monkeypatch):
    """By the tensor, by forms, and Hooke's law written down by hand, on straight and curved elements."""
    model = ContinuumModel(block(cell, geometry), solid_linear, MATERIAL, degree=degree)
    loaded, modes = fields(model, 2), fields(model, 4)
    found = stress_stiffness(model, loaded, modes)
    assert np.array_equal(found, found.transpose(0, 2, 1))
    assert all(np.array_equal(found, other) for other in model.comm.allgather(found))

    (_, rule), *_ = solid_linear.strain_energy(fem.Function(model.space), MATERIAL)
    a = fem.Function(model.space)
    b, c = ufl.TestFunction(model.space), ufl.TrialFunction(model.space)
    second = ufl.grad(b).T * ufl.grad(c)
    form = fem.form(ufl.inner(hooke(ufl.grad(a), MATERIAL), second) * ufl.dx(degree=rule.degree))
    for i, field in enumerate(loaded.T):
        a.x.array[:] = field
        matrix = dolfinx.fem.petsc.assemble_matrix(form)
        matrix.assemble()
        expected = inner(model.comm, modes[: model.n_owned], multiply(matrix, modes[: model.n_owned]))
        assert relative(found[i], expected) < 1e-12

    by_forms(monkeypatch)
    assert relative(stress_stiffness(model, loaded, modes), found) < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "geometry", "degree"), KINDS)
def test_any_number_of_ranks(cell, geometry, degree):
    found, alone = (
        stress_stiffness(model, fields(model, 3), fields(model, 3))
        for model in (
            ContinuumModel(block(cell, geometry, comm), solid_linear, MATERIAL, degree=degree)
            for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
        )
    )
    assert relative(found, alone) < 1e-12


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 2), ("hexahedron", 1)])
def test_three_parts_are_the_derivative_of_the_tangent(cell, degree):
    """P(a; b, c) + P(b; c, a) + P(c; a, b) = D^3 W(0)[a, b, c], by differences of the assembled tangent."""
    model = ContinuumModel(block(cell, 1, MPI.COMM_SELF), solid_linear, MATERIAL, degree=degree)
    u = fields(model, 4)
    part = stress_stiffness(model, u, u)
    whole = part + part.transpose(1, 2, 0) + part.transpose(2, 0, 1)
    for i, field in enumerate(u.T):
        # the energy is of fourth order, so that the difference is exact for any step
        up, down = (gather(model.tangent(step * field)) for step in (0.5, -0.5))
        assert relative(whole[i], u.T @ ((up - down) @ u)) < 1e-11


def test_a_density_that_varies_is_found_out():
    """Young's modulus grows along x: the same as the sum over thin pieces, each with its own."""

    def strain_energy(u, p):
        x = ufl.SpatialCoordinate(u.ufl_function_space().ufl_domain())
        (density, rule), *_ = solid_linear.strain_energy(u, p)
        return [((1.0 + x[0]) * density, type(rule)(rule.degree + 1))]

    mesh = block("hexahedron", 1, MPI.COMM_SELF)
    model = ContinuumModel(mesh, variant(strain_energy=strain_energy), MATERIAL, degree=1)
    u = fem.Function(model.space)
    assert module.gradient_tensor(strain_energy(u, MATERIAL)[0], u) is None
    # constant stretch along z, constant slopes: the integral of stress is by hand
    x = model.node_x
    stretched, sheared = np.zeros_like(x), np.zeros_like(x)
    stretched[:, 2] = 1e-3 * x[:, 2]
    sheared[:, 1] = x[:, 2]
    found = stress_stiffness(model, stretched.reshape(-1, 1), sheared.reshape(-1, 1))[0, 0, 0]
    lam = MATERIAL.E * MATERIAL.nu / ((1 + MATERIAL.nu) * (1 - 2 * MATERIAL.nu))
    mu = MATERIAL.E / (2 * (1 + MATERIAL.nu))
    volume, centre = 0.3 * 0.1 * 0.2, x[:, 0].mean()
    assert found == pytest.approx((1.0 + centre) * (lam + 2 * mu) * 1e-3 * volume, rel=1e-12)


@pytest.mark.parametrize(
    "density",
    [
        lambda u: ufl.dot(u, u) * ufl.tr(ufl.grad(u)),
        lambda u: ufl.tr(ufl.grad(u)) ** 3 * ufl.CellVolume(u.ufl_function_space().ufl_domain()),
        lambda u: ufl.dot(ufl.grad(ufl.div(u)), ufl.grad(ufl.div(u))) * (1 + ufl.div(u)),
    ],
    ids=["of the displacement", "of the cell", "of the second gradient"],
)
def test_no_tensor_for_other_densities(density):
    model = ContinuumModel(block("tetrahedron", 1, MPI.COMM_SELF), solid_linear, MATERIAL, degree=2)
    u = fem.Function(model.space)
    rule = solid_linear.Quadrature(2)
    assert module.gradient_tensor((density(u), rule), u) is None
    assert module.gradient_tensor(solid_linear.strain_energy(u, MATERIAL)[0], u).shape == (9, 9)


@pytest.mark.parametrize("marked", ["the strain", "F", "the trace"])
def test_what_a_solid_marks_does_not_matter(monkeypatch, marked):
    """Only lines and surfaces mark their strains; a solid may have variables for other ends."""

    def strain_energy(u, p):
        h = ufl.grad(u)
        strain = (h + h.T + h.T * h) / 2
        if marked == "the strain":
            strain = ufl.variable(strain)
        elif marked == "F":
            f = ufl.variable(ufl.Identity(3) + h)
            strain = (f.T * f - ufl.Identity(3)) / 2
        else:
            strain = ufl.dev(strain) + ufl.variable(ufl.tr(strain)) / 3 * ufl.Identity(3)
        (_, rule), *_ = solid_linear.strain_energy(u, p)
        return [(ufl.inner(hooke(strain, p), strain) / 2, rule)]

    model = ContinuumModel(
        block("hexahedron", 1, MPI.COMM_SELF), variant(strain_energy=strain_energy), MATERIAL, degree=1
    )
    found = stress_stiffness(model, fields(model, 3), fields(model, 3))
    by_forms(monkeypatch)
    assert relative(stress_stiffness(model, fields(model, 3), fields(model, 3)), found) < 1e-12


def test_a_quadratic_energy_has_none():
    def strain_energy(u, p):
        strain = ufl.sym(ufl.grad(u))
        (_, rule), *_ = solid_linear.strain_energy(u, p)
        return [(ufl.inner(hooke(strain, p), strain) / 2, rule)]

    model = ContinuumModel(
        block("hexahedron", 1, MPI.COMM_SELF), variant(strain_energy=strain_energy), MATERIAL, degree=1
    )
    assert stress_stiffness(model, fields(model, 2), fields(model, 2)) is None


def test_groups_of_cells_and_terms_with_rules_of_their_own():
    """Two materials by halves, one of them with selective integration, against a stretch by hand."""
    mesh = block("hexahedron", 1, MPI.COMM_SELF)
    soft = solid_nearly_incompressible.Parameters(E=2.0e6, nu=0.49, rho=1100.0)
    hard = solid_linear.Parameters(E=3.0e6, nu=0.1, rho=1100.0)
    model = ContinuumModel(
        halves(mesh, 0.1), {"left": (solid_nearly_incompressible, soft), "right": (solid_linear, hard)}, degree=2
    )
    x = model.node_x
    stretched, sheared = np.zeros_like(x), np.zeros_like(x)
    stretched[:, 2] = 1e-3 * x[:, 2]
    sheared[:, 1] = x[:, 2]
    found = stress_stiffness(model, stretched.reshape(-1, 1), sheared.reshape(-1, 1))[0, 0, 0]
    moduli = [p.E * (1 - p.nu) / ((1 + p.nu) * (1 - 2 * p.nu)) for p in (soft, hard)]
    volumes = 0.02 * np.array([0.1, 0.2])
    assert found == pytest.approx(1e-3 * np.dot(moduli, volumes), rel=1e-12)


def halves(mesh, width):
    """The mesh with a cell group for the first part along x, and one for the rest."""
    count = mesh.mesh.topology.index_map(3).size_local
    cells = np.arange(count, dtype=np.int32)
    middle = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, cells)[:, 0]
    left = mesh.mesh.geometry.x[:, 0].min() + width
    tags = dolfinx.mesh.meshtags(mesh.mesh, 3, cells, np.where(middle < left, 1, 2).astype(np.int32))
    return dataclasses.replace(mesh, cell_tags=tags, cell_groups={"left": 1, "right": 2})
