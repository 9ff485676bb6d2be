"""The continuum model: K and M against other ways of assembling them, on any number of ranks."""

import dataclasses
import gc
import types

from mpi4py import MPI

import basix.ufl
import dolfinx.fem.petsc
import numpy as np
import pytest
import scipy.sparse.linalg
import ufl
from dolfinx import fem
from full_model import FullModel, gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import FormulationError, InterfaceError, MeshError
from flexmbd.forms import solid_linear

MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0)


def block(cell="hexahedron", degree=1, comm=MPI.COMM_WORLD):
    return meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell=cell, degree=degree, comm=comm)


def norm_difference(found, expected):
    return scipy.sparse.linalg.norm(found - expected) / scipy.sparse.linalg.norm(expected)


def elasticity(space, lam, mu):
    """Hooke's law written down as a bilinear form, by hand."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    strain = ufl.sym(ufl.grad(u))
    stress = lam * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    return ufl.inner(stress, ufl.grad(v))


def assembled(form):
    matrix = dolfinx.fem.petsc.assemble_matrix(fem.form(form))
    matrix.assemble()
    return gather(matrix)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("cell", "geometry", "degree"),
    [("hexahedron", 1, 1), ("tetrahedron", 1, 2), ("tetrahedron", 2, 2)],
)
def test_matrices_are_those_of_a_hand_written_form(cell, geometry, degree):
    model = ContinuumModel(block(cell, geometry), solid_linear, MATERIAL, degree=degree)
    lam = MATERIAL.E * MATERIAL.nu / ((1 + MATERIAL.nu) * (1 - 2 * MATERIAL.nu))
    mu = MATERIAL.E / (2 * (1 + MATERIAL.nu))
    u, v = ufl.TrialFunction(model.space), ufl.TestFunction(model.space)
    # straight cells: a rule of this degree is exact for both
    dx = ufl.dx(metadata={"quadrature_degree": 8})
    stiffness = assembled(elasticity(model.space, lam, mu) * dx)
    mass = assembled(MATERIAL.rho * ufl.inner(u, v) * dx)
    assert norm_difference(gather(model.K), stiffness) < 1e-12
    assert norm_difference(gather(model.M), mass) < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("cell", "geometry", "degree"),
    [("hexahedron", 1, 1), ("tetrahedron", 1, 2), ("tetrahedron", 2, 2)],
)
def test_matrices_do_not_depend_on_the_number_of_ranks(cell, geometry, degree):
    world, alone = (
        FullModel(
            ContinuumModel(block(cell, geometry, comm), solid_linear, MATERIAL, degree=degree)
        )
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    assert abs(world.x - alone.x).max() < 1e-14
    assert norm_difference(world.K, alone.K) < 1e-12
    assert norm_difference(world.M, alone.M) < 1e-12


@pytest.mark.mpi
def test_rigid_motions_cost_no_energy_and_are_those_of_the_full_model():
    model = ContinuumModel(block("tetrahedron", 2), solid_linear, MATERIAL, degree=2)
    full = FullModel(model)
    origin, axes = (
        np.array([0.1, -0.4, 2.0]),
        np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0, 0, 1.0]]),
    )
    own = np.concatenate(model.comm.allgather(model.rigid_motions(origin, axes)))[full._order]
    expected = full.rigid(origin)
    expected = np.hstack([expected[:, :3] @ axes, expected[:, 3:] @ axes])
    assert abs(own - expected).max() < 1e-14
    assert abs(full.K @ own).max() < 1e-13 * abs(full.K).max()


def in_two_terms(lam_degree):
    """The energy of the small-strain solid in two terms, each with a rule of its own."""

    def strain_energy(u, p):
        lam, mu = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), p.E / (2 * (1 + p.nu))
        strain = ufl.sym(ufl.grad(u))
        return [
            (lam / 2 * ufl.tr(strain) ** 2, solid_linear.Quadrature(lam_degree)),
            (mu * ufl.inner(strain, strain), solid_linear.Quadrature(2)),
        ]

    return strain_energy


@pytest.mark.parametrize("degree", [0, 2])
def test_each_term_has_its_own_rule(degree):
    form = variant("selective", strain_energy=in_two_terms(degree))
    model = ContinuumModel(block(comm=MPI.COMM_SELF), form, MATERIAL, degree=1)
    lam = MATERIAL.E * MATERIAL.nu / ((1 + MATERIAL.nu) * (1 - 2 * MATERIAL.nu))
    mu = MATERIAL.E / (2 * (1 + MATERIAL.nu))
    expected = assembled(
        elasticity(model.space, lam, 0.0) * ufl.dx(metadata={"quadrature_degree": degree})
    ) + assembled(elasticity(model.space, 0.0, mu) * ufl.dx(metadata={"quadrature_degree": 2}))
    assert norm_difference(gather(model.K), expected) < 1e-13


def test_matrices_outlive_the_model():
    """PETSc works on our arrays without a copy; they must live as long as it."""
    stiffness = ContinuumModel(block(comm=MPI.COMM_SELF), solid_linear, MATERIAL, degree=1).K
    before = gather(stiffness)
    gc.collect()
    filler = [np.full(before.nnz, np.nan) for _ in range(50)]
    assert norm_difference(gather(stiffness), before) == 0.0
    assert len(filler) == 50


def variant(name, *, without=(), **changes):
    """The linear solid with some of its names changed or missing."""
    form = types.ModuleType(name)
    content = {key: value for key, value in vars(solid_linear).items() if key not in without}
    form.__dict__.update({**content, **changes, "__name__": name})
    return form


def edge_element(cell, gdim, degree):
    return basix.ufl.element("N1curl", cell, degree)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"mesh": "rod.msh"}, MeshError, "must be a TaggedMesh.*'rod.msh'"),
        ({"formulation": "solid_liner"}, FormulationError, "no 'solid_liner'"),
        (
            {"formulation": variant("form", without=["stress"])},
            FormulationError,
            "stress is missing",
        ),
        (
            {"formulation": variant("form", element=edge_element)},
            FormulationError,
            "three displacement components",
        ),
        (
            {"formulation": variant("form", CELLS=("tetrahedron",))},
            FormulationError,
            "form has no hexahedron",
        ),
        ({"parameters": {"E": 1.0}}, FormulationError, r"solid_linear\.Parameters\(\.\.\.\)"),
        ({"degree": 3}, FormulationError, r"of degree \[1, 2\], got degree=3"),
        ({"degree": True}, FormulationError, "got degree=True"),
        ({"degree": 1, "mesh": 2}, FormulationError, "degree=1 is below the degree 2"),
        (
            {"interfaces": [Interface("bore")]},
            InterfaceError,
            "'bore'.*no such group of facets.*'x_max', 'x_min'",
        ),
    ],
)
def test_what_does_not_fit_is_refused_on_all_ranks(change, error, message):
    arguments = {
        "mesh": 1,
        "formulation": solid_linear,
        "parameters": MATERIAL,
        "degree": 2,
        **change,
    }
    if isinstance(arguments["mesh"], int):
        arguments["mesh"] = block(degree=arguments["mesh"])
    first = [arguments.pop(name) for name in ("mesh", "formulation", "parameters")]
    with pytest.raises(error, match=message):
        ContinuumModel(*first, **arguments)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "other",
    [
        [Interface("bore")],
        [Interface("x_min", origin=(0.0, 0.0, 0.1))],
        [],
        [Interface("x_min"), Interface("x_max")],
        ["x_min"],
    ],
)
def test_interfaces_that_are_others_on_one_rank(other):
    mesh = block()
    last = mesh.comm.rank == mesh.comm.size - 1
    if mesh.comm.size == 1:
        pytest.skip("takes two ranks")
    interfaces = other if last else [Interface("x_min")]
    with pytest.raises(InterfaceError, match=r"^interfaces is \[Interface.* on rank 0 and .* on rank \d"):
        ContinuumModel(mesh, solid_linear, MATERIAL, degree=1, interfaces=interfaces)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"E": 0.0}, "E must be positive"),
        ({"E": float("nan")}, "E must be positive"),
        ({"nu": 0.5}, "nu must lie between"),
        ({"nu": -1.0}, "nu must lie between"),
        ({"rho": -1.0}, "rho must be positive"),
    ],
)
def test_material_out_of_range(values, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(MATERIAL, **values)


@pytest.mark.mpi
def test_unknown_interface_of_the_model():
    model = ContinuumModel(
        block(), solid_linear, MATERIAL, degree=1, interfaces=[Interface("x_min")]
    )
    assert model.interface("x_min").name == "x_min"
    with pytest.raises(InterfaceError, match="no interface 'x_max'; it has: 'x_min'"):
        model.interface("x_max")
