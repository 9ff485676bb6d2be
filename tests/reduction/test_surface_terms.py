"""Springs and mass on facets of a reduced body, from a form file to a machine: rods, a beam on a foundation."""

import types
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from one_element import one_element

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    BodyAcceleration,
    ContinuumModel,
    Interface,
    NonlinearModel,
    check_form,
    follow,
    homogeneous_energy,
    load_form,
    lumped_mass,
    prescribed_dofs,
    rigid_body_of,
)
from flexmbd.errors import FlexmbdError, FormulationError, MeshError, ReductionError
from flexmbd.forms import solid_linear, solid_micropolar, st_venant_kirchhoff
from flexmbd.reduction import KelvinVoigtDamping, Pressure, craig_bampton, guyan, prestressed

FILE = Path(__file__).parents[1] / "data" / "founded_solid.py"
TEXT = FILE.read_text()
FORM = load_form(FILE)
E, RHO = 2.1e9, 7850.0
#: Without contraction across it, so that a rod is that of one dimension.
PLAIN = solid_linear.Parameters(E=E, nu=0.0, rho=RHO)
SIZE = np.array([0.4, 0.02, 0.01])
L, B, H = SIZE


def on_facets(**values):
    return FORM, FORM.Parameters(E=E, nu=0.0, rho=RHO, **values)


def rod(surfaces=None, *, ends=("x_min", "x_max"), divisions=(8, 1, 1), degree=1, comm=MPI.COMM_WORLD, **more):
    mesh = meshes.block(*SIZE, divisions=divisions, comm=comm)
    interfaces = [Interface(name, **more) for name in ends]
    return ContinuumModel(mesh, solid_linear, PLAIN, degree=degree, interfaces=interfaces, surfaces=surfaces)


MASS_ALONE = types.ModuleType("mass_alone")
MASS_ALONE.__dict__.update({name: value for name, value in vars(FORM).items() if name != "surface_energy"})
MASS_ALONE.__dict__.update({"__name__": "mass_alone", "__file__": None})


@pytest.mark.mpi
@pytest.mark.parametrize("coupling", [fm.Coupling.RIGID, fm.Coupling.AVERAGED])
def test_a_rod_with_springs_on_its_end_is_as_stiff_as_both(coupling):
    """1 / (E A / L + k A), by statics; the end across springs of k2 is 3 E I / L^3 and what they add."""
    k, across = 3e9, 4e6
    mesh = meshes.block(*SIZE, divisions=(8, 1, 1), comm=MPI.COMM_WORLD)
    ends = [Interface("x_min"), Interface("x_max", coupling=coupling)]
    springs = {"x_max": on_facets(normal=k, across=across)}
    model = ContinuumModel(mesh, solid_linear, PLAIN, degree=2, interfaces=ends, surfaces=springs)
    record = guyan(model, frame="x_min", geometric_stiffness=False)
    rows = record.interface("x_max").modes
    compliance = (rows / record.stiffness) @ rows.T
    assert compliance[0, 0] == pytest.approx(1 / (E * B * H / L + k * B * H), rel=1e-9)
    # the end turns as well, against the springs' k I: a beam of two stiffnesses at its end, with shear
    assert record.provenance["springs on facets"] == "to the body frame, x_min"
    assert "normal=3000000000.0" in record.provenance["surfaces"]


def test_a_record_on_springs_swings_alike_by_any_solver_and_reads_back(tmp_path):
    """Of a body with springs all along; conjugate gradients instead of a factor; the file bit for bit."""
    from flexmbd.reduction import Solver

    model = rod({"z_min": on_facets(normal=5e8, across=2e8)}, degree=2, comm=MPI.COMM_SELF)
    record = craig_bampton(model, modes=4, frame="x_min")
    other = craig_bampton(model, modes=4, frame="x_min", solver=Solver.ITERATIVE)
    ends = ["x_min"]
    np.testing.assert_allclose(other.frequencies(ends), record.frequencies(ends), rtol=1e-8)
    record.save(tmp_path / "rod.h5")
    assert fm.ReducedBody.load(tmp_path / "rod.h5").fingerprint() == record.fingerprint()


