"""Temperatures of reduced bodies: expansion, held stress, buckling, hot states; against closed forms."""

import dataclasses

from mpi4py import MPI

import dolfinx.mesh
import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    ContinuumModel,
    Heating,
    Interface,
    NonlinearModel,
    SymmetryPlane,
    clamped_dofs,
    follow,
)
from flexmbd.continuum.finite_elements.held_expansion import held_expansion
from flexmbd.coupling import Coupling
from flexmbd.errors import ConvergenceError, FlexmbdError
from flexmbd.forms import (
    plate_mitc,
    solid_enhanced,
    solid_linear,
    solid_micropolar,
    solid_mixed,
    solid_orthotropic,
)
from flexmbd.reduction import (
    Keep,
    ModalDerivatives,
    Pressure,
    TemperatureRise,
    craig_bampton,
    guyan,
    linear_buckling,
    load_vectors,
    prestressed,
)
from flexmbd.reduction.unit_loads import rise_of

COMM = MPI.COMM_WORLD
ALPHA, E = 1.2e-5, 2e11
STEEL = solid_linear.Parameters(E=E, nu=0.3, rho=7800.0, alpha=ALPHA)
LOOSE = solid_linear.Parameters(E=E, nu=0.0, rho=7800.0, alpha=ALPHA)
#: m, of a column and its section; K at which it buckles clamped at both ends: 4 pi^2 I / (A L^2 alpha).
LENGTH, WIDTH, HEIGHT = 1.0, 0.02, 0.01
CRITICAL = 4.0 * np.pi**2 * HEIGHT**2 / 12.0 / (LENGTH**2 * ALPHA)


def column(*, half=False, parameters=LOOSE, comm=COMM, n=16):
    """A column between two clamps, or half of it, up to the plane of symmetry."""
    length, count = (LENGTH / 2, n // 2) if half else (LENGTH, n)
    mesh = meshes.block(length, WIDTH, HEIGHT, divisions=(count, 1, 1), comm=comm)
    ends = [Interface("x_min")] if half else [Interface("x_min"), Interface("x_max")]
    supports = [SymmetryPlane("x_max", (1.0, 0.0, 0.0))] if half else []
    return ContinuumModel(mesh, solid_linear, parameters, degree=2, interfaces=ends, supports=supports)


def between_walls(record, factor):
    """A scene with a body held at both ends, and a temperature."""
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    bar = scene.add(fm.FlexibleBody(record), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(LENGTH, 0.0, 0.0)), bar.frame("x_max"))
    scene.add_force(fm.force.DistributedLoad(bar, "heat", factor))
    return scene, bar


@pytest.mark.mpi
def test_a_load_of_a_temperature_expands_the_body_and_no_more():
    """K times the displacement of free expansion; with pressures, with rotations, along axes of a material's own."""
    carbon = solid_orthotropic.reference().parameters
    fibre = {one: getattr(carbon, one) for one in carbon.__dataclass_fields__} | {"alpha_1": -1e-6, "alpha_2": 3e-5}
    rubber = {"E": 2e6, "nu": 0.499, "rho": 1100.0, "alpha": 2e-4}
    own = np.stack([carbon.axis_1, carbon.axis_2, np.cross(carbon.axis_1, carbon.axis_2)])
    cases = (
        (solid_linear, STEEL, "hexahedron", 2, ALPHA * np.eye(3)),
        (solid_mixed, solid_mixed.Parameters(**rubber), "tetrahedron", 2, 2e-4 * np.eye(3)),
        (solid_micropolar, solid_micropolar.Parameters(**rubber, coupling=1e5, length=0.01, micro_inertia=1e-5),
         "hexahedron", 1, 2e-4 * np.eye(3)),
        (solid_orthotropic, solid_orthotropic.Parameters(**fibre), "tetrahedron", 2,
         own.T @ np.diag([-1e-6, 3e-5, 0.0]) @ own),
    )  # fmt: skip
    for form, parameters, cell, degree, strain in cases:
        mesh = meshes.block(0.3, 0.02, 0.01, divisions=(4, 1, 1), cell=cell)
        model = ContinuumModel(mesh, form, parameters, degree=degree)
        load = TemperatureRise("heat", 80.0)
        force = load_vectors(model, [load])[:, 0]
        free, held = model.K.createVecs()
        # pressures of the free body are zero: what the displacement brings is minus what the temperature does
        pressed = held_expansion(model).fields(rise_of(model, load))
        if pressed is not None:
            free.array[:] = -pressed[: model.n_owned]
        free.array[model.displacement_dofs[: model.n_owned_nodes]] = (
            80.0 * model.node_x[: model.n_owned_nodes] @ strain
        )
        model.K.mult(free, held)
        sizes = [model.comm.allreduce(float(abs(part).max()), op=MPI.MAX) for part in (held.array - force, force)]
        assert sizes[0] < 1e-10 * sizes[1], form.__name__


