"""Fields of one cell: which they are, and that condensed in their cells they make the body that they make coupled."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse
from cooks_membrane import raised

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NonlinearModel, load_form, node_numbers
from flexmbd.continuum.contract.cell_fields import common_cell_fields, find_cell_fields
from flexmbd.continuum.finite_elements.condensation import inverted
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_enhanced, solid_linear, solid_mixed, st_venant_kirchhoff
from flexmbd.forms.j2_plasticity import LinearHardening, VoceHardening
from flexmbd.reduction import Keep, KelvinVoigtDamping, Truncation, craig_bampton, linear_buckling, prestressed
from flexmbd.reduction.unit_loads import Traction, load_vectors

DATA = Path(__file__).parents[1] / "data"
STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}
METAL = {**STEEL, "yield_stress": 2e8}
SELF = MPI.COMM_SELF


def form_of(name):
    return load_form(DATA / f"{name}.py")


def fields_of(form, cell, degree, p=None):
    return find_cell_fields(form, p or form.reference().parameters, cell=cell, degree=degree)


def bar(divisions=(4, 2, 1), *, comm=SELF, cell="hexahedron", sheared=0.3):
    """A block of cells that are no parallelepipeds."""
    mesh = meshes.block(1.0, 0.3, 0.2, divisions=divisions, comm=comm, cell=cell)
    x = mesh.mesh.geometry.x
    inner = np.sin(np.pi * x[:, 0]) * sheared
    x[:, 1] *= 1.0 + 0.4 * inner
    x[:, 2] *= 1.0 - 0.5 * inner * x[:, 1] / 0.15
    return mesh


def model_of(form, p, degree=1, *, mesh=None, **more):
    interfaces = [Interface("x_min"), Interface("x_max")]
    return ContinuumModel(mesh or bar(), form, p, degree=degree, interfaces=interfaces, **more)


def dense(matrix):
    begins, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_array((values, columns, begins), shape=matrix.getSize()).toarray()


def by_number(model):
    """Nodes in the order of the mesh's input."""
    return np.argsort(node_numbers(model))


def test_which_fields_are_of_one_cell():
    found = fields_of(solid_enhanced, "hexahedron", 1)
    assert found.of_cell == (1,)
    assert found.shared_element == solid_linear.element("hexahedron", 3, 1)
    assert found.cell_places.tolist() == list(range(24, 36))
    assert found.names([0]) == "unknowns 3 to 14"
    # a pressure in each cell, unless nothing but the displacement determines it
    mixed = {nu: fields_of(solid_mixed, "hexahedron", 1, solid_mixed.Parameters(1e6, nu, 1e3)) for nu in (0.4999, 0.5)}
    assert mixed[0.4999].names([0]) == "unknown 3"
    assert mixed[0.5] is None
    # continuous ones, and a plain displacement
    assert fields_of(solid_mixed, "tetrahedron", 2) is None
    assert fields_of(form_of("phase_field"), "hexahedron", 1) is None
    assert fields_of(solid_linear, "hexahedron", 2) is None
    # a symmetric tensor has six dofs and nine components
    stress = fields_of(form_of("discontinuous_stress"), "tetrahedron", 2)
    assert (len(stress.cell_places), stress.shared_components.tolist()) == (24, [0, 1, 2])
    assert common_cell_fields([found, None]) is None


def test_a_field_with_mass_or_dissipation_is_none_of_one_cell(tmp_path):
    for name, kind in (("kinetic_energy", "solid"), ("dissipation", "viscous")):
        path = tmp_path / f"{kind}.py"
        path.write_text(
            "import ufl\nfrom flexmbd.forms import solid_enhanced as base\n"
            + "\n".join(f"{one} = base.{one}" for one in ("Parameters", "Quadrature", "CELLS", "ORDER", "REFERENCE",
                "element", "strain_energy", "rigid_motion", "stress", "reference", "kinetic_energy"))
            + f"\ndef {name}(v, p):\n    d, a = ufl.split(v)\n"
            "    e = ufl.sym(ufl.grad(d))\n"
            "    return [(p.rho / 2 * (ufl.inner(d, d) + ufl.inner(a, a)), Quadrature(4))]\n".replace(
                "ufl.inner(d, d) +", "ufl.inner(d, d) +" if name == "kinetic_energy" else "ufl.inner(e, e) +")
        )  # fmt: skip
        assert fields_of(load_form(path), "hexahedron", 1) is None


