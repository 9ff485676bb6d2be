"""Bodies with history that are heated, slowly and in motion: against closed forms and other bodies."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from von_mises_law import STATE, Metal, von_mises
from von_mises_law import STEEL as METAL

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    ContinuumModel,
    ExplicitContinuum,
    Heating,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    clamped_dofs,
    equilibrium_path,
    follow,
    law_form,
    prescribed_dofs,
)
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.history.history_file import load_body, save_body
from flexmbd.errors import FlexmbdError
from flexmbd.forms import (
    j2_plasticity,
    neo_hookean,
    solid_linear,
    solid_micropolar,
    solid_mixed,
    solid_orthotropic,
    st_venant_kirchhoff,
    updated_lagrangian,
)
from flexmbd.reduction import TemperatureRise, craig_bampton, load_vectors

COMM = MPI.COMM_WORLD
ALPHA, E, YIELD = 1.2e-5, 2e11, 2e8
STEEL = {"E": E, "nu": 0.3, "rho": 7800.0, "alpha": ALPHA}
PLASTIC = j2_plasticity.Parameters(**STEEL, yield_stress=YIELD)
VOCE = j2_plasticity.Parameters(**STEEL, yield_stress=YIELD, hardening=j2_plasticity.VoceHardening(1e8, 50.0))
CARBON = solid_orthotropic.Parameters(
    E1=1.35e11, E2=1.0e10, E3=8.0e9, nu12=0.3, nu13=0.25, nu23=0.4, G12=5.0e9, G13=4.5e9, G23=3.5e9, rho=1600.0,
    axis_1=(2.0, 1.0, 0.5), axis_2=(0.0, 1.0, 0.3), alpha_1=-1e-6, alpha_2=2e-5, alpha_3=3e-5,
)  # fmt: skip
BY_PLANES = {"x_min": "x", "y_min": "y", "z_min": "z"}
ALL = {face: "xyz" for face in ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")}
CORNER = np.array([0.0, -0.05, -0.05])


def block(form, parameters, *, degree=1, cell="hexahedron", comm=COMM, divisions=(3, 2, 2), **options):
    """20 x 10 x 10 cm; the nodes inside are shifted, so that cells are of no simple shape."""
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=divisions, cell=cell, degree=1, comm=comm)
    x = mesh.mesh.geometry.x
    inside = x[:, 0] * (0.2 - x[:, 0]) * (0.0025 - x[:, 1] ** 2) * (0.0025 - x[:, 2] ** 2)
    x += 0.01 * (inside / 6.25e-8)[:, None] * np.array([1.0, -0.7, 0.5])
    return NonlinearModel(mesh, form, parameters, degree=degree, heated=True, **options)


def largest(comm, values):
    return comm.allreduce(float(abs(np.asarray(values)).max(initial=0.0)), op=MPI.MAX)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("form", "parameters", "degree", "cell"),
    [
        (j2_plasticity, PLASTIC, 1, "hexahedron"),  # means over cells
        (j2_plasticity, VOCE, 2, "tetrahedron"),  # equations at the points
        (neo_hookean, neo_hookean.Parameters(**STEEL), 1, "hexahedron"),
        (solid_mixed, solid_mixed.Parameters(**STEEL), 2, "tetrahedron"),
        (solid_mixed, solid_mixed.Parameters(**STEEL), 1, "hexahedron"),  # pressures condensed in their cells
    ],
)
def test_what_is_free_to_expand_is_stretched_and_has_no_stress(form, parameters, degree, cell):
    body = block(form, parameters, degree=degree, cell=cell)
    rise = Heating(lambda x: 100.0 + 0.0 * x[:, 0], lambda t: t)
    follow(body, [0.5, 1.0], prescribed=prescribed_dofs(body, BY_PLANES), loads=[rise])
    wanted = 100.0 * ALPHA * (body.layout.node_x - CORNER)
    off = body.displacement[body.displacement_dofs] - wanted
    assert largest(body.comm, off) < 1e-8 * largest(body.comm, wanted)
    assert max(largest(body.comm, part) for part in body.stress()) < 1e-7 * E * 100.0 * ALPHA


@pytest.mark.mpi
def test_axes_of_their_own_expand_as_they_are():
    """A free orthotropic block is sheared; held in that shape by one face alone it has no stress."""
    body = block(solid_orthotropic, CARBON)
    first, second = np.array(CARBON.axis_1), np.array(CARBON.axis_2)
    axes = np.stack([first, second, np.cross(first, second)])
    strain = 80.0 * np.einsum("k,ki,kj->ij", [CARBON.alpha_1, CARBON.alpha_2, CARBON.alpha_3], axes, axes)
    wanted = np.zeros(body.layout.n_local)
    wanted[body.displacement_dofs] = body.layout.node_x @ strain
    held = prescribed_dofs(body, {"x_min": "xyz"})
    follow(body, [1.0], prescribed=held, displacement=lambda t: wanted[held], loads=[Heating(80.0, lambda t: t)])
    assert largest(body.comm, body.displacement - wanted) < 1e-8 * largest(body.comm, wanted)
    assert max(largest(body.comm, part) for part in body.stress()) < 1e-7 * CARBON.E1 * 80.0 * 3e-5


def test_what_is_held_all_round_is_pressed_by_e_alpha_t_over_one_less_two_nu():
    body = block(j2_plasticity, PLASTIC)
    follow(body, [1.0], prescribed=prescribed_dofs(body, ALL), loads=[Heating(100.0, lambda t: t)])
    pressed = -E * 100.0 * ALPHA / (1.0 - 2.0 * 0.3) * np.eye(3)
    assert body.stress()[0] == pytest.approx(np.broadcast_to(pressed, body.stress()[0].shape), rel=1e-12)


def test_a_bar_between_walls_yields_and_is_pulled_when_it_is_cold_again():
    """Perfectly plastic: what is strained beyond yield on the way up is missing on the way down."""
    body = block(j2_plasticity, PLASTIC)
    held = prescribed_dofs(body, {**BY_PLANES, "x_max": "x"})
    heat = Heating(lambda x: np.full(len(x), 150.0), lambda t: t if t < 1.0 else 2.0 - t)
    follow(body, [0.5, 1.0], prescribed=held, loads=[heat])
    assert body.stress()[0][..., 0, 0] == pytest.approx(-YIELD, rel=1e-9)
    follow(body, [2.0], prescribed=held, loads=[heat], reached=1.0)
    left = E * 150.0 * ALPHA - YIELD  # 160 MPa
    assert body.stress()[0][..., 0, 0] == pytest.approx(left, rel=1e-9)


@pytest.mark.mpi
def test_fields_of_one_cell_are_heated_as_unknowns_of_the_body_are():
    """Unevenly heated, with pressures in their cells and with coupled ones."""
    found = []
    for condense in (True, False):
        body = block(solid_mixed, solid_mixed.Parameters(**STEEL), condense=condense)
        assert (body.fields is not None) == condense
        held = prescribed_dofs(body, {"x_min": "xyz"})
        follow(body, [0.5, 1.0], prescribed=held, loads=[Heating(_warmer, lambda t: t)])
        found.append(body.stress()[0])
    assert largest(COMM, found[0] - found[1]) < 1e-10 * largest(COMM, found[1])


def test_the_tangent_of_a_hot_body_that_yields_is_that_of_its_forces():
    body = block(j2_plasticity, VOCE, comm=MPI.COMM_SELF, divisions=(2, 1, 1))
    body.set_temperature(100.0 + 500.0 * body.temperature.function_space.tabulate_dof_coordinates()[:, 0])
    rng = np.random.default_rng(3)
    at, way = 2e-4 * rng.normal(size=(2, body.layout.n_local))
    matrix, h = body.tangent(at), 1e-4
    slope = (body.force(at + h * way) - body.force(at - h * way)) / (2.0 * h)
    rows = np.arange(body.n_owned, dtype=np.int32)
    assert matrix.getValues(rows, rows) @ way == pytest.approx(slope, abs=1e-6 * abs(slope).max())


def test_a_temperature_is_kept_and_comes_back(tmp_path):
    """The stress of a body that is read from a file is that of a warm one."""
    bodies = [block(j2_plasticity, PLASTIC) for _ in range(2)]
    follow(bodies[0], [1.0], prescribed=prescribed_dofs(bodies[0], ALL), loads=[Heating(50.0, lambda t: t)])
    save_body(bodies[0], tmp_path / "warm.npz", t=1.0)
    assert load_body(bodies[1], tmp_path / "warm.npz") == 1.0
    assert bodies[1].stress()[0] == pytest.approx(bodies[0].stress()[0], rel=1e-14)
    assert abs(bodies[1].stress()[0]).max() > 1e8


def swung(body, *, load=None):
    """A bar whose one end is held: times, and how far the other end has gone along it."""
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    bar = scene.add(body, name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
    if load is not None:
        scene.add_force(fm.force.DistributedLoad(bar, "heat", load))
    return scene, bar


def raised(t):
    """K, a rise within two milliseconds and a fall below it; periods of the bar's own are a fifth of a millisecond."""
    return 60.0 * np.sin(1500.0 * t) ** 2 + 20.0


