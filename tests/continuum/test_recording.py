"""What a body with history shows: fields over time against closed forms, on any number of ranks, after a restart."""

from mpi4py import MPI

import h5py
import numpy as np
import pytest
from dolfinx import fem

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    RigidPlane,
    TractionOnFacets,
)
from flexmbd.errors import MeshError, PictureError, RecordError, SceneError
from flexmbd.forms import hencky_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening
from flexmbd.visual import Look
from flexmbd.visual.recorded_skin import recorded_skin

COMM = MPI.COMM_WORLD
STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 2.5e8, "hardening": LinearHardening(8e8)}
EXPLICIT = {"integrator": fm.CentralDifference(), "t_end": 1e-4}
IMPLICIT = {"t_end": 2e-3, "rtol": 1e-3}


def bar(kind, *, form=hencky_plasticity, comm=COMM, velocity=20.0, **options):
    """On a hinge, set turning at once."""
    mesh = meshes.block(0.2, 0.02, 0.02, divisions=(8, 1, 2), comm=comm)
    body = NonlinearModel(mesh, form, form.Parameters(**STEEL), degree=1, interfaces=[Interface("x_min")])
    interior = kind(body, **options)
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **({} if comm.size == 1 else {"team": MpiTeam(comm)}))
    rod = scene.add(fm.ContinuumBody(interior), name="rod")
    hinge = scene.connect(
        fm.joint.Revolute(axis="y"), scene.ground.frame(p=interior.frames[0].p_BI_B), rod.frame("x_min")
    )
    hinge.velocity = velocity
    return scene, rod


@pytest.fixture
def folder(tmp_path):
    """The root's."""
    return COMM.bcast(tmp_path)


@pytest.mark.parametrize(("kind", "how"), [(ExplicitContinuum, EXPLICIT), (ImplicitContinuum, IMPLICIT)])
def test_recording_changes_no_step(kind, how, tmp_path):
    scene, _ = bar(kind, comm=MPI.COMM_SELF)
    bare = scene.simulate(**how)
    scene, rod = bar(kind, comm=MPI.COMM_SELF)
    recording = fm.Recording(tmp_path / "rod.h5", every=how["t_end"] / 7)
    run = scene.simulate(recording=recording, **how)
    for name in ("t", "x", "v", "a"):
        assert np.array_equal(getattr(run, name), getattr(bare, name))
    instants = run.recorded(rod).t
    assert np.isin(instants, run.t).all()
    assert instants[0] == 0.0
    assert instants[-1] == how["t_end"]
    # the first step at each multiple or after it
    for k in range(1, 7):
        first = run.t[run.t >= k * recording.every * (1.0 - 1e-9)][0]
        assert first in instants
    assert len(instants) == 8


def test_an_instant_compiles_nothing(tmp_path, monkeypatch):
    """What the ranks do not divide: the stress is compiled for the first instant, as in a run that keeps two."""
    made: list[str] = []
    compiled = fem.Expression

    def counted(expression, points):
        made.append(type(expression).__name__)
        return compiled(expression, points)

    monkeypatch.setattr(fem, "Expression", counted)
    expressions = []
    for instants in (2, 11):
        made.clear()
        scene, _ = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
        run = scene.simulate(recording=fm.Recording(tmp_path / "rod.h5", every=1e-4 / (instants - 1)), **EXPLICIT)
        assert len(run.recordings[0].t) == instants
        expressions.append(sorted(made))
    assert expressions[0] == expressions[1]