@pytest.mark.parametrize("name", ["enhanced", "pressure", "stress"])
def test_condensed_stiffness_is_the_schur_complement(name):
    """Of the coupled matrix, by dense algebra: the fields least, largest, or neither; and so is the mass."""
    form, cell, degree = {
        "enhanced": (solid_enhanced, "hexahedron", 1),
        "pressure": (solid_mixed, "hexahedron", 1),
        "stress": (form_of("discontinuous_stress"), "tetrahedron", 2),
    }[name]
    p = form.Parameters(2.1e11, 0.3, 7850.0)
    mesh = bar((2, 1, 1), cell=cell)
    condensed, coupled = (model_of(form, p, degree, mesh=mesh, condense=one) for one in (True, False))
    whole, mass = dense(coupled.K), dense(coupled.M)
    d = coupled.displacement_dofs[by_number(coupled)].reshape(-1)
    own = condensed.displacement_dofs[by_number(condensed)].reshape(-1)
    a = np.setdiff1d(np.arange(len(whole)), d)
    schur = whole[np.ix_(d, d)] - whole[np.ix_(d, a)] @ np.linalg.solve(whole[np.ix_(a, a)], whole[np.ix_(a, d)])
    assert condensed.is_definite
    assert not coupled.is_definite
    assert np.allclose(dense(condensed.K)[np.ix_(own, own)], schur, rtol=0, atol=1e-12 * abs(schur).max())
    assert np.allclose(dense(condensed.M)[np.ix_(own, own)], mass[np.ix_(d, d)], rtol=0, atol=1e-14 * abs(mass).max())


def test_a_stress_as_rich_as_the_strain_makes_the_plain_body():
    form, mesh = form_of("discontinuous_stress"), bar((2, 1, 1), cell="tetrahedron")
    mixed = model_of(form, form.Parameters(**STEEL), 2, mesh=mesh)
    plain = model_of(solid_linear, solid_linear.Parameters(**STEEL), 2, mesh=mesh)
    assert np.allclose(dense(mixed.K), dense(plain.K), rtol=0, atol=1e-11 * abs(dense(plain.K)).max())
    bodies = [craig_bampton(model, modes=4, frame="x_min", keep=Keep(modes=True)) for model in (mixed, plain)]
    assert bodies[0].stiffness == pytest.approx(bodies[1].stiffness, rel=1e-9)
    q = 1e-5 * np.arange(1.0, 1.0 + bodies[0].n_modes)
    q *= np.sign(np.einsum("kan,kan->n", bodies[0].modes.phi, bodies[1].modes.phi))
    fields = [
        model.stress_field(body, values)
        for model, body, values in zip((mixed, plain), bodies, (q, abs(q)), strict=True)
    ]
    size = fields[1].max
    assert fields[0].max == pytest.approx(size, rel=1e-9)
    assert np.allclose(fields[0].stress, fields[1].stress, rtol=0, atol=1e-9 * size)


def test_a_reduced_body_is_that_of_coupled_fields():
    """Stiffness, geometric stiffness, damping and stress; a loaded state is found with coupled fields."""
    p, damping = solid_enhanced.Parameters(**STEEL), KelvinVoigtDamping(1e-4)
    models = [model_of(solid_enhanced, p, condense=one) for one in (True, False)]
    bodies = [craig_bampton(m, modes=5, frame="x_min", keep=Keep(modes=True), damping=damping) for m in models]
    one, other = bodies
    assert len(one.stiffness) == len(other.stiffness)
    assert one.stiffness == pytest.approx(other.stiffness, rel=1e-9)
    signs = np.sign(np.einsum("kan,kan->n", one.modes.phi, other.modes.phi))
    both = signs[:, None] * signs
    assert np.allclose(both * one.damping, other.damping, rtol=0, atol=1e-9 * abs(other.damping).max())
    assert one.geometric.loads == other.geometric.loads
    assert np.allclose(both * one.geometric.K, other.geometric.K, rtol=0, atol=1e-7 * abs(other.geometric.K).max())
    q = 1e-6 * np.arange(1.0, 1.0 + one.n_modes)
    stress = [model.stress_field(body, v).stress for model, body, v in zip(models, bodies, (signs * q, q), strict=True)]
    assert np.allclose(stress[0], stress[1], rtol=0, atol=1e-8 * abs(stress[1]).max())
    loads = [(Traction("pull", "x_max", (1.0, 0.0, 0.0)), 1e8)]
    loaded = [prestressed(model, frame="x_min", loads=loads) for model in models]
    assert dense(loaded[0].K).shape == dense(loaded[1].K).shape
    assert np.allclose(dense(loaded[0].K), dense(loaded[1].K), rtol=0, atol=1e-9 * abs(dense(loaded[1].K)).max())