def test_a_bar_that_is_heated_in_motion_moves_as_a_reduced_one():
    """Beginning hot, so that it jumps: by central differences, by generalized-alpha, and reduced with all its modes."""
    t_end, material = 1e-3, solid_linear.Parameters(E=2e9, nu=0.0, rho=7800.0, alpha=ALPHA)
    plastic = j2_plasticity.Parameters(E=2e9, nu=0.0, rho=7800.0, yield_stress=1e9, alpha=ALPHA)
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(8, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, material, degree=1, interfaces=ends)
    with pytest.warns(fm.LockingWarning):
        record = craig_bampton(model, modes=20, frame="x_min", loads=[TemperatureRise("heat", lambda x: 1.0 + x[:, 0])])
    scene, bar = swung(fm.FlexibleBody(record), load=raised)
    run = scene.simulate(t_end, rtol=1e-6)
    wanted = run.position(bar.frame("x_max"), t=[t_end])[0, 0] - 0.2
    assert wanted > 1e-4
    heat = Heating(lambda x: 1.0 + x[:, 0], raised)
    pressed = solid_mixed.Parameters(E=2e9, nu=0.0, rho=7800.0, alpha=ALPHA)
    explicit = ExplicitContinuum, fm.CentralDifference(), None
    implicit = ImplicitContinuum, fm.GeneralizedAlpha(), 1e-5
    for form, parameters, (kind, method, h), off in (
        (j2_plasticity, plastic, explicit, 3e-2),  # lumped mass: phases off by a hundredth
        (j2_plasticity, plastic, implicit, 1e-2),
        (solid_mixed, pressed, explicit, 3e-2),  # pressures condensed in their cells
        (solid_mixed, pressed, implicit, 1e-2),
    ):
        body = NonlinearModel(mesh, form, parameters, degree=1, interfaces=ends, heated=True)
        scene, bar = swung(fm.ContinuumBody(kind(body, loads=[heat])))
        run = scene.simulate(t_end, integrator=method, h=h)
        assert run.position(bar.frame("x_max"))[-1, 0] - 0.2 == pytest.approx(wanted, rel=off), (kind, form)