@pytest.mark.mpi
def test_a_bimetal_strip_bends_as_timoshenko_says():
    """Two layers of unlike stiffness and height, without lateral contraction."""
    length, low, high, rise = 0.2, 0.003, 0.002, 60.0
    mesh = meshes.block(length, 0.01, low + high, divisions=(8, 1, 5), comm=COMM)
    cells = mesh.mesh.topology.index_map(3)
    every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    heights = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, every)[:, 2]
    tags = dolfinx.mesh.meshtags(mesh.mesh, 3, every, np.where(heights < 0.5 * (low - high), 1, 2).astype(np.int32))
    mesh = dataclasses.replace(mesh, cell_tags=tags, cell_groups={"below": 1, "above": 2})
    below, above = ({"E": e, "nu": 0.0, "rho": 7800.0, "alpha": a} for e, a in ((1e11, 2.4e-5), (2e11, 1e-6)))
    pairs = {"below": (solid_linear, solid_linear.Parameters(**below)),
             "above": (solid_linear, solid_linear.Parameters(**above))}  # fmt: skip
    ends = [Interface("x_min", coupling=Coupling.AVERAGED), Interface("x_max", coupling=Coupling.AVERAGED)]
    model = ContinuumModel(mesh, pairs, degree=2, interfaces=ends)
    body = guyan(model, frame="x_min", loads=[TemperatureRise("heat", rise)])
    q = body.loads.modal[0] / body.stiffness
    turned = body.interface("x_max").modes[4] @ q
    m, n = low / high, below["E"] / above["E"]
    curvature = 6.0 * (below["alpha"] - above["alpha"]) * rise * (1.0 + m) ** 2
    curvature /= (low + high) * (3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n)))
    # the side below lengthens more, and the far face turns up, against y; at the ends sections do not stay plane
    assert turned == pytest.approx(-curvature * length, rel=3e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("options", [{}, {"residual_vectors": True}, {"geometric_stiffness": False}])
def test_what_expands_freely_has_no_stress_and_what_is_held_has_its_own(options):
    """The stress of the modes less that of the expansion; that alone where nothing moves."""
    mesh = meshes.block(0.2, 0.1, 0.1, divisions=(3, 2, 2), cell="tetrahedron", comm=COMM)
    ends = [Interface("x_min", coupling=Coupling.AVERAGED)]
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ends)
    more = TemperatureRise("more", lambda x: 1.0 + 0.0 * x[:, 0])
    loads = [TemperatureRise("heat", 50.0), Pressure("p", "x_max"), more]
    body = craig_bampton(model, modes=1, frame="x_min", loads=loads, keep=Keep(modes=True), **options)
    assert body.heat.names == ("heat", "more")
    assert abs(body.loads.force[[0, 2]]).max() < 1e-9 * E * 50.0 * ALPHA * 0.01
    free = body.loads.modal[0] / body.stiffness
    held = -E * 50.0 * ALPHA / (1.0 - 2.0 * 0.3) * np.eye(3)
    field = model.stress_field(body, free, heat={"heat": 1.0})
    assert field.displacement[:, 0].max() == pytest.approx(0.2 * 50.0 * ALPHA, rel=1e-6)
    assert abs(field.stress).max() < 1e-6 * abs(held).max()
    field = model.stress_field(body, 0.0 * free, heat={"heat": 0.5, "more": 25.0})
    assert field.stress == pytest.approx(np.broadcast_to(held, field.stress.shape), rel=1e-9)
    assert abs(model.stress_field(body, 0.0 * free).stress).max() == 0.0
    with pytest.raises(FlexmbdError, match=r"heat gives finite factors .* got 'p': 1.0; it has: 'heat', 'more'"):
        model.stress_field(body, free, heat={"p": 1.0})