@pytest.mark.mpi
@pytest.mark.parametrize(("kind", "how"), [(ExplicitContinuum, EXPLICIT), (ImplicitContinuum, IMPLICIT)])
def test_nodes_and_points_move_with_their_body(kind, how, folder):
    """Those of the hinge's interface as its frame, others as a body that turns; a cell's middle as its nodes' mean."""
    scene, rod = bar(kind)
    run = scene.simulate(recording=fm.Recording(folder / "rod.h5", every=how["t_end"] / 5), **how)
    seen, frame = run.recorded(rod), rod.frame("x_min")
    rows = np.searchsorted(run.t, seen.t)
    p, R, v = run.position(frame)[rows], run.rotation(frame)[rows], run.velocity(frame)[rows]
    w, a = run.angular_velocity(frame)[rows], run.acceleration(frame)[rows]
    corner = np.array([0.0, -0.01, 0.01])
    moved = seen.position(point=corner)
    arm = R @ corner
    assert moved == pytest.approx(p + arm, abs=1e-12)
    assert seen.velocity(point=corner) == pytest.approx(v + np.cross(w, arm), abs=1e-9)
    turning = np.cross(w, np.cross(w, arm))
    assert abs(seen.acceleration(point=corner) - a - turning).max() > 0.0
    middle = np.array([0.2 - 0.0125, 0.0, 0.005])
    signs = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T
    corners = middle + signs * np.array([0.0125, 0.01, 0.005])
    mean = np.mean([seen.position(point=one) for one in corners], axis=0)
    assert seen.position(point=middle) == pytest.approx(mean, abs=1e-12)
    mesh = seen.mesh
    tip = mesh.node[np.linalg.norm(mesh.x - [0.2, 0.01, 0.01], axis=1).argmin()]
    assert np.array_equal(seen.position(node=tip), seen.values("position")[:, mesh.node == tip][:, 0])
    speed = seen.velocity(node=tip)[-1]
    assert speed[2] == pytest.approx(-20.0 * 0.2, rel=0.05)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_stress_and_plastic_strain_of_a_pulled_bar(kind, folder):
    """Pulled beyond its yield stress: load over area along the bar, wherever it points; on the yield surface."""
    form = hencky_plasticity
    mesh = meshes.block(0.02, 0.02, 0.02, divisions=(2, 1, 1), comm=COMM)
    parameters = form.Parameters(**{**STEEL, "nu": 0.0, "rho": 1e4})
    body = NonlinearModel(mesh, form, parameters, degree=1, interfaces=[Interface("x_min")])
    load = 2.9e8
    rise = 2e-4
    pull = fm.Piecewise(lambda t: min(t / rise, 1.0), breaks=[rise])
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    interior = kind(body, loads=[TractionOnFacets("x_max", (0.0, load, 0.0), factor=pull, name="pull")])
    scene = fm.System(**({} if COMM.size == 1 else {"team": MpiTeam(COMM)}))
    block = scene.add(fm.ContinuumBody(interior), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(R=R), block.frame("x_min"))
    how = {"integrator": fm.CentralDifference()} if kind is ExplicitContinuum else {"h": rise / 40}
    run = scene.simulate(1.2 * rise, recording=fm.Recording(folder / "block.h5", every=0.1 * rise), **how)
    seen = run.recorded(block)
    middle = (0.01, 0.0, 0.0)
    stress, strain = seen.series("stress", point=middle), seen.series("plastic_strain", point=middle)
    assert {"plastic_strain", "elastic_left_cauchy_green", "von_mises"} <= set(seen.fields)
    # along inertial y; of the rest next to nothing
    assert stress[-1, 1] == pytest.approx(load, rel=0.06)
    assert abs(stress[-1, 3:]).max() < 1e-6 * load
    assert stress[-1, 0] == pytest.approx(stress[-1, 2], rel=1e-5)
    # the held end keeps the section from shrinking; what yields is on the yield surface all the same
    mises, volume = seen.series("von_mises", point=middle), 1.0 + seen.series("dilatation", point=middle)
    assert strain[-1] > 0.01
    # Kirchhoff stress; a product of averages over cells
    assert volume[-1] * mises[-1] == pytest.approx(2.5e8 + 8e8 * strain[-1], rel=1e-3)
    field = run.stress(block, t=1.2 * rise)
    xx = field.stress[:, 0, 0]
    assert xx.mean() == pytest.approx(load, rel=0.06)
    assert field.max >= field.von_mises.max() * (1.0 - 1e-6)
    assert field.displacement[:, 0].max() == pytest.approx(0.02 * strain[-1], rel=0.2)
    assert run.outer_forces(block)["pull"][-1] == pytest.approx([0.0, load * 4e-4, 0.0], rel=1e-9)
    wrench = run.interior_wrench(block, "x_min")[-1]
    assert wrench[1] == pytest.approx(load * 4e-4, rel=0.2)