@pytest.mark.mpi
def test_a_rod_with_mass_on_its_end():
    """x tan x = rho L / m, x = omega L / c, of the longitudinal vibrations (Rao 2007, Vibration of Continuous
    Systems, section 9.2)."""
    m = 0.7 * RHO * L
    model = rod({"x_max": on_facets(mass=m)}, ends=("x_min",), divisions=(24, 1, 1), degree=2)
    record = craig_bampton(model, modes=40, frame="x_min")
    found = 2 * np.pi * record.frequencies(["x_min"]) * L / np.sqrt(E / RHO)
    first = scipy.optimize.brentq(lambda x: x * np.tan(x) - RHO * L / m, 1e-6, np.pi / 2 - 1e-6)
    second = scipy.optimize.brentq(lambda x: x * np.tan(x) - RHO * L / m, np.pi / 2 + 1e-6, 3 * np.pi / 2 - 1e-6)
    for exact in (first, second):
        assert abs(found / exact - 1).min() < 2e-6


@pytest.mark.mpi
def test_a_beam_on_a_foundation_of_winklers():
    """omega^2 is that without it and k / (rho h), in every bending mode across it (Timoshenko 1928, section 54)."""
    k = 1e6

    def squares(surfaces):
        model = rod(surfaces, ends=("x_min",), divisions=(24, 1, 1), degree=2)
        return (2 * np.pi * craig_bampton(model, modes=6, frame="x_min").frequencies(["x_min"])) ** 2

    free, founded = squares(None), squares({"z_min": on_facets(normal=k)})
    added = k / (RHO * H)
    # the flat beam bends against the springs in the first and the third mode, and along them in the second
    assert added > 10 * free[0]
    assert founded[:3] == pytest.approx([free[1], free[0] + added, free[2] + added], rel=1e-3)


@pytest.mark.mpi
def test_mass_centre_and_inertia_with_a_plate_on_the_end():
    m = 300.0
    model = rod({"x_max": (MASS_ALONE, on_facets(mass=m)[1])})
    plate, block = m * B * H, RHO * L * B * H
    mass = plate + block
    centre = (plate * L + block * L / 2) / mass
    second = np.diag([0.0, B**2 / 12, H**2 / 12]) * mass
    second[0, 0] = plate * L**2 + block * L**2 / 3 - mass * centre**2
    body = rigid_body_of(model)
    assert body.mass == pytest.approx(mass, rel=1e-12)
    assert body.com == pytest.approx([centre, 0, 0], abs=1e-13)
    np.testing.assert_allclose(body.inertia, np.trace(second) * np.eye(3) - second, rtol=0, atol=1e-11 * second.max())
    record = craig_bampton(model, modes=2, frame=None)
    assert record.mass == pytest.approx(mass, rel=1e-12)
    lumped = model.comm.allreduce(lumped_mass(model).sum())
    assert lumped == pytest.approx(3 * mass, rel=1e-12)


def test_lumped_mass_of_facets_of_degree_two():
    """Of bricks 1, 4, 16 of 36 parts; of tetrahedra a third on the middle of each side of a triangle."""
    for cell, shares in (("hexahedron", {1 / 36, 4 / 36, 16 / 36}), ("tetrahedron", {0.0, 1 / 3})):
        mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), cell=cell, comm=MPI.COMM_SELF)
        bodies = [
            ContinuumModel(mesh, solid_linear, PLAIN, degree=2, surfaces=given)
            for given in (None, {"x_max": on_facets(mass=36.0)})
        ]
        added = np.subtract(*(lumped_mass(body).reshape(-1, 3)[:, 0] for body in bodies[::-1])) / 36.0
        assert added.sum() == pytest.approx(1.0)
        there = added[abs(added) > 1e-9]
        if cell == "hexahedron":
            assert set(there.round(9)) == {round(share, 9) for share in shares}
        else:
            # two triangles: the diagonal belongs to both
            assert sorted(there.round(9)) == pytest.approx([1 / 6] * 4 + [1 / 3])