@pytest.mark.parametrize("form", [j2_plasticity, solid_micropolar])
@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_a_bar_that_begins_hot_pushes_what_holds_its_ends_from_the_start(kind, form):
    own = {"coupling": 1e8, "length": 0.01, "micro_inertia": 0.0} if form is solid_micropolar else {"yield_stress": 1e9}
    material = form.Parameters(E=2e9, nu=0.0, rho=7800.0, alpha=ALPHA, **own)
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(4, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    body = NonlinearModel(mesh, form, material, degree=2, interfaces=ends, heated=True)
    scene, bar = swung(fm.ContinuumBody(kind(body, loads=[Heating(50.0)])))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(0.2, 0.0, 0.0)), bar.frame("x_max"))
    explicit = kind is ExplicitContinuum
    run = scene.simulate(2e-5, integrator=fm.CentralDifference() if explicit else fm.GeneralizedAlpha())
    for end, way in (("x_min", -1.0), ("x_max", 1.0)):
        push = run.interior_wrench(bar, end)[0]
        assert push == pytest.approx([way * 2e9 * 0.01 * ALPHA * 50.0, 0.0, 0.0, 0.0, 0.0, 0.0], rel=1e-9, abs=1e-4)


@pytest.mark.parametrize("form", [solid_mixed, solid_micropolar])
def test_a_bar_with_fields_without_mass_is_heated_in_motion(form):
    """Pressures that couple cells, and micro-rotations, as by the reduced body."""
    own = {} if form is solid_mixed else {"coupling": 1e8, "length": 0.01, "micro_inertia": 0.0}
    material = form.Parameters(E=2e9, nu=0.0, rho=7800.0, alpha=ALPHA, **own)
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(4, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    options = {"degree": 2, "interfaces": [Interface("x_min"), Interface("x_max")]}
    load = TemperatureRise("heat", lambda x: 1.0 + x[:, 0])
    record = craig_bampton(ContinuumModel(mesh, form, material, **options), modes=40, frame="x_min", loads=[load])
    scene, bar = swung(fm.FlexibleBody(record), load=raised)
    wanted = scene.simulate(1e-3, rtol=1e-6).position(bar.frame("x_max"), t=[1e-3])[0, 0] - 0.2
    heat = Heating(lambda x: 1.0 + x[:, 0], raised)
    for kind, method, h in (
        (ExplicitContinuum, fm.CentralDifference(), None),
        (ImplicitContinuum, fm.GeneralizedAlpha(), 1e-5),
    ):
        body = NonlinearModel(mesh, form, material, heated=True, **options)
        scene, bar = swung(fm.ContinuumBody(kind(body, loads=[heat])))
        run = scene.simulate(1e-3, integrator=method, h=h)
        assert run.position(bar.frame("x_max"))[-1, 0] - 0.2 == pytest.approx(wanted, rel=3e-2), kind


@pytest.mark.mpi
def test_a_temperature_that_strains_nothing_is_refused():
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(2, 1, 1), cell="hexahedron", degree=1)
    cold = updated_lagrangian.Parameters(E=E, nu=0.3, rho=7800.0, yield_stress=YIELD)
    with pytest.raises(FlexmbdError, match=r"without expansion: .*updated_lagrangian does not say how it expands"):
        NonlinearModel(mesh, updated_lagrangian, cold, degree=1, heated=True)
    none = neo_hookean.Parameters(E=E, nu=0.3, rho=7800.0)
    with pytest.raises(FlexmbdError, match=r"without expansion: the coefficients of .*neo_hookean are zero"):
        NonlinearModel(mesh, neo_hookean, none, degree=1, heated=True)
    law = law_form(von_mises, Metal, trial=METAL, state=STATE)
    vars(law)["thermal_strain"] = lambda p, dT: ALPHA * dT * ufl.Identity(3)
    with pytest.raises(FlexmbdError, match=r"a compiled law \(point_law\) is given the whole strain"):
        NonlinearModel(mesh, law, METAL, degree=1, heated=True)
    body = NonlinearModel(mesh, j2_plasticity, PLASTIC, degree=1)
    held = prescribed_dofs(body, BY_PLANES)
    with pytest.raises(FlexmbdError, match=r"'heating': the body was compiled without a temperature.*heated=True"):
        follow(body, [1.0], prescribed=held, loads=[Heating(1.0)])