def test_the_wall_stops_what_falls_on_it():
    """The impulse of a plane's force and of weight is the change of momentum: of nodes, and of the frame's part."""
    form = updated_lagrangian
    mesh = meshes.block(0.02, 0.02, 0.02, divisions=(2, 2, 2), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, form.Parameters(**STEEL), degree=1, interfaces=[Interface("x_max")])
    interior = ExplicitContinuum(body, planes=[RigidPlane((-1e-4, 0.0, 0.0), (1.0, 0.0, 0.0), name="wall")])
    scene = fm.System()
    block = scene.add(fm.ContinuumBody(interior), name="block")
    guide = scene.connect(
        fm.joint.Prismatic(axis="x"), scene.ground.frame(p=interior.frames[0].p_BI_B), block.frame("x_max")
    )
    guide.velocity = -20.0
    run = scene.simulate(3e-5, integrator=fm.CentralDifference())
    force = run.outer_forces(block)["wall"]
    impulse = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(run.t)[:, None], axis=0)
    frame = interior.frames[0]
    momentum = interior.motion.momentum(np.zeros(3))[0] + frame.mass * run.velocity(block.frame("x_max"))[-1, 0]
    assert force[:, 0].max() > 1e3
    assert impulse[0] == pytest.approx(momentum + 20.0 * block.mass, rel=1e-6)


def test_a_restart_goes_on_with_the_recording_to_the_bit(tmp_path):
    whole, parts = tmp_path / "whole.h5", tmp_path / "parts.h5"
    scene, _ = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
    run = scene.simulate(recording=fm.Recording(whole, every=1e-5), checkpoints=[4.2e-5], **EXPLICIT)
    scene, _ = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
    first = scene.simulate(
        7e-5, recording=fm.Recording(parts, every=1e-5), checkpoints=[4.2e-5], integrator=fm.CentralDifference()
    )
    (checkpoint,) = first.checkpoints
    scene, _ = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
    scene.simulate(recording=fm.Recording(parts, every=1e-5), restart=checkpoint, **EXPLICIT)
    asked, found = run.recordings[0], fm.load_recording(parts)["rod"]
    assert np.array_equal(asked.t, found.t)
    for name in asked.fields:
        assert np.array_equal(asked.values(name), found.values(name))


def test_steps_that_an_event_takes_back_are_not_recorded(tmp_path):
    scene, rod = bar(ImplicitContinuum, comm=MPI.COMM_SELF)
    turned = fm.Event(lambda m: m.rotation(rod.frame("x_min"))[2, 0] + 0.02, name="turned", stop=True)
    run = scene.simulate(recording=fm.Recording(tmp_path / "rod.h5", every=1e-6), events=[turned], **IMPLICIT)
    seen = run.recorded(rod)
    assert np.array_equal(seen.t, run.t)
    assert run.t[-1] < IMPLICIT["t_end"]


