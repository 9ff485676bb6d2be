"""Pressure of contacts at the nodes of bodies with history: its integral is the force; films and files have it."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, ImplicitContinuum, Interface, MpiTeam, NonlinearModel, RigidPlane
from flexmbd.forms import solid_linear
from flexmbd.visual import Look

EXPLICIT = fm.CentralDifference()
RUBBER = solid_linear.Parameters(E=1e6, nu=0.3, rho=1000.0)


def block(kind, *, divisions=(2, 3, 2), degree=1, held="z_max", comm=MPI.COMM_SELF, **told):
    """A cube of 0.1 m, about z = 0."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=divisions, comm=comm)
    return kind(NonlinearModel(mesh, solid_linear, RUBBER, degree=degree, interfaces=[Interface(held)]), **told)


def pressed(interior, shape, tmp_path, *, t_end=0.02, comm=MPI.COMM_SELF, **told):
    """A block whose upper face goes down by 2 mm and aside, on a shape of the ground, or none."""
    scene = fm.System(team=MpiTeam(comm))
    part = scene.add(fm.ContinuumBody(interior), name="block")
    t = np.linspace(0.0, t_end, 41)
    way = fm.Table(t, -2.2e-3 * (t / t_end) ** 2 * (3.0 - 2.0 * t / t_end))
    rail = scene.connect(
        fm.joint.Prismatic((0.3, 0.0, 1.0)), scene.ground.frame(p=interior.frames[0].p_BI_B), part.frame("z_max")
    )
    rail.prescribe(way)
    pairs = ()
    if shape is not None:
        pairs = scene.touch(fm.contact.Nodes(part, "z_min"), shape(scene.ground), fm.contact.Hard(mu=0.2))
    recording = fm.Recording(tmp_path / "fields", every=t_end / 8)
    return scene.simulate(t_end, recording=recording, **told), part, pairs