def test_a_record_keeps_its_temperatures(tmp_path):
    model = column(comm=MPI.COMM_SELF, n=4)
    body = craig_bampton(model, modes=2, frame="x_min", loads=[TemperatureRise("heat", lambda x: 1.0 + x[:, 0])])
    body.save(tmp_path / "bar.h5")
    read = fm.ReducedBody.load(tmp_path / "bar.h5")
    assert np.array_equal(read.heat.rise, body.heat.rise)
    assert (read.heat.rise.min(), read.heat.rise.max()) == pytest.approx((1.0, 2.0))
    assert "1 temperature at" in read.inspect()
    cold = craig_bampton(model, modes=2, frame="x_min")
    assert cold.heat is None
    assert "heat" not in cold.tree()


@pytest.mark.mpi
def test_a_column_between_clamps_buckles_as_it_is_heated():
    """Euler's load over E A alpha, shear and the ends' lateral hold apart: linear, and by its hot states."""
    model = column(half=True, n=24)
    found = linear_buckling(model, clamped=["x_min"], loads=[(TemperatureRise("heat", CRITICAL), 1.0)])
    assert found.factors[0] == pytest.approx(1.0, rel=6e-3)
    critical = float(found.factors[0])
    cold = craig_bampton(model, modes=2, frame="x_min").frequencies(["x_min"])[0]
    heat = TemperatureRise("heat", CRITICAL)
    squares = []
    for part in (0.5, 0.9):
        hot = prestressed(model, frame="x_min", loads=[(heat, part * critical)])
        body = craig_bampton(hot, modes=2, frame="x_min", keep=Keep(modes=True))
        squares.append((body.frequencies(["x_min"])[0] / cold) ** 2)
        middle = hot.stress_field(body, np.zeros(body.n_modes)).stress[:, 0, 0]
        assert np.median(middle) == pytest.approx(-E * ALPHA * part * critical * CRITICAL, rel=2e-3)
    # of a beam the square falls almost along a line
    assert squares == pytest.approx([0.5, 0.1], abs=0.02)
    with pytest.raises(ConvergenceError, match="the body buckles"):
        prestressed(model, frame="x_min", loads=[(heat, 1.03 * critical)])


def test_a_heated_body_of_a_machine_buckles_between_walls():
    """Its lowest eigenvalue falls to zero at the factor of linear buckling, though nothing moves before."""
    model = column(comm=MPI.COMM_SELF)
    load = TemperatureRise("heat", CRITICAL)
    critical = float(linear_buckling(model, clamped=["x_min", "x_max"], loads=[(load, 1.0)]).factors[0])
    record = craig_bampton(model, modes=10, frame="x_min", loads=[load])

    def lowest(factor):
        scene, _ = between_walls(record, factor)
        return min(-(np.asarray(scene.linearize(about=scene.equilibrium()).eigenvalues()) ** 2).real)

    cold = lowest(0.0)
    assert lowest(0.5 * critical) / cold == pytest.approx(0.5, abs=0.01)
    assert lowest(0.98 * critical) > 0.0
    with pytest.warns(fm.EquilibriumWarning, match="one motion grows"):
        assert lowest(1.02 * critical) < 0.0