def test_a_slender_column_of_one_cell_buckles_as_eulers():
    """A quarter of the wave length of pi^2 E I / (4 L^2); one brick through the thickness."""
    mesh = meshes.block(1.0, 0.02, 0.02, divisions=(16, 1, 1), comm=SELF)
    model = ContinuumModel(
        mesh, solid_enhanced, solid_enhanced.Parameters(2.1e11, 0.0, 7850.0), degree=1,
        interfaces=[Interface("x_min"), Interface("x_max")],
    )  # fmt: skip
    found = linear_buckling(model, clamped=["x_min"], forces={"x_max": (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)}, count=2)
    euler = np.pi**2 * 2.1e11 * 0.02**4 / 12 / 4
    assert found.factors == pytest.approx([euler, euler], rel=5e-3)


@pytest.mark.parametrize("nu", [0.3, 0.4999])
def test_one_brick_through_the_thickness_bends_as_a_beam(nu):
    """First frequencies of a cantilever by Euler and Bernoulli's beam, Hz; plain bricks are off by 77 % at nu = 0.3."""
    mesh = meshes.block(1.0, 0.03, 0.02, divisions=(20, 1, 1), degree=1)
    model = ContinuumModel(
        mesh, solid_enhanced, solid_enhanced.Parameters(2.1e11, nu, 7850.0), degree=1, interfaces=[Interface("x_min")]
    )
    found = craig_bampton(model, modes=8, frame="x_min").frequencies(clamped=["x_min"])[:2]
    beam = 1.875104**2 / (2 * np.pi) * np.sqrt(2.1e11 / 7850.0) * np.array([0.02, 0.03]) / np.sqrt(12.0)
    assert found == pytest.approx(beam, rel=0.01)  # the clamped end cannot widen


def test_nine_enhanced_strains_as_another_program_has_them():
    """Own assembly and condensation in dolfinx, Hz."""
    mesh, form = meshes.block(1.0, 0.03, 0.02, divisions=(20, 1, 1), degree=1), form_of("enhanced_strain")
    model = ContinuumModel(mesh, form, form.Parameters(**STEEL), degree=1, interfaces=[Interface("x_min")])
    for modes in (8, Truncation(8, complete=False), Truncation(below_hz=500.0), Truncation(tol=1e-2)):
        found = craig_bampton(model, modes=modes, frame="x_min").frequencies(clamped=["x_min"])[:3]
        assert found == pytest.approx([16.775, 25.137, 105.574], rel=3e-5)


def test_cooks_membrane():
    """Plane stress against the literature's 23.96 F / E; nearly incompressible against Taylor and Hood's pair, 24 x 24."""
    small = {"young": 1e4, "load": 1e-2}
    plane_stress = raised(32, solid_enhanced, degree=1, **small)[0]
    assert plane_stress * 1e4 / 1e-2 == pytest.approx(23.96, rel=5e-3)
    exact = 1.8495e-5
    found = [
        raised(n, solid_enhanced, degree=1, held=("z_min", "z_max"), nu=0.4999, **small)[0] / exact for n in (8, 16, 32)
    ]
    assert found == sorted(found)
    assert found[1] == pytest.approx(1.0, abs=0.02)
    assert found[2] == pytest.approx(1.0, abs=0.006)
    plain = raised(16, st_venant_kirchhoff, degree=1, held=("z_min", "z_max"), nu=0.4999, **small)[0]
    assert plain < 0.4 * exact


@pytest.mark.parametrize("law", [LinearHardening(1e9), VoceHardening(1e8, 50.0)], ids=["closed", "local unknowns"])
def test_tangent_of_a_yielding_body_is_the_derivative(law):
    form = form_of("enhanced_plasticity")
    body = NonlinearModel(bar(), form, form.Parameters(**METAL, hardening=law), degree=1)
    rng = np.random.default_rng(3)
    x = body.layout.node_x
    u = (2e-3 * np.sin(3 * x[:, [1, 2, 0]] + 2 * x[:, [2, 0, 1]])).reshape(-1)
    body.force(u)
    body.commit(u)
    assert (body.history()[0][:, 6] > 0.0).mean() > 0.3
    step, along = 0.5 * u, rng.normal(size=u.shape)
    tangent, h = body.tangent(step), 1e-8
    left, right = tangent.createVecs()
    right.array[:] = along
    tangent.mult(right, left)
    change = (body.force(step + h * along) - body.force(step - h * along)) / (2 * h)
    assert np.linalg.norm(change - left.array) < 1e-6 * np.linalg.norm(change)


