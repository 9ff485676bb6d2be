"""Unknowns without mass beside the displacement in bodies that move: a pressure, a potential, a damage."""

import functools
import itertools
import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    BulkViscosity,
    ContinuumModel,
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    RegularCheckpoints,
    clamped_dofs,
    follow,
    load_form,
)
from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import FormulationError, InterfaceError
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.reduction import craig_bampton

DATA = Path(__file__).parents[1] / "data"
MIXED, MICROPOLAR = forms.solid_mixed, forms.solid_micropolar
ENDS = (Interface("x_min"), Interface("x_max"))
H = 2e-3

# A bar in the middle of which a cell is damaged before: broken there, it takes Gc on its section.
LENGTH, SIDE, CELLS = 0.2, 0.01, 31
SIZE = LENGTH / CELLS
E, RHO, GC, WIDTH = 1e9, 1000.0, 100.0, 3.0 * SIZE
SPEED = np.sqrt(E / RHO)
STRENGTH = 9 / 16 * np.sqrt(E * GC / (3 * WIDTH))  # of a long sound bar: the largest stress of a uniform damage


STEPS = [(ImplicitContinuum, fm.GeneralizedAlpha()), (ExplicitContinuum, fm.CentralDifference())]


@functools.cache
def brittle():
    return load_form(DATA / "brittle_solid.py")


@functools.cache
def piezo():
    return load_form(DATA / "piezoelectric.py")


def bar(*, nu=0.0, damaged=10.0, cells=CELLS, length=LENGTH, width=WIDTH, comm=MPI.COMM_SELF, interfaces=ENDS):
    mesh = meshes.block(length, SIDE, SIDE, divisions=(cells, 1, 1), comm=comm)
    p = brittle().Parameters(E=E, nu=nu, rho=RHO, Gc=GC, length=width, residual=1e-5)
    body = NonlinearModel(mesh, brittle(), p, degree=1, interfaces=list(interfaces))
    if damaged:
        start, x = body.snapshot(), mesh.mesh.geometry.x[cell_nodes(mesh.mesh)].mean(axis=1)[:, 0]
        start.history[0].reshape(len(x), -1)[abs(x - length / 2) < 0.4 * SIZE] = damaged * GC / width
        body.restore(start)
    return body


def pulled(interior, way, t_end, **how):
    """The far end of a bar goes by a function of time, m, given with two derivatives; the other stands."""
    scene = fm.System()
    rod = scene.add(fm.ContinuumBody(interior), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), rod.frame("x_max"))
    slide.prescribe(lambda t: (LENGTH + way(t)[0], *way(t)[1:]))
    return scene.simulate(t_end, **how), rod, slide


def damage(body):
    return body.displacement[body.layout.further_dofs]


def apart(distance, t_end):
    return lambda t: (distance * (t / t_end) ** 2, 2 * distance * t / t_end**2, 2 * distance / t_end**2)


@pytest.mark.parametrize("steps", STEPS)
def test_a_bar_that_breaks_in_motion_takes_the_work_of_fracture(steps):
    """Gc on the section, by linear cells that are a third of the length as wide 1 + h / (2 length) times as much."""
    kind, integrator = steps
    body = bar()
    interior = kind(body)
    t_end = 30 * LENGTH / SPEED
    way = apart(4 * STRENGTH / E * LENGTH, t_end)
    run, rod, _ = pulled(interior, way, t_end, integrator=integrator, rtol=1e-3)
    parts = run.energies(rod)
    assert damage(body).max() > 0.95
    assert parts["fracture"][-1] == pytest.approx(GC * SIDE**2 * (1 + SIZE / (2 * WIDTH)), rel=0.05)
    if kind is ExplicitContinuum:
        fields = interior.motion.mesh.fields
        assert abs(parts["splitting"]).max() < 1e-6 * parts["fracture"][-1]
        assert fields.factorisations < 0.1 * len(run.t)