def integral(kept, on):
    """(nt,) N, of the pressure, linear over the triangles of which ``on`` (nodes,) says that all corners are."""
    triangle = kept.mesh.triangle[on[kept.mesh.triangle].all(axis=1)]
    a, b, c = (kept.mesh.x[triangle[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return kept.values("contact_pressure")[:, triangle].mean(axis=2) @ area


def half_space(ground):
    return fm.contact.HalfSpace(ground.frame(p=(0.0, 0.0, -0.0501)))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_the_integral_is_the_normal_force(kind, degree, tmp_path):
    implicit = kind is ImplicitContinuum
    told = {"integrator": fm.GeneralizedAlpha(), "h": 2e-3} if implicit else {"integrator": EXPLICIT}
    run, part, (contact,) = pressed(block(kind, degree=degree), half_space, tmp_path, **told)
    kept = run.recorded(part)
    below = kept.mesh.x[:, 2] < -0.05 + 1e-9
    rows = np.searchsorted(run.t, kept.t)
    force = run.outer_forces(part)[contact.name][rows]
    assert force[-1, 2] > 100.0
    assert abs(force[-1, 0]) > 1.0  # friction, which is no part of the pressure
    # recorded in single precision
    assert integral(kept, below) == pytest.approx(force[:, 2], rel=1e-6, abs=1e-6 * force[-1, 2])
    pressure = kept.values("contact_pressure")
    assert (pressure[:, ~below] == 0.0).all()
    assert (pressure >= 0.0).all()


@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_a_node_on_an_edge_has_what_both_faces_press(kind, tmp_path):
    """A block that is pushed into a corner; and what is restored has it."""
    scene = fm.System()
    interior = block(kind)
    part = scene.add(fm.ContinuumBody(interior), name="block")
    rail = scene.connect(
        fm.joint.Prismatic((1.0, 0.0, 1.0)), scene.ground.frame(p=interior.frames[0].p_BI_B), part.frame("z_max")
    )
    t = np.linspace(0.0, 0.02, 41)
    rail.prescribe(fm.Table(t, -2e-3 * (t / 0.02) ** 2 * (3.0 - 2.0 * t / 0.02)))
    wall = scene.ground.frame(p=(-1e-4, 0.0, 0.0), R=[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    pairs = [
        *scene.touch(fm.contact.Nodes(part, "z_min"), half_space(scene.ground), fm.contact.Hard()),
        *scene.touch(fm.contact.Nodes(part, "x_min"), fm.contact.HalfSpace(wall), fm.contact.Hard()),
    ]
    explicit = kind is ExplicitContinuum
    told = {"integrator": EXPLICIT} if explicit else {"integrator": fm.GeneralizedAlpha(), "h": 1e-3}
    run = scene.simulate(0.02, recording=fm.Recording(tmp_path / "fields", every=2e-3), **told)
    kept = run.recorded(part)
    on = (kept.mesh.x[:, 2] < -0.05 + 1e-9) | (kept.mesh.x[:, 0] < 1e-9)
    forces = [run.outer_forces(part)[pair.name][np.searchsorted(run.t, kept.t)] for pair in pairs]
    sizes = [np.linalg.norm(force, axis=1) for force in forces]
    assert min(size[-1] for size in sizes) > 50.0
    assert integral(kept, on) == pytest.approx(sum(sizes), rel=1e-6, abs=1e-6 * sizes[0][-1])
    if explicit:
        before = interior.motion.contacts.pushed().force
        interior.restore(interior.snapshot())
        assert np.array_equal(interior.motion.contacts.pushed().force, before)


def test_both_bodies_of_a_pair_have_it(tmp_path):
    """Their meshes do not match."""
    scene = fm.System()
    upper, lower = block(ExplicitContinuum), block(ExplicitContinuum, divisions=(3, 2, 2), held="z_min")
    parts = [scene.add(fm.ContinuumBody(one), name=name) for one, name in ((upper, "upper"), (lower, "lower"))]
    at = upper.frames[0].p_BI_B + np.array([0.0, 0.0, 0.1001])
    rail = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(p=at), parts[0].frame("z_max"))
    rail.prescribe(lambda t: (-0.2 * t, -0.2, 0.0))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=lower.frames[0].p_BI_B), parts[1].frame("z_min"))
    facets = fm.contact.SurfaceFacets(parts[1], "z_max")
    (pair,) = scene.touch(fm.contact.Nodes(parts[0], "z_min"), facets, fm.contact.Hard())
    run = scene.simulate(0.01, integrator=EXPLICIT, recording=fm.Recording(tmp_path / "fields", every=1e-3))
    for part, side in ((parts[0], -0.05), (parts[1], 0.05)):
        kept = run.recorded(part)
        rows = np.searchsorted(run.t, kept.t)
        force = np.linalg.norm(run.outer_forces(part)[pair.name][rows], axis=1)
        assert force.max() > 10.0
        on = abs(kept.mesh.x[:, 2] - side) < 1e-9
        # facets turn a little, and what pushes their nodes with them
        assert integral(kept, on) == pytest.approx(force, rel=1e-3, abs=1e-6 * force.max())


def test_planes_press_all_nodes_and_what_touches_nothing_has_no_such_field(tmp_path):
    plane = RigidPlane((0.0, 0.0, -0.0501), (0.0, 0.0, 1.0), name="floor")
    run, part, _ = pressed(block(ExplicitContinuum, planes=[plane]), None, tmp_path, integrator=EXPLICIT)
    kept = run.recorded(part)
    force = run.outer_forces(part)["floor"][np.searchsorted(run.t, kept.t)]
    everywhere = np.ones(len(kept.mesh.x), bool)
    assert integral(kept, everywhere)[-1] == pytest.approx(force[-1, 2], rel=1e-6)
    run, part, _ = pressed(block(ExplicitContinuum), None, tmp_path, integrator=EXPLICIT, t_end=2e-3)
    assert "contact_pressure" not in run.recorded(part).fields


def test_films_and_files_have_it(tmp_path):
    run, part, _ = pressed(block(ExplicitContinuum), half_space, tmp_path, integrator=EXPLICIT)
    look = {part: Look("contact_pressure")}
    run.show(path=tmp_path / "a.png", t=0.02, size=(320, 240), looks=look)
    run.show(path=tmp_path / "b.png", t=0.02, size=(320, 240))
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
    from flexmbd.visual.drawn_scene import drawn_scene

    drawn = drawn_scene(run, run.t[-1:], notes=[""], recordings=run.recordings, looks=look)
    assert ("contact pressure", "Pa") in drawn.quantities
    fm.export.vtkhdf(run, tmp_path / "a.vtkhdf")
    import h5py

    with h5py.File(tmp_path / "a.vtkhdf") as file:
        found = np.nanmax(file["VTKHDF/PointData/contact_pressure"][:])
    assert found == pytest.approx(run.recorded(part).values("contact_pressure").max(), rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_all_ranks_together_record_what_one_does(kind, tmp_path):
    world = MPI.COMM_WORLD
    folder = world.bcast(tmp_path)
    told = {"integrator": EXPLICIT} if kind is ExplicitContinuum else {"integrator": fm.GeneralizedAlpha(), "h": 2e-3}
    run, part, _ = pressed(block(kind, comm=world), half_space, folder, comm=world, **told)
    found = run.recorded(part).values("contact_pressure")
    own = tmp_path / f"alone {world.rank}"
    own.mkdir()
    alone, part, _ = pressed(block(kind), half_space, own, **told)
    assert found == pytest.approx(alone.recorded(part).values("contact_pressure"), rel=1e-5, abs=1e-5 * found.max())
