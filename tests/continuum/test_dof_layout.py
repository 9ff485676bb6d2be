"""Unknowns with more than a displacement: their layout, matrices, rigid motions and interfaces."""

import types

from mpi4py import MPI

import basix.ufl
import dolfinx.fem.petsc
import micropolar
import numpy as np
import pytest
import saddle_point
import ufl
from dof_keys import everywhere, keys, matrix
from dolfinx import fem, la
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear


def variant(form, name, **changes):
    copy = types.ModuleType(name)
    copy.__dict__.update({**vars(form), **changes, "__name__": name, "__file__": None})
    return copy


def two_equal(cell, gdim, degree):
    part = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return basix.ufl.mixed_element([part, part])


MIXED = variant(micropolar, "micropolar_mixed", element=micropolar.mixed_element)
EQUAL = variant(micropolar, "micropolar_equal", element=two_equal)
FORMS = {"plain": solid_linear, "blocked": micropolar, "mixed": MIXED, "pressure": saddle_point}
MATERIALS = {
    "plain": solid_linear.Parameters(E=3.0e9, nu=0.28, rho=1200.0),
    "blocked": micropolar.Parameters(),
    "mixed": micropolar.Parameters(),
    "pressure": saddle_point.Parameters(),
}


def model(name, cell="tetrahedron", comm=MPI.COMM_WORLD, interfaces=(), degree=2):
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell=cell, degree=1, comm=comm)
    frames = [Interface(one) for one in interfaces]
    return ContinuumModel(mesh, FORMS[name], MATERIALS[name], degree=degree, interfaces=frames)


every_form = pytest.mark.parametrize("name", FORMS)


@pytest.mark.mpi
@every_form
def test_matrices_do_not_depend_on_the_number_of_ranks(name):
    world, alone = model(name), model(name, comm=MPI.COMM_SELF)
    assert abs(everywhere(world, keys(world)) - everywhere(alone, keys(alone))).max() < 1e-14
    for one, other in ((world.K, alone.K), (world.M, alone.M)):
        expected = matrix(alone, other)
        assert abs(matrix(world, one) - expected).max() < 1e-13 * abs(expected).max()


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_a_blocked_space_and_a_mixed_one_have_the_same_matrices(cell):
    """Of the same functions: one of them assembled in blocks of six, the other dof by dof."""
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell=cell, degree=1)
    blocked, mixed = (
        ContinuumModel(mesh, form, micropolar.Parameters(), degree=1) for form in (micropolar, EQUAL)
    )
    # blocked: place, then six components; mixed: first the displacement's, then the rotation's
    six = np.arange(len(everywhere(blocked, keys(blocked)))).reshape(-1, 6)
    order = np.concatenate([six[:, :3].ravel(), six[:, 3:].ravel()])
    for one, other in ((blocked.K, mixed.K), (blocked.M, mixed.M)):
        expected = matrix(mixed, other)
        assert abs(matrix(blocked, one)[np.ix_(order, order)] - expected).max() < 1e-13 * abs(expected).max()


def assembled(form):
    """A form of degree up to six as a dense matrix."""
    matrix = dolfinx.fem.petsc.assemble_matrix(fem.form(form * ufl.dx(metadata={"quadrature_degree": 6})))
    matrix.assemble()
    return gather(matrix).toarray()


def test_saddle_point_is_that_of_its_blocks():
    """Stiffness block by block, from forms written by hand on two spaces."""
    body = model("pressure", comm=MPI.COMM_SELF)
    p = MATERIALS["pressure"]
    lam, mu = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), p.E / (2 * (1 + p.nu))  # type: ignore[attr-defined]
    one, other = (field.space for field in body.layout.fields)
    u, v = ufl.TrialFunction(one), ufl.TestFunction(one)
    r, q = ufl.TrialFunction(other), ufl.TestFunction(other)
    blocks = [
        [2 * mu * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))), r * ufl.div(v)],
        [q * ufl.div(u), -r * q / lam],
    ]
    fields = [field.dofs for field in body.layout.fields]
    found = gather(body.K).toarray()
    for i, row in enumerate(blocks):
        for j, form in enumerate(row):
            expected = assembled(form)
            part = found[np.ix_(fields[i], fields[j])]
            assert abs(part - expected).max() < 1e-13 * abs(expected).max()