@pytest.mark.mpi
def test_rises_that_are_none_are_refused():
    body = block(j2_plasticity, PLASTIC)
    held = prescribed_dofs(body, BY_PLANES)
    for rise, told in (
        (lambda x: x, r"finite number \(K\) for each of the points"),
        (lambda x: np.log(-1.0 - abs(x[:, 0])), "not finite"),
        (np.ones(3), "nodes, got 3 values"),
    ):
        with pytest.raises(FlexmbdError, match=told), np.errstate(invalid="ignore"):
            follow(body, [1.0], prescribed=held, loads=[Heating(rise)])
    for rise in ("warm", float("nan"), np.ones((2, 2)), None):
        with pytest.raises(FlexmbdError, match="a rise of temperature is"):
            Heating(rise)
    for values in ("warm", np.nan, np.ones(2), None):
        with pytest.raises(FlexmbdError, match="a temperature is one finite number"):
            body.set_temperature(values)
    with pytest.raises(FlexmbdError, match="loads do not change"):
        equilibrium_path(body, fm.Continuation(to=1.0), prescribed=held, loads=[Heating(1.0)])


@pytest.mark.mpi
def test_a_clamped_strip_that_is_heated_buckles_and_bends_by_the_root_of_what_is_beyond():
    """Euler's strain (2 pi / L)^2 i^2 of the clamped strip; beyond it the length of the half waves is what is left."""
    length, thick = 0.2, 0.002
    mesh = meshes.block(length, 0.004, thick, divisions=(32, 1, 1))
    material = st_venant_kirchhoff.Parameters(E=E, nu=0.0, rho=7800.0, alpha=ALPHA)
    body = NonlinearModel(mesh, st_venant_kirchhoff, material, degree=2, heated=True)
    held = np.union1d(
        clamped_dofs(body, ["x_min", "x_max"]), prescribed_dofs(body, {"y_min": "y", "y_max": "y"})
    ).astype(np.int32)
    critical = (2.0 * np.pi / length) ** 2 * thick**2 / 12.0 / ALPHA
    loads = [Heating(critical, lambda t: t)]
    path = equilibrium_path(body, fm.Continuation(to=1.2), prescribed=held, loads=loads)
    (met,) = [one for one in path.critical if one.t < 1.1]
    assert met.t == pytest.approx(1.0, rel=2e-3)
    bent = equilibrium_path(body, fm.Continuation(to=1.5), prescribed=held, loads=loads, about=met)
    sag = largest(body.comm, body.displacement[body.displacement_dofs[:, 2]])
    wave = 2.0 * length / np.pi * np.sqrt(ALPHA * critical * (1.5 - met.t))
    assert sag == pytest.approx(wave, rel=0.01)
    assert bent.points[-1].unstable == 0
    assert body.temperature.x.array == pytest.approx(1.5 * critical, rel=1e-12)