def test_a_machine_stands_on_the_springs_and_swings_on_them():
    """Of a rod under its weight with springs on its end u(L) (E / L + k) = rho g L / 2; eigenvalues as its own."""
    k, g = 3e9, 0.0981  # so light that strain is small to the last digit asked for
    record = craig_bampton(
        rod({"x_max": on_facets(normal=k)}, comm=MPI.COMM_SELF, degree=2), modes=4, frame="x_min"
    )


    def machine(weight):
        scene = fm.System(gravity=(weight, 0.0, 0.0))
        body = scene.add(fm.FlexibleBody(record), name="rod")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
        return scene, body

    # the weight would stiffen it against bending
    found = np.sort(abs(np.array(machine(0.0)[0].linearize().eigenvalues())))[::2]
    np.testing.assert_allclose(found, 2 * np.pi * record.frequencies(["x_min"]), rtol=1e-7)
    scene, body = machine(g)
    end = scene.equilibrium().position(body.frame("x_max"))
    assert end[0] - L == pytest.approx(RHO * g * L / 2 / (E / L + k), rel=1e-6)


def dense(matrix):
    start, columns, values = matrix.getValuesCSR()
    whole = np.zeros(matrix.getSize())
    whole[np.repeat(np.arange(len(whole)), np.diff(start)), columns] = values
    return whole