def test_a_film_shows_the_recorded_surface(tmp_path):
    """Vertices where the recording has the nodes, linear between its instants; mirrored ones on the other side."""
    scene, rod = bar(ImplicitContinuum, comm=MPI.COMM_SELF)
    run = scene.simulate(recording=fm.Recording(tmp_path / "rod.h5", every=4e-4), **IMPLICIT)
    seen = run.recorded(rod)
    times = np.array([seen.t[0], 0.5 * (seen.t[1] + seen.t[2]), seen.t[-1]])
    look = Look("plastic_strain", mirror="y")
    skin = recorded_skin(seen, times, look, amplification=1.0)
    nodes = np.unique(seen.mesh.triangle)
    position = seen.values("position")[:, nodes]
    wanted = 0.5 * (position[1] + position[2])
    places, colours = skin.at(1)
    assert places[: len(nodes)] == pytest.approx(wanted, abs=1e-7)
    assert places[len(nodes) :] == pytest.approx(wanted * [1.0, -1.0, 1.0], abs=1e-7)
    strain = seen.values("plastic_strain")[-1, nodes]
    assert skin.at(2)[1] == pytest.approx(np.tile(strain, 2), abs=1e-9)
    assert len(colours) == len(places)
    a, b, c = skin.x[skin.triangle].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", np.cross(a, b), c) / 6.0
    assert volume == pytest.approx(2 * 0.2 * 0.02 * 0.02, rel=1e-9)
    film = run.animate(tmp_path / "rod.gif", looks={rod: look}, size=(160, 120), fps=2)
    assert film.stat().st_size > 1000
    with pytest.raises(PictureError, match="cannot be coloured by 'heat'; its fields are"):
        run.animate(tmp_path / "rod.gif", looks={rod: Look("heat")})
    with pytest.raises(PictureError, match="mirrored along axes"):
        Look(mirror="xw")


def test_paraview_gets_the_recorded_fields(tmp_path):
    scene, rod = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
    run = scene.simulate(recording=fm.Recording(tmp_path / "rod.h5", every=2e-5), **EXPLICIT)
    seen = run.recorded(rod)
    assert fm.export.vtkhdf(run, tmp_path / "rod.vtkhdf") == ()
    nodes = np.unique(seen.mesh.triangle)
    with h5py.File(tmp_path / "rod.vtkhdf") as file:
        root, n = file["VTKHDF"], len(nodes)
        assert np.array_equal(root["Steps/Values"][()], seen.t)
        points = root["Points"][()].reshape(len(seen.t), n, 3)
        assert points == pytest.approx(seen.values("position")[:, nodes], abs=1e-15)
        stress = root["PointData/von_mises"][()].reshape(len(seen.t), n)
        assert stress == pytest.approx(seen.values("von_mises")[:, nodes])
        moved = root["PointData/displacement"][()].reshape(len(seen.t), n, 3)
        p, R = seen.pose()
        assert points - moved == pytest.approx(p[:, None] + seen.mesh.x[nodes] @ R.transpose(0, 2, 1), abs=1e-7)


def test_what_cannot_be_seen_is_told(tmp_path):
    scene, rod = bar(ExplicitContinuum, comm=MPI.COMM_SELF)
    bare = scene.simulate(1e-5, integrator=fm.CentralDifference())
    with pytest.raises(SceneError, match="the fields of body 'rod' were not kept"):
        bare.recorded(rod)
    run = scene.simulate(1e-5, integrator=fm.CentralDifference(), recording=fm.Recording(tmp_path / "a.h5", every=5e-6))
    seen = run.recorded(rod)
    with pytest.raises(SceneError, match="no field 'temperature'; it has"):
        seen.series("temperature", node=0)
    with pytest.raises(SceneError, match="no node of the number 999"):
        seen.position(node=999)
    with pytest.raises(SceneError, match="give a node or a point"):
        seen.position()
    with pytest.raises(MeshError, match="no cell of the undeformed body holds the point"):
        seen.position(point=(1.0, 0.0, 0.0))
    with pytest.raises(RecordError, match="cannot write"):
        scene.simulate(
            1e-5, integrator=fm.CentralDifference(), recording=fm.Recording(tmp_path / "none" / "a.h5", every=5e-6)
        )
    for wrong, words in ((0.0, "positive and"), (-1.0, "positive and"), (float("nan"), "a finite number, got nan")):
        with pytest.raises(SceneError, match=f"every .*{words}"):
            fm.Recording("a.h5", every=wrong)
    with pytest.raises(SceneError, match="recording"):
        scene.simulate(1e-5, recording="a.h5")
    rigid = fm.System()
    body = rigid.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    rigid.connect(fm.joint.Free(), rigid.ground.frame(), body.frame())
    with pytest.raises(SceneError, match="this machine has none"):
        rigid.simulate(1e-3, recording=fm.Recording(tmp_path / "b.h5", every=1e-4))