@pytest.mark.mpi
@every_form
def test_rigid_motions_field_by_field(name):
    """By hand in the nodes of each field; they cost no energy, and pressures do not move."""
    body = model(name)
    origin = np.array([0.1, -0.4, 2.0])
    axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    motions = body.rigid_motions(origin, axes)
    own = keys(body)[: body.n_owned]
    component = (own[:, 0] + own[:, 4]).astype(int)
    expected = np.zeros_like(motions)
    for i in range(6):
        direction = axes[:, i % 3]
        moved = np.tile(direction, (len(own), 1)) if i < 3 else np.cross(direction, own[:, 1:4] - origin)
        turned = np.zeros(3) if i < 3 or name == "pressure" else direction
        for c in range(3):
            expected[component == c, i] = moved[component == c, c]
            expected[component == 3 + c, i] = turned[c]
    assert abs(motions - expected).max(initial=0) < 1e-14
    stiffness, every = matrix(body, body.K), everywhere(body, motions)
    assert abs(stiffness @ every).max() < 1e-12 * abs(stiffness).max()


@pytest.mark.mpi
@every_form
def test_displacement_dofs_and_what_is_kinematic(name):
    body = model(name)
    every = keys(body)
    dofs = body.displacement_dofs
    assert np.array_equal(every[dofs, 0] + every[dofs, 4], np.tile([0.0, 1.0, 2.0], (len(dofs), 1)))
    assert abs(every[dofs][..., 1:4] - body.node_x[:, None]).max() < 1e-14
    assert (dofs[: body.n_owned_nodes] < body.n_owned).all()
    assert (dofs[body.n_owned_nodes :] >= body.n_owned).all()
    pressure = every[:, 0] + every[:, 4] > 2 if name == "pressure" else np.zeros(len(every), dtype=bool)
    assert np.array_equal(body.layout.kinematic, ~pressure)
    assert body.is_definite == (name != "pressure")


@pytest.mark.mpi
@every_form
def test_interfaces_bind_what_is_kinematic(name):
    """All displacements and rotations on the facets, owned or not, and no pressures."""
    body = model(name, interfaces=("x_min", "x_max"))
    every = keys(body)
    for frame, at in (("x_min", 0.0), ("x_max", 0.3)):
        there = (abs(every[:, 1] - at) < 1e-9) & body.layout.kinematic
        assert np.array_equal(np.sort(body.interface(frame).dofs), np.flatnonzero(there))


@pytest.mark.mpi
@every_form
def test_tangent_is_the_derivative_of_the_internal_forces(name):
    """By central differences of the forces of each term, at a displacement that is not small."""
    body = model(name, degree=2)
    own = keys(body)[: body.n_owned]
    # 4 % of strain
    at = 0.04 * np.cos(3 * own[:, 1] + 2 * own[:, 2] - own[:, 3] + own[:, 0] + own[:, 4])
    along = np.sin(2 * own[:, 1] - own[:, 2] + 3 * own[:, 3] + own[:, 4])
    forces = []
    for step in (1e-5, -1e-5):
        u = fem.Function(body.space)
        u.x.array[: body.n_owned] = at + step * along
        u.x.scatter_forward()
        total = fem.Function(body.space).x
        for term in body.internal_work(u, ufl.TestFunction(body.space)):
            fem.assemble_vector(total.array, fem.form(term))
        total.scatter_reverse(la.InsertMode.add)
        forces.append(everywhere(body, total.array))
    expected = (forces[0] - forces[1]) / 2e-5
    tangent = body.tangent(at)
    found = matrix(body, tangent) @ everywhere(body, along)
    tangent.destroy()
    assert abs(found - expected).max() < 1e-7 * abs(expected).max()
    if name == "plain":
        # St Venant-Kirchhoff: not the stiffness at rest
        rest = matrix(body, body.K) @ everywhere(body, along)
        assert abs(found - rest).max() > 1e-3 * abs(rest).max()


def p_bubble_first(cell, gdim, degree):
    return basix.ufl.mixed_element(
        [basix.ufl.element("Lagrange", cell, 1), basix.ufl.element("Lagrange", cell, 2, shape=(gdim,))]
    )


def broken(cell, gdim, degree):
    return basix.ufl.element("DG", cell, degree, shape=(gdim,))


@pytest.mark.mpi
@pytest.mark.parametrize("element", [p_bubble_first, broken])
def test_element_without_a_displacement_first_is_refused(element):
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell="tetrahedron", degree=1)
    form = variant(solid_linear, "form", element=element)
    with pytest.raises(FormulationError, match="three displacement components a node"):
        ContinuumModel(mesh, form, MATERIALS["plain"], degree=2)