def test_stress_in_a_machine_follows_the_temperature():
    """Between walls -E alpha T, by a function of time; without walls none."""
    model = column(comm=MPI.COMM_SELF, n=4)
    record = craig_bampton(model, modes=2, frame="x_min", loads=[TemperatureRise("heat", 10.0)], keep=Keep(modes=True))
    scene, bar = between_walls(record, fm.Sine(1.0, 500.0))
    run = scene.simulate(1e-3, rtol=1e-4)
    for t in (0.0, 1e-3):
        middle = np.median(run.stress(bar, model, t=t).stress[:, 0, 0])
        assert middle == pytest.approx(-E * ALPHA * 10.0 * np.sin(500.0 * t), rel=1e-3, abs=1.0)


def test_a_plate_that_is_clamped_all_round_buckles_as_it_is_heated():
    """Under equal forces N along both sides at 5.30 pi^2 D / a^2 (Timoshenko & Gere 1961, section 9.11)."""
    t, a = 0.01, 1.0
    mesh = meshes.sheet(a, a, divisions=(20, 20), comm=MPI.COMM_SELF)
    border = mesh.facet_tags
    ones = dolfinx.mesh.meshtags(mesh.mesh, 1, border.indices, np.ones_like(border.values))
    mesh = dataclasses.replace(mesh, facet_tags=ones, facet_groups={"border": 1})
    metal = plate_mitc.Parameters(E=7e10, nu=0.3, rho=2700.0, t=t, alpha=2.4e-5)
    model = ContinuumModel(mesh, plate_mitc, metal, degree=1, interfaces=[Interface("border")])
    found = linear_buckling(model, clamped=["border"], loads=[(TemperatureRise("heat", 1.0), 1.0)])
    # N = E t alpha dT / (1 - nu), D = E t^3 / (12 (1 - nu^2))
    assert found.factors[0] == pytest.approx(5.30 * np.pi**2 * t**2 / (12.0 * 1.3 * a**2 * 2.4e-5), rel=1e-2)


@pytest.mark.mpi
def test_fields_of_one_cell_are_prestressed_by_a_temperature():
    """Pressures condensed in their cells, and coupled, of a bar that is held and hot at one end."""
    mesh = meshes.block(0.3, 0.02, 0.01, divisions=(4, 1, 1))
    pressures = solid_mixed.Parameters(E=E, nu=0.3, rho=7800.0, alpha=ALPHA)
    load = TemperatureRise("heat", lambda x: x[:, 0])
    found = []
    for condense in (True, False):
        one = {"degree": 1, "condense": condense, "interfaces": [Interface("x_min")]}
        hot = prestressed(ContinuumModel(mesh, solid_mixed, pressures, **one), frame="x_min", loads=[(load, 100.0)])
        body = craig_bampton(hot, modes=1, frame="x_min", keep=Keep(modes=True))
        found.append(hot.stress_field(body, np.zeros(body.n_modes)).stress)
    assert abs(found[0]).max() > 1e6
    assert found[0] == pytest.approx(found[1], abs=1e-9 * abs(found[0]).max())


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("form", "degree"), [(solid_mixed, 1), (solid_enhanced, 1), (solid_mixed, 2)]
)
def test_fields_beside_the_displacement_have_the_temperature(form, degree):
    """Condensed in their cells, as unknowns of the body, and by slow loading: unevenly heated between two clamps."""
    mesh = meshes.block(0.3, 0.02, 0.01, divisions=(6, 2, 1))
    material = form.Parameters(E=E, nu=0.3, rho=7800.0, alpha=ALPHA)
    ends = [Interface("x_min"), Interface("x_max")]

    def warm(x):
        return 0.01 * (20.0 + 300.0 * x[:, 0] + 4000.0 * x[:, 2])

    body = NonlinearModel(mesh, form, material, degree=degree, interfaces=ends, heated=True)
    loads = [Heating(warm, lambda t: t)]
    follow(body, [1.0], prescribed=clamped_dofs(body, ["x_min", "x_max"]), loads=loads)
    sag = np.max(COMM.allgather(abs(body.displacement[body.displacement_dofs]).max(axis=0)), axis=0)
    found = []
    for condense in (True, False)[: 3 - degree]:
        model = ContinuumModel(mesh, form, material, degree=degree, interfaces=ends, condense=condense)
        assert (model.condensed is not None) == (condense and degree == 1)
        load = TemperatureRise("heat", warm)
        record = craig_bampton(model, modes=2, frame="x_min", loads=[load], keep=Keep(modes=True))
        # the least energy of the modes that leave both frames where they are
        soft = record.stiffness**-0.5
        kernel = np.linalg.svd(record.interface("x_max").modes * soft)[2][6:].T
        q = soft * (kernel @ (kernel.T @ (soft * record.loads.modal[0])))
        field, still = (model.stress_field(record, part * q, heat={"heat": 1.0}) for part in (1.0, 0.0))
        assert abs(field.displacement).max(axis=0) == pytest.approx(sag, rel=2e-3)
        place = record.geometric.loads.index("load heat")
        found.append((field.stress, still.stress, record.geometric.K[place]))
    if degree == 2:  # the pressure is of the same functions as this temperature
        held = -E * ALPHA / (1.0 - 2.0 * 0.3) * warm(still.x @ record.R_MB.T + record.p_MB_M)
        assert still.stress[:, 0, 0] == pytest.approx(held, abs=1e-6 * abs(held).max())
    for condensed, coupled in zip(found[0], found[-1], strict=True):
        assert condensed == pytest.approx(coupled, abs=1e-8 * abs(coupled).max())