@pytest.mark.parametrize("steps", STEPS)
def test_a_bar_that_breaks_while_it_swings(steps):
    """A ball on a weak bar that turns: the bar breaks as by a pull, and the ball goes on straight."""
    kind, integrator = steps
    body, mass = bar(), 1.0
    rod = fm.ContinuumBody(kind(body, rigid_parts={"x_max": fm.RigidBody(mass, (1e-3, 1e-3, 1e-3))}))
    scene = fm.System()
    scene.add(rod, name="rod")
    hinge = scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(), rod.frame("x_min"))
    hinge.velocity = np.sqrt(STRENGTH * SIDE**2 / (mass * LENGTH))
    t_end = 2 * np.pi * np.sqrt(mass * LENGTH / (E * SIDE**2))  # of the ball on the bar as a spring
    run = scene.simulate(t_end, integrator=integrator, rtol=1e-3)
    work = run.energies(rod)["fracture"][-1]
    assert work == pytest.approx(GC * SIDE**2 * (1 + SIZE / (2 * WIDTH)), rel=0.05)
    v = run.velocity(rod.frame("x_max"))
    flying = v[len(v) * 2 // 3 :]
    assert abs(flying - flying[0]).max() < 2e-3 * hinge.velocity * LENGTH
    turned = np.arctan2(-v[-1, 0], v[-1, 1])
    assert 0.0 < turned < 0.1 * hinge.velocity * t_end
    # the account closes: of a millijoule, in eight joules of the ball, with the steps' own error
    total = run.energy().kinetic + sum(run.energies(rod).values())
    assert np.ptp(total[1:]) < 0.1 * work


def slowly_broken(body):
    held = clamped_dofs(body, ("x_min", "x_max"))
    way = np.zeros(body.layout.n_local)
    way[body.displacement_dofs[body.layout.nodes_on(2, body.mesh.facets("x_max")), 0]] = STRENGTH / E * LENGTH
    times = [*np.linspace(0.02, 3.0, 100), 5.0, 8.0]
    follow(body, times, prescribed=held, displacement=lambda t: t * way[held])
    return body.energies()["fracture"]


def test_a_bar_that_breaks_slowly_takes_the_work_of_fracture():
    """One so short that it breaks little by little, and does not snap."""
    work = slowly_broken(bar(cells=15, length=15 * SIZE, damaged=30.0))
    assert work == pytest.approx(GC * SIDE**2 * (1 + SIZE / (2 * WIDTH)), rel=0.05)


def test_a_band_that_the_cells_do_not_resolve_is_told():
    """By how much too much work it takes: h / (2 length)."""
    with pytest.warns(fm.ResolutionWarning, match="a damage falls by") as told:
        work = slowly_broken(bar(width=SIZE, damaged=30.0))
    assert len(told) == 1
    percent = float(re.search(r"some (\d+) %", str(told[0].message)).group(1))
    assert work == pytest.approx(GC * SIDE**2 * (1 + percent / 100.0), rel=0.05)
    assert percent == pytest.approx(50.0, abs=5.0)


def stretched_twice(t, most, t_end):
    rate = 4 * np.pi / t_end
    phase = rate * t
    return most * (1 - np.cos(phase)) / 2, most * rate * np.sin(phase) / 2, most * rate**2 * np.cos(phase) / 2


def test_what_is_broken_does_not_heal():
    """A bar that is stretched and let back, twice: its damage and the largest energy that it has seen stay."""
    t_end = 16 * LENGTH / SPEED
    way = functools.partial(stretched_twice, most=0.5 * STRENGTH / E * LENGTH, t_end=t_end)
    found = []
    for share in (0.25, 0.5, 0.75):
        body = bar(damaged=1.0)
        h = t_end / 64
        pulled(ImplicitContinuum(body), way, share * t_end, integrator=fm.GeneralizedAlpha(), h=h, rtol=1e-6)
        found.append((damage(body).copy(), body.history()[0].copy()))
    for (d, seen), (later, more) in itertools.pairwise(found):
        assert (more >= (1 - 1e-12) * seen).all()  # of two runs
        assert (later >= d - 1e-6).all()
    assert found[0][0].max() > 0.2


def scheme(rho=0.8):
    alpha_m, alpha_f = (2 * rho - 1) / (1 + rho), rho / (1 + rho)
    return Scheme(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f)


def turning(interior):
    """Frames of a body that stands askew and turns."""
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    w = np.array([0.5, -1.0, 2.0])
    p = np.array([frame.p_BI_B for frame in interior.frames]) @ R.T
    axes = np.array([R @ frame.R_BI for frame in interior.frames])
    return FrameMotion(p, axes, np.cross(w, p), np.tile(w, (2, 1)), np.cross(w, np.cross(w, p)), np.zeros((2, 3)))


def moved(start, y, *, size):
    """Those frames at a step's end, and by y (12,) beside it, as the scheme moves them."""
    rng, (per_x, per_v) = np.random.default_rng(1), scheme().slopes(H)
    turn = np.array([Rotation.from_rotvec(H * w + 20 * size * rng.normal(size=3)).as_matrix() for w in start.w])
    p = start.p + H * start.v + size * rng.normal(size=(2, 3))
    v, w, a, alpha = (part + rng.normal(size=(2, 3)) for part in (start.v, start.w, start.a, start.alpha))
    move, rotation = np.split(y.reshape(2, 6), 2, axis=1)
    R = np.einsum("kab,kbc,kcd->kad", Rotation.from_rotvec(rotation).as_matrix(), turn, start.R)
    speed = per_v / per_x
    return FrameMotion(
        p + move, R, v + speed * move, w + speed * rotation, a + move / per_x, alpha + rotation / per_x
    )


def rubber(*, nu=0.4999, degree=2, interfaces=ENDS, comm=MPI.COMM_SELF):
    mesh = meshes.block(0.3, 0.05, 0.05, divisions=(3, 1, 1), comm=comm)
    p = MIXED.Parameters(E=2e6, nu=nu, rho=1100.0)
    return NonlinearModel(mesh, MIXED, p, degree=degree, interfaces=list(interfaces))


def ceramic(*, comm=MPI.COMM_SELF, interfaces=ENDS):
    mesh = meshes.block(0.3, 0.05, 0.05, divisions=(3, 1, 1), comm=comm)
    form = piezo()
    p = form.reference().parameters
    return NonlinearModel(mesh, form, p, degree=1, interfaces=list(interfaces), surfaces={"x_min": (form, p)})


def cellular(*, micro_inertia=0.0, comm=MPI.COMM_SELF, interfaces=ENDS):
    mesh = meshes.block(0.3, 0.05, 0.05, divisions=(3, 1, 1), comm=comm)
    p = MICROPOLAR.Parameters(
        E=7.5e7, nu=0.25, rho=1200.0, coupling=1e7, length=0.02, micro_inertia=micro_inertia
    )
    return NonlinearModel(mesh, MICROPOLAR, p, degree=2, interfaces=list(interfaces))


BODIES = {
    "pressure": (rubber, 5e-4),
    "potential": (ceramic, 1e-6),
    "damage": (bar, 1e-5),
    "micro-rotation": (cellular, 1e-5),
}
AVERAGED = (Interface("x_min"), Interface("x_max", coupling=fm.Coupling.AVERAGED))


@pytest.mark.parametrize(
    ("name", "interfaces"), [(name, held) for name in BODIES for held in (ENDS, AVERAGED)][:-1]
)
def test_condensed_tangent_is_the_derivative_of_the_wrenches(name, interfaces):
    make, size = BODIES[name]
    interior = ImplicitContinuum(make(interfaces=interfaces))
    start = turning(interior)
    interior.begin(0.0, start, np.array([0.0, 1.0, -9.81]))
    _, slopes = interior.trial(H, H, scheme(), moved(start, np.zeros(12), size=size))
    step, found = 0.2 * size, np.zeros((12, 12))
    for j, unit in enumerate(np.eye(12)):
        there, back = (
            interior.trial(H, H, scheme(), moved(start, sign * step * unit, size=size))[0] for sign in (1.0, -1.0)
        )
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    scale = np.sqrt(abs(np.diag(slopes)))
    assert abs((found - slopes) / scale / scale[:, None]).max() < 1e-3
    interior.commit()
    assert abs(interior.body.displacement[interior.body.layout.further_dofs]).max() > 0.0


@pytest.mark.parametrize("make", [rubber, ceramic, cellular])
def test_it_vibrates_as_the_reduced_one(make):
    body = make()
    (group,) = body.groups
    form, p = group.formulation, group.parameters
    ground = {"x_min": (form, p)} if make is ceramic else None
    model = ContinuumModel(body.mesh, form, p, degree=body.degree, interfaces=list(ENDS), surfaces=ground)
    record = craig_bampton(model, modes=22, frame="x_min")
    scene = fm.System()
    rod = scene.add(fm.ContinuumBody(ImplicitContinuum(body)), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    found = scene.linearize().frequencies()[:6]
    assert found == pytest.approx(record.frequencies(clamped=["x_min"])[:6], rel=1e-3)


def let_go(part, t_end, *, joint=None, **how):
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(part, name="bar")
    scene.connect(joint or fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    return scene.simulate(t_end, **how), body


FALLING = {
    "pressure": (MIXED, MIXED.Parameters(E=2e7, nu=0.45, rho=1100.0)),
    "micro-rotation": (
        MICROPOLAR,
        MICROPOLAR.Parameters(E=2e7, nu=0.25, rho=1100.0, coupling=4e6, length=0.02, micro_inertia=0.0),
    ),
}


@pytest.mark.parametrize("name", FALLING)
def test_it_falls_as_the_reduced_one_by_implicit_and_by_explicit_steps(name):
    """Clamped, under its weight, until it is deepest; so stiff that its displacements are small."""
    form, p = FALLING[name]
    mesh = meshes.block(0.15, 0.05, 0.05, divisions=(2, 1, 1), comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, form, p, degree=2, interfaces=list(ENDS))
    record = craig_bampton(model, modes=22, frame="x_min")
    t_end = 0.5 / record.frequencies(clamped=["x_min"])[0]

    def full():
        return NonlinearModel(mesh, form, p, degree=2, interfaces=list(ENDS))

    alpha = {"integrator": fm.GeneralizedAlpha(), "h": t_end / 50, "rtol": 1e-8}
    runs = [
        let_go(fm.FlexibleBody(record), t_end, rtol=1e-8),
        let_go(fm.ContinuumBody(ImplicitContinuum(full())), t_end, **alpha),
        let_go(fm.ContinuumBody(ExplicitContinuum(full())), t_end, integrator=fm.CentralDifference()),
    ]
    deepest, implicit, explicit = (run.position(body.frame("x_max"))[-1, 2] for run, body in runs)
    assert -5e-3 < deepest < -1e-5
    assert implicit == pytest.approx(deepest, rel=3e-3)
    assert explicit == pytest.approx(deepest, rel=1e-2)  # with lumped mass


def evenly(rate):
    """Velocities (n, 3) at places (n, 3) of a bar that is stretched at a rate, 1/s, about its middle."""

    def velocity(x):
        found = np.zeros(x.shape)
        found[:, 0] = rate * (x[:, 0] - LENGTH / 2)
        return found

    return velocity


def stretching(body, *, rate, h, steps):
    """Stretched evenly by a velocity, by explicit steps."""
    run = ExplicitRun(body, velocity=evenly(rate))
    run.simulate(h * steps, h=h, outputs=1)
    return run


def test_splitting_is_of_second_order():
    """Of places and damage, and none of the work is lost in it."""
    t_end = 0.4 * LENGTH / SPEED
    n = 8
    ends = []
    for refined in (1, 2, 4, 16):
        body = bar(damaged=0.0, cells=4)
        run = stretching(body, rate=2 * STRENGTH / E / t_end, h=t_end / (n * refined), steps=n * refined)
        ends.append((run.motion.x[:, 0].copy(), damage(body).copy()))
        assert run.account.error < 1e-2
        assert abs(run.account["splitting"]).max() < 1e-6 * run.account["kinetic"][0]
    for which in (0, 1):
        off = [abs(end[which] - ends[-1][which]).max() for end in ends[:-1]]
        assert off[0] / off[1] == pytest.approx(4.0, rel=0.2)
        assert off[1] / off[2] == pytest.approx(4.0, rel=0.2)
    assert ends[-1][1].max() > 0.1


def test_a_potential_needs_one_factor():
    """The potential is linear in the strain: one factor serves for the whole run, and one correction a step."""
    interior = ExplicitContinuum(ceramic())
    fields = interior.motion.mesh.fields
    factors, corrections = fields.factorisations, fields.corrections  # for the stable step
    run, part = let_go(fm.ContinuumBody(interior), 2e-4, integrator=fm.CentralDifference())
    assert fields.factorisations - factors == 1
    assert fields.corrections - corrections <= 2 * len(run.t)
    parts = run.energies(part)
    assert abs(parts["splitting"]).max() < 1e-9 * parts["kinetic"][-1]


@pytest.mark.parametrize("steps", STEPS)
def test_a_restart_is_the_same_to_the_bit(steps):
    kind, integrator = steps
    t_end = 6 * LENGTH / SPEED
    way = apart(2 * STRENGTH / E * LENGTH, t_end)
    ends, kept = [], []
    for again in (False, True):
        body = bar()
        at = {"restart": kept[0]} if again else {"checkpoints": [0.5 * t_end]}
        h = t_end / (40 if kind is ImplicitContinuum else 400)
        run, rod, _ = pulled(kind(body), way, t_end, integrator=integrator, h=h, **at)
        kept = run.checkpoints
        ends.append((damage(body).copy(), body.history()[0].copy(), run.position(rod.frame("x_max"))[-1]))
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(other, one)


def test_a_run_by_itself_restarts_to_the_bit(tmp_path):
    ends = []
    t_end = LENGTH / SPEED
    for restart in (None, tmp_path / "run.npz"):
        body = bar(interfaces=())
        run = ExplicitRun(body, velocity=evenly(100.0))
        checkpoints = RegularCheckpoints(tmp_path / "run.npz", 0.6 * t_end)
        run.simulate(t_end, outputs=2, checkpoints=checkpoints, restart=restart)
        ends.append((damage(body).copy(), run.motion.x.copy()))
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(other, one)


@pytest.mark.mpi
@pytest.mark.parametrize("steps", STEPS)
def test_ranks_share_fields(steps):
    kind, integrator = steps
    count = {ImplicitContinuum: 40, ExplicitContinuum: 400}[kind]
    t_end = 6 * LENGTH / SPEED
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        body = bar(comm=comm)
        interior = kind(body)
        way = apart(2 * STRENGTH / E * LENGTH, t_end)
        run, rod, slide = pulled(interior, way, t_end, integrator=integrator, h=t_end / count)
        found.append((run.reaction(slide), run.energies(rod)["fracture"], interior.snapshot()))
    alone, together = found
    assert together[0] == pytest.approx(alone[0], abs=1e-6 * abs(alone[0]).max())
    assert together[1] == pytest.approx(alone[1], rel=1e-6)
    # what one rank remembers another number of ranks takes over
    assert together[2]["further unknowns"] == pytest.approx(alone[2]["further unknowns"], rel=1e-5)
    other = kind(bar(comm=MPI.COMM_WORLD))
    other.restore(alone[2])
    np.testing.assert_array_equal(other.snapshot()["further unknowns"], alone[2]["further unknowns"])


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["pressure", "potential", "micro-rotation"])
def test_frames_are_pushed_alike_on_any_number_of_ranks(name):
    make, size = BODIES[name]
    answers = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        interior = ImplicitContinuum(make(comm=comm))
        start = turning(interior)
        interior.begin(0.0, start, np.array([0.0, 1.0, -9.81]))
        wrenches, slopes = interior.trial(H, H, scheme(), moved(start, np.zeros(12), size=size))
        interior.commit()
        answers.append((wrenches, slopes, interior.snapshot()["further unknowns"]))
    for alone, together in zip(*answers, strict=True):
        assert together == pytest.approx(alone, rel=1e-6, abs=1e-7 * abs(alone).max())


@pytest.mark.mpi
def test_what_a_body_cannot_carry_is_refused():
    comm = MPI.COMM_WORLD
    sheet = meshes.sheet(0.3, 0.05, divisions=(3, 1), comm=comm)
    plate = forms.plate_mitc
    with pytest.raises(FormulationError, match=r"a kinetic energy of their own.*give it none where it is small"):
        ExplicitContinuum(cellular(micro_inertia=1e-4, comm=comm))
    body = NonlinearModel(sheet, plate, plate.reference().parameters, degree=1, interfaces=list(ENDS))
    with pytest.raises(FormulationError, match=r"turn with the body \(rigid_motion\).*load it slowly"):
        ExplicitContinuum(body)
    with pytest.raises(InterfaceError, match=r"turn with the body.*Coupling.RIGID"):
        ImplicitContinuum(cellular(comm=comm, interfaces=AVERAGED))
    with pytest.raises(FormulationError, match=r"not determined by it.*take ImplicitContinuum"):
        ExplicitContinuum(rubber(nu=0.5, comm=comm))
    with pytest.raises(FormulationError, match="no bulk viscosity"):
        ExplicitContinuum(rubber(nu=0.4, comm=comm), bulk_viscosity=BulkViscosity())