def test_a_weight_stiffens_a_rod_on_springs_as_the_full_model_says():
    """What the tension adds to the frequencies of bending, on springs that hold one bending direction.

    Against the tangent of the finite-strain solid, all nodes free, at its equilibrium. Membrane strains are those of
    the solid alone: by the whole stiffness as their measure the second frequency would lack a twentieth of its change.
    """
    springs = {name: on_facets(across=1.5e6) for name in ("z_min", "z_max")}
    weight = 600.0
    p = st_venant_kirchhoff.Parameters(E=E, nu=0.0, rho=RHO)
    mesh = meshes.block(*SIZE, divisions=(16, 1, 1), comm=MPI.COMM_SELF)
    full = NonlinearModel(mesh, st_venant_kirchhoff, p, degree=2, surfaces=springs)
    held = prescribed_dofs(full, {"x_min": "xyz"})
    free = np.ix_(*2 * [np.setdiff1d(np.arange(full.n_owned), held)])
    mass, rest = dense(full.mass())[free], np.zeros(full.layout.n_local)

    def lowest():
        return np.sqrt(scipy.linalg.eigh(dense(full.tangent(rest))[free], mass, eigvals_only=True)[:3])

    before = lowest()
    follow(full, [1.0], prescribed=held, loads=[BodyAcceleration((weight, 0.0, 0.0), factor=lambda t: t)])
    change = lowest() - before
    model = ContinuumModel(
        mesh, solid_linear, PLAIN, degree=2, interfaces=[Interface("x_min")], surfaces=springs
    )
    record = craig_bampton(model, modes=8, frame="x_min")
    scene = fm.System(gravity=(weight, 0.0, 0.0))
    body = scene.add(fm.FlexibleBody(record), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    found = np.sort(abs(np.array(scene.linearize(about=scene.equilibrium()).eigenvalues())))[::2][:3]
    assert change[0] > 0.7 * before[0]
    np.testing.assert_allclose(found - before, change, rtol=5e-3)


def test_superelements_carry_what_the_record_carries():
    """With the frame's six dofs held, the other end's stiffness is that of rod and springs."""
    k = 3e9
    record = guyan(rod({"x_max": on_facets(normal=k)}, comm=MPI.COMM_SELF), frame="x_min")
    element = fm.export.superelement(record)
    assert element.K[6, 6] == pytest.approx(E * B * H / L + k * B * H, rel=1e-9)
    assert element.M.shape == element.K.shape


def test_springs_are_not_damped_by_the_material():
    """D of the longitudinal coordinate is tau E A / L where its stiffness is E A / L + k A."""
    k, tau = 5e9, 1e-4
    model = rod({"x_max": on_facets(normal=k)}, comm=MPI.COMM_SELF)
    record = guyan(model, frame="x_min", damping=KelvinVoigtDamping(tau))
    rows = record.interface("x_max").modes
    axial = int(np.argmax(abs(rows[0])))
    share = record.damping[axial, axial] / record.stiffness[axial]
    assert share == pytest.approx(tau * (E / L) / (E / L + k), rel=1e-6)


def test_the_suite_passes_it_and_says_so():
    sheet = check_form(one_element(FORM, "hexahedron", 2), comm=MPI.COMM_SELF)
    assert sheet.passed, sheet.text()
    (line,) = (one for one in sheet.results if one.name == "terms on facets")
    assert line.verdict.value == "PASS"


ENERGY = "p.normal / 2 * along**2 + p.across / 2 * (ufl.inner(u, u) - along**2)"
KINETIC = "p.mass / 2 * ufl.inner(v, v)"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((ENERGY, "p.normal * along"), "surface_energy: must have no linear part, which is that of a load"),
        ((ENERGY, "p.normal * (1 + along**2)"), "surface_energy: must be zero at rest, is 3e"),
        ((ENERGY, "p.normal * along**2 - p.across * ufl.inner(u, u)"), "surface_energy: is not convex at rest"),
        ((ENERGY, "p.normal * ufl.sqrt(along**2)"), "surface_energy: term 0: the first derivative at u = 0 is not fin"),
        ((f"energy = {ENERGY}", f"energy = ({ENERGY}) * ufl.ds"), "surface_energy: .*an integral over facets .ds"),
        ((KINETIC, "p.mass * v[0] ** 2"), "surface_kinetic_energy: must be m/2 v.v .* alike in all directions"),
        ((KINETIC, "-p.mass * ufl.inner(v, v)"), "surface_kinetic_energy: has a mass per area of -100 kg/m"),
        ((KINETIC, "p.mass * v[0]"), "surface_kinetic_energy: must have no linear part"),
        ((KINETIC, "p.mass * ufl.inner(v, v) ** 2"), "surface_kinetic_energy: must be m/2 v.v"),
        (("def surface_energy", "def surface_energie"), "surface_energie is not a name .* did you mean surface_energy"),
    ],
)
def test_what_is_no_term_on_facets_is_refused(tmp_path, change, told):
    assert change[0] in TEXT
    path = tmp_path / "my_form.py"
    path.write_text(TEXT.replace(*change))
    with pytest.raises(FormulationError, match=f"(?s){told}"):
        load_form(path)


def test_the_normal_of_a_facet_is_refused_in_cells(tmp_path):
    path = tmp_path / "my_form.py"
    text = TEXT.replace("from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy\n", "")
    path.write_text(text + "\n\ndef kinetic_energy(v, p):\n    return surface_energy(v, p)\n")
    with pytest.raises(FormulationError, match="kinetic_energy: term 0: the integrand has the normal of a facet"):
        load_form(path)


PAIR = on_facets(normal=1e9, mass=10.0)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("surfaces", "error", "told"),
    [
        ({"x_mux": PAIR}, MeshError, "no facet group 'x_mux'; did you mean 'x_max'\\? Its facet groups are: 'x_max'"),
        ({"x_max": FORM}, FormulationError, "facet group 'x_max' must have a pair"),
        ({"x_max": (solid_linear, PLAIN)}, FormulationError, "it has nothing on facets 'x_max'"),
        ({"x_max": (FORM, PLAIN)}, FormulationError, "takes its own Parameters"),
        ([("x_max", PAIR)], FormulationError, "surfaces must be {"),
        ({"x_max": on_facets(mass=-3.0)}, FormulationError, "on facets 'x_max': .* mass per area of -3 kg/m"),
        ({"x_max": on_facets(mass=float("nan"))}, FormulationError, "on facets 'x_max': .* mass per area of nan"),
        ({"x_max": on_facets(normal=-1.0)}, FormulationError, "with .*normal=-1.0.*surface_energy is not convex"),
        ({"x_max": on_facets(across=float("nan"))}, FormulationError, "surface_energy is not convex"),
    ],
)
def test_wrong_surfaces_are_refused_on_every_rank(surfaces, error, told):
    with pytest.raises(error, match=told):
        rod(surfaces)