def test_no_rise_of_temperature_lacks_no_energy():
    record = craig_bampton(column(n=4), modes=1, frame="x_min", loads=[TemperatureRise("heat", 0.0)])
    assert record.provenance["load heat"].endswith("static energy missing 0.0e+00")


@pytest.mark.mpi
def test_temperatures_that_would_be_left_out_are_refused():
    model, load = column(n=4), TemperatureRise("heat", 10.0)
    reduce = {"modes": 1, "frame": "x_min", "loads": [load]}
    with pytest.raises(FlexmbdError, match=r"'heat': stress modes do not hold"):
        craig_bampton(model, **reduce, keep=Keep(stress=True))
    with pytest.raises(FlexmbdError, match=r"'heat': the strain energy of large displacements"):
        craig_bampton(model, **reduce, nonlinear=ModalDerivatives({"x_max.z": 1.0}))
    with pytest.raises(FlexmbdError, match=r"'heat': a body is heated about rest alone"):
        craig_bampton(prestressed(model, frame="x_min", forces={"x_max": (10.0, 0, 0, 0, 0, 0)}), **reduce)
    cold = column(n=4, parameters=solid_linear.Parameters(E=E, nu=0.3, rho=7800.0))
    with pytest.raises(FlexmbdError, match=r"'heat': a temperature without expansion: the .*solid_linear are zero"):
        craig_bampton(cold, **reduce)
    mesh = meshes.block(0.3, 0.02, 0.01, divisions=(4, 1, 1))
    pressures = solid_mixed.Parameters(E=E, nu=0.3, rho=7800.0, alpha=ALPHA)
    rigid = dataclasses.replace(pressures, nu=0.5)
    incompressible = ContinuumModel(mesh, solid_mixed, rigid, degree=2, interfaces=[Interface("x_min")])
    with pytest.raises(FlexmbdError, match=r"solid_mixed: what keeps its volume .* no finite pressure.* below 1/2"):
        craig_bampton(incompressible, **reduce)
    mesh = meshes.line(1.0, divisions=4, comm=COMM)
    section = forms.beam_timoshenko.Parameters.rectangle(E, 0.3, 7800.0, width=0.1, height=0.1, orientation=(0, 1, 0))
    beam = ContinuumModel(mesh, forms.beam_timoshenko, section, degree=2, interfaces=[Interface("start")])
    with pytest.raises(FlexmbdError, match=r"without expansion: .*beam_timoshenko does not say how it expands"):
        craig_bampton(beam, modes=1, frame="start", loads=[load])
    with pytest.raises(FlexmbdError, match="finite number"):
        craig_bampton(model, modes=1, frame="x_min", loads=[TemperatureRise("heat", lambda x: x * np.nan)])