def test_slow_loading_is_that_of_coupled_fields():
    """A bar that is bent far: the same places, with fewer unknowns; a rejected trial leaves no trace."""
    p = solid_enhanced.Parameters(2.1e11, 0.3, 7850.0)
    found = []
    for condense in (True, False):
        body = NonlinearModel(bar(), solid_enhanced, p, degree=1, condense=condense)
        held = prescribed_dofs(body, {"x_min": "xyz"})
        force = np.zeros(body.n_owned)
        load = load_vectors(body, [Traction("up", "x_max", (0.0, 0.0, 1.0))])[:, 0]
        force[: len(load)] = load
        follow(body, [0.5, 1.0], prescribed=held, load=lambda t, f=force: t * 4e8 * f)
        before, way = body.snapshot(), np.full(body.layout.n_local, 1e-4)
        answer = body.force(np.zeros_like(way))
        body.force(way * np.arange(len(way)) / len(way))
        body.revert()
        assert np.allclose(body.force(np.zeros_like(way)), answer, rtol=0, atol=1e-9 * abs(answer).max())
        body.restore(before)
        assert np.allclose(body.force(np.zeros_like(way)), answer, rtol=0, atol=1e-9 * abs(answer).max())
        found.append((body.displacement[body.displacement_dofs[by_number(body)]], body.energies()["elastic"]))
    (condensed, energy), (coupled, same) = found
    assert abs(coupled).max() > 0.1
    assert np.allclose(condensed, coupled, rtol=0, atol=1e-8 * abs(coupled).max())
    assert energy == pytest.approx(same, rel=1e-8)


def test_inverses_of_blocks_of_unlike_units():
    """Hu and Washizu's: strains, and stresses that are multipliers; and which blocks have none."""
    c = 2e11 * np.diag([1.0, 2.0, 3.0])
    block = np.block([[c, -np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    empty = np.zeros((6, 6))
    twice = np.ones((6, 6))
    found, singular = inverted(np.array([block, empty, twice]))
    exact = np.block([[np.zeros((3, 3)), -np.eye(3)], [-np.eye(3), -c]])
    assert np.allclose(found[0], exact, rtol=1e-13, atol=1e-13)
    assert singular.tolist() == [False, True, True]


UNDETERMINED = """
import basix.ufl
import ufl
from flexmbd.forms import solid_linear as base
from flexmbd.forms.solid_linear import Parameters, Quadrature, REFERENCE, reference
CELLS = ("hexahedron",)
ORDER = {1: 2}

def element(cell, gdim, degree):
    return basix.ufl.mixed_element([base.element(cell, gdim, degree), basix.ufl.element("DG", cell, 0, shape=(2,))])

def strain_energy(u, p):
    d, a = ufl.split(u)
    e = ufl.sym(ufl.grad(d))
    return [(p.E / 2 * (ufl.inner(e, e) + (a[0] + a[1] - ufl.tr(e)) ** 2), Quadrature(3))]

def kinetic_energy(v, p):
    d, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(d, d), Quadrature(4))]

def rigid_motion(x, translation, rotation):
    m = translation + ufl.cross(rotation, x)
    return ufl.as_vector([m[0], m[1], m[2], 0.0, 0.0])

def stress(u, state, p):
    return p.E * ufl.sym(ufl.grad(ufl.split(u)[0]))
"""


@pytest.mark.mpi
def test_a_field_that_its_equations_leave_open_is_named(tmp_path):
    path = Path(MPI.COMM_WORLD.bcast(str(tmp_path))) / "undetermined.py"
    if MPI.COMM_WORLD.rank == 0:
        path.write_text(UNDETERMINED)
    MPI.COMM_WORLD.barrier()
    form = load_form(path)
    mesh = bar(comm=MPI.COMM_WORLD)
    for kind in (ContinuumModel, NonlinearModel):
        with pytest.raises(FormulationError, match=r"the unknowns 3 to 4 of the form are fields of one cell, and their own"):
            kind(mesh, form, form.Parameters(**STEEL), degree=1)


@pytest.mark.mpi
def test_the_same_body_on_any_number_of_ranks():
    p = solid_enhanced.Parameters(**STEEL)
    answers = []
    for comm in (SELF, MPI.COMM_WORLD):
        model = model_of(solid_enhanced, p, mesh=bar((6, 2, 2), comm=comm))
        body = craig_bampton(model, modes=5, frame="x_min", keep=Keep(modes=True))
        field = model.stress_field(body, 1e-6 * np.ones(body.n_modes))
        history = NonlinearModel(bar((6, 2, 2), comm=comm), solid_enhanced, p, degree=1)
        x = history.layout.node_x
        u = (1e-2 * np.sin(3 * x[:, [1, 2, 0]] + 2 * x[:, [2, 0, 1]])).reshape(-1)
        force = history.force(u)
        squared = history.norm(force)
        history.commit(u)
        tangent = history.tangent(np.zeros_like(u)).norm()
        answers.append([*body.stiffness / 1e9, field.max, squared, tangent, history.energies()["elastic"]])
    assert answers[1] == pytest.approx(answers[0], rel=1e-9)