@pytest.mark.mpi
def test_a_form_with_terms_on_facets_is_told_where_they_are():
    mesh = meshes.block(*SIZE, divisions=(4, 1, 1), comm=MPI.COMM_WORLD)
    form, p = PAIR
    with pytest.raises(FormulationError, match=r"has surface_energy and surface_kinetic.*no facets are named"):
        ContinuumModel(mesh, form, p, degree=1)
    left_out = ContinuumModel(mesh, form, p, degree=1, surfaces={})
    assert rigid_body_of(left_out).mass == pytest.approx(RHO * SIZE.prod())


@pytest.mark.mpi
def test_mass_that_is_negative_somewhere_is_found_on_the_mesh(tmp_path):
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "my_form.py"))
    if MPI.COMM_WORLD.rank == 0:
        place = "p.mass * (1 - ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(v))[0] / 0.3)"
        Path(path).write_text(TEXT.replace(KINETIC, f"{place} / 2 * ufl.inner(v, v)"))
    MPI.COMM_WORLD.barrier()
    form = load_form(Path(path))
    pair = form, form.Parameters(E=E, nu=0.0, rho=RHO, mass=5.0)
    with pytest.raises(FormulationError, match=r"'z_max': the mass per area .* is negative or not finite on 0.002 m"):
        rod({"z_max": pair})


@pytest.mark.mpi
def test_facets_inside_a_part_are_refused():
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(2, 2, 2), comm=MPI.COMM_WORLD)
    import dolfinx.mesh

    inner = dolfinx.mesh.locate_entities(mesh.mesh, 2, lambda x: np.isclose(x[0], 0.5))
    tags = dolfinx.mesh.meshtags(mesh.mesh, 2, np.sort(inner), np.ones(len(inner), dtype=np.int32))
    mesh = replace(mesh, facet_tags=tags, facet_groups={"middle": 1})
    with pytest.raises(MeshError, match="'middle' has 4 facets inside the part"):
        ContinuumModel(mesh, solid_linear, PLAIN, degree=1, surfaces={"middle": PAIR})


def test_what_has_no_place_for_springs_refuses_them():
    model = rod({"x_max": on_facets(normal=1e9)}, comm=MPI.COMM_SELF)
    loose = rod({"x_max": on_facets(normal=1e9)}, comm=MPI.COMM_SELF, coupling=fm.Coupling.AVERAGED)
    refused = [
        (lambda: craig_bampton(model, modes=2, frame=None), "a frame that floats with the body is no ground"),
        (lambda: craig_bampton(loose, modes=2, frame="x_min"), "on a body with a rigid interface"),
        (lambda: prestressed(model, frame="x_min", loads=[(Pressure("p", "x_max"), 1.0)]), "about rest"),
        (lambda: homogeneous_energy(*PAIR, comm=MPI.COMM_SELF), "terms on facets, which a pseudo-rigid body"),
    ]
    for attempt, told in refused:
        with pytest.raises((ReductionError, FlexmbdError), match=told):
            attempt()
    foam = solid_micropolar.reference().parameters
    mesh = meshes.block(*SIZE, divisions=(2, 1, 1), comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match="elements other than those of the cells"):
        ContinuumModel(mesh, solid_micropolar, foam, degree=1, surfaces={"x_max": PAIR})