def _warmer(x):
    return 40.0 + 100.0 * x[:, 0]


@pytest.mark.mpi
def test_values_at_nodes_are_those_of_the_function():
    """By the mesh's input, whatever the ranks have of it; of a displacement with more nodes than the mesh."""
    found = []
    for given in (True, False):
        body = block(neo_hookean, neo_hookean.Parameters(**STEEL), degree=2)
        geometry = body.mesh.mesh.geometry
        values = np.zeros(geometry.index_map().size_global)
        values[geometry.input_global_indices] = 40.0 + 100.0 * geometry.x[:, 0]
        body.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
        rise = Heating(values if given else _warmer, lambda t: t)
        follow(body, [1.0], prescribed=prescribed_dofs(body, BY_PLANES), loads=[rise])
        found.append(body.displacement.copy())
    assert largest(COMM, found[0] - found[1]) < 1e-9 * largest(COMM, found[1])


@pytest.mark.mpi
def test_plane_strain_that_is_heated_is_a_slice_of_what_cannot_lengthen():
    """Free in the plane it widens by (1 + nu) alpha dT, and is pressed along the normal by E alpha dT."""
    mesh = meshes.sheet(0.2, 0.1, divisions=(4, 2))
    slab = forms.plane_stress.Parameters(E=E, nu=0.3, rho=7800.0, t=0.01, plane_strain=True, alpha=ALPHA)
    model = ContinuumModel(mesh, forms.plane_stress, slab, degree=2, interfaces=[Interface("x_min")])
    force = load_vectors(model, [TemperatureRise("heat", 80.0)])[:, 0]
    x = model.node_x[: model.n_owned_nodes]
    free, held = model.K.createVecs()
    free.array[model.displacement_dofs[: model.n_owned_nodes]] = 1.3 * ALPHA * 80.0 * x
    model.K.mult(free, held)
    assert largest(COMM, held.array - force) < 1e-9 * largest(COMM, force)
    # the same expansion slowly, and the stress that is left
    body = NonlinearModel(mesh, forms.plane_stress, slab, degree=2, heated=True)
    still = np.setdiff1d(np.arange(body.n_owned), body.displacement_dofs[: body.layout.n_owned_nodes, :2].ravel())
    held = np.union1d(still, prescribed_dofs(body, {"x_min": "x", "y_min": "y"})).astype(np.int32)
    follow(body, [1.0], prescribed=held, loads=[Heating(80.0, lambda t: t)])
    stress = np.concatenate([part.reshape(-1, 9) for part in body.stress()])
    wanted = np.zeros(9)
    wanted[8] = -E * ALPHA * 80.0
    assert largest(COMM, stress - wanted) < 5e-3 * E * ALPHA * 80.0
    assert stress[:, 8] == pytest.approx(wanted[8], rel=5e-3)


def test_forms_say_how_they_expand_in_one_way():
    """Each shipped form with an expansion is at rest at dT = 0, and is checked by the contract."""
    for name in ("solid_linear", "solid_orthotropic", "plane_stress", "neo_hookean", "j2_plasticity", "plate_mitc"):
        form = getattr(forms, name)
        named = optional_entries(form)
        assert (named.thermal_stretch is None) != (named.thermal_strain is None), name
