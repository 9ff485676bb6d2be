"""A group of cells as a rigid part: as the body without them, on a rigid body of their mass."""

import dataclasses

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, ImplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.errors import InterfaceError
from flexmbd.forms import hencky_plasticity, solid_linear

COMM = MPI.COMM_WORLD
RUBBER = solid_linear.Parameters(E=1e8, nu=0.3, rho=1000.0)
SIDE = 0.05


def stubbed(comm=COMM):
    """A bar of six bricks, of which the two with x below 0.1 m are the group "stub"."""
    mesh = meshes.block(0.3, SIDE, SIDE, divisions=(6, 1, 1), comm=comm)
    topology = mesh.mesh.topology
    every = np.arange(topology.index_map(3).size_local + topology.index_map(3).num_ghosts, dtype=np.int32)
    x = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, every)[:, 0]
    tags = np.where(x < 0.1, 1, 2).astype(np.int32)
    return dataclasses.replace(
        mesh, cell_tags=dolfinx.mesh.meshtags(mesh.mesh, 3, every, tags), cell_groups={"stub": 1, "rest": 2}
    )


def swinging(kind, mesh, interface, part, *, comm=COMM, **how):
    """On a hinge at the interface's frame, let go with a turning rate; angle, and the wrench on the frame."""
    body = NonlinearModel(mesh, solid_linear, RUBBER, degree=1, interfaces=[interface])
    parts = {} if part is None else {interface.name: part}
    interior = kind(body, rigid_parts=parts)
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **({} if comm.size == 1 else {"team": MpiTeam(comm)}))
    bar = scene.add(fm.ContinuumBody(interior), name="bar")
    frame = bar.frame(interface.name)
    hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(p=interior.frames[0].p_BI_B), frame)
    hinge.velocity = 4.0
    run = scene.simulate(**how)
    return bar.mass, interior.frames[0], run.beta(hinge)[-1], run.beta_rate(hinge)[-1]


@pytest.mark.mpi
def test_rigid_cells_are_a_rigid_body_of_their_mass():
    """Implicit steps have the consistent mass, which of a rigid motion is exact."""
    how = {"t_end": 5e-3, "h": 2.5e-4}
    mass, frame, angle, rate = swinging(ImplicitContinuum, stubbed(), Interface("stub"), None, **how)
    assert frame.p_BI_B == pytest.approx([0.05, 0.0, 0.0], abs=1e-15)
    stub = 1000.0 * 0.1 * SIDE**2
    across, along = stub * (0.1**2 + SIDE**2) / 12.0, stub * 2.0 * SIDE**2 / 12.0
    part = fm.RigidBody(stub, (along, across, across))
    rest = meshes.block(0.2, SIDE, SIDE, divisions=(4, 1, 1), comm=COMM)
    there = Interface("x_min", origin=(-0.05, 0.0, 0.0))
    wanted = swinging(ImplicitContinuum, rest, there, part, **how)
    assert mass == pytest.approx(wanted[0], rel=1e-12)
    assert mass == pytest.approx(1000.0 * 0.3 * SIDE**2, rel=1e-12)
    assert (angle, rate) == pytest.approx(wanted[2:], rel=1e-7)
    # the rest bends: as one rigid body it would turn otherwise
    whole, arm = 3.0 * stub, 0.1
    inertia = whole * (0.3**2 + SIDE**2) / 12.0 + whole * arm**2
    assert abs(rate - 4.0 - whole * 9.81 * arm / inertia * 5e-3) > 0.01


def test_explicit_steps_lump_the_mass_of_rigid_cells():
    mass, frame, *_ = swinging(
        ExplicitContinuum, stubbed(MPI.COMM_SELF), Interface("stub"), None, comm=MPI.COMM_SELF, t_end=1e-4,
        integrator=fm.CentralDifference(),
    )  # fmt: skip
    cell = 1000.0 * 0.05 * SIDE**2
    assert mass == pytest.approx(6.0 * cell, rel=1e-12)
    # two cells, and of the next one half
    assert frame.mass == pytest.approx(2.5 * cell, rel=1e-12)


@pytest.mark.mpi
def test_groups_of_cells_that_touch_are_not_rigid_both():
    with pytest.raises(InterfaceError, match="'stub' and 'rest' share nodes"):
        NonlinearModel(stubbed(), solid_linear, RUBBER, degree=1, interfaces=[Interface("stub"), Interface("rest")])
    averaged = [Interface("stub", coupling=fm.Coupling.AVERAGED)]
    body = NonlinearModel(stubbed(), solid_linear, RUBBER, degree=1, interfaces=averaged)
    with pytest.raises(InterfaceError, match="a body that steps explicitly needs"):
        ExplicitContinuum(body)


@pytest.mark.mpi
def test_a_free_body_flies_with_a_frame_at_its_centre_of_mass(tmp_path):
    """Thrown and spinning, it vibrates and yields: the frame goes along the parabola, and the account closes."""
    mesh = meshes.block(0.3, SIDE, SIDE, divisions=(6, 1, 1), comm=COMM)
    soft = hencky_plasticity.Parameters(1e7, 0.3, 1000.0, 8e3)
    whole = [Interface("block", coupling=fm.Coupling.AVERAGED)]
    interior = ImplicitContinuum(NonlinearModel(mesh, hencky_plasticity, soft, degree=1, interfaces=whole))
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **({} if COMM.size == 1 else {"team": MpiTeam(COMM)}))
    block = scene.add(fm.ContinuumBody(interior), name="block")
    centre = block.frame("block")
    assert interior.frames[0].p_BI_B == pytest.approx([0.15, 0.0, 0.0], abs=1e-15)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(p=interior.frames[0].p_BI_B), centre)
    v, spin = np.array([3.0, 0.0, 2.0]), 30.0
    free.velocity = (*v, 0.0, spin, 0.0)
    t_end = 0.02
    path = COMM.bcast(tmp_path) / "block.h5"
    run = scene.simulate(t_end, rtol=1e-4, recording=fm.Recording(path, every=t_end / 4))
    fall = np.outer(run.t**2, [0.0, 0.0, -9.81]) / 2.0
    assert run.position(centre) == pytest.approx(np.array([0.15, 0.0, 0.0]) + np.outer(run.t, v) + fall, abs=2e-8)
    assert run.velocity(centre)[-1] == pytest.approx(v - np.array([0.0, 0.0, 9.81 * t_end]), abs=1e-5)
    parts = run.energies(block)
    total = run.energy().total + sum(parts.values())
    assert parts["plastic"][-1] > 0.01
    assert abs(total - total[0]).max() < 0.03 * parts["plastic"][-1]
    # angular momentum about the centre: of the nodes, and of the little mass that they lend the frame
    frame, w = interior.frames[0], run.angular_velocity(centre)[-1]
    state, n = interior._state, interior.body.layout.n_owned_nodes
    momenta = interior._nodes.inertia(state.v - run.velocity(centre)[-1]).reshape(-1, 3)
    own = np.cross(state.x[:n] - run.position(centre)[-1], momenta).sum(axis=0)
    R = run.rotation(centre)[-1]
    now = np.asarray(sum(COMM.allgather(own))) + R @ frame.inertia @ R.T @ w
    mass = 1000.0 * 0.3 * SIDE**2
    begun = mass * (0.3**2 + SIDE**2) / 12.0 * spin
    assert now == pytest.approx([0.0, begun, 0.0], abs=1e-3 * begun)
    seen = run.recorded(block)
    assert seen.values("plastic_strain", row=-1).max() > 1e-4
