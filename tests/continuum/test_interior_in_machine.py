"""Explicit beams and plates in a machine: as the reduced body with many modes, and with a free flight's momentum."""

import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.continuum.interior.corotated_interior import CorotatedInterior
from flexmbd.continuum.interior.rotational_dofs import condensed_rotations, lumped_rotations
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.forms import plate_mitc as plate
from flexmbd.reduction import craig_bampton

RULES = [condensed_rotations, lumped_rotations]
SOFT = beam.Parameters.rectangle(2e10, 0.3, 1500.0, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0))
HUB = (0.5, np.diag([0.2, 0.2, 0.2]))
TIP = (0.1, np.diag([1e-4, 2e-4, 2e-4]))
T_END = 0.06


def rod(cells, degree=1, comm=MPI.COMM_SELF):
    ends = [Interface("start"), Interface("end")]
    mesh = meshes.line(1.0, divisions=cells, comm=comm)
    return ContinuumModel(mesh, beam, SOFT, degree=degree, interfaces=ends)


def parts(names=("start", "end")):
    return {name: fm.RigidBody(*part) for name, part in zip(names, (HUB, TIP), strict=True)}


def hinged(scene, frame):
    """Set turning at once: the rod bends back by centimetres."""
    joint = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), frame)
    joint.velocity = 3.0
    return joint


@pytest.fixture(scope="module")
def reduced():
    """Tip of the reduced rod at the end of the run, and the hinge's angle."""
    scene = fm.System(gravity=(0.0, 0.0, -20.0))
    record = craig_bampton(rod(24, 2), modes=12, frame="start", geometric_stiffness=False)
    body = scene.add(fm.FlexibleBody(record), name="rod")
    joint = hinged(scene, body.frame("start"))
    for name, part in parts().items():
        scene.connect(fm.joint.Fixed(), body.frame(name), scene.add(part).frame())
    run = scene.simulate(t_end=T_END, rtol=1e-8)
    return np.append(run.position(body.frame("end"))[-1], run.beta(joint)[-1])


@pytest.mark.parametrize("rule", RULES)
def test_a_rod_on_a_hinge_goes_to_the_reduced_one_with_the_square_of_the_cells(reduced, rule):
    """Rigid parts at both ends, bonded with rotations; the reduced rod has 12 modes of a fine mesh and all its mass."""
    errors = []
    for cells in (6, 12):
        scene = fm.System(gravity=(0.0, 0.0, -20.0))
        body = scene.add(fm.ContinuumBody(CorotatedInterior(rule(rod(cells)), rigid_parts=parts())), name="rod")
        joint = hinged(scene, body.frame("start"))
        run = scene.simulate(t_end=T_END, integrator=fm.CentralDifference())
        found = np.append(run.position(body.frame("end"))[-1], run.beta(joint)[-1])
        errors.append(abs(found - reduced).max())
    straight = np.append([np.cos(reduced[3]), 0.0, -np.sin(reduced[3])], reduced[3])
    bent = abs(straight - reduced).max()
    assert bent > 0.01
    assert errors[1] < 4e-3 * bent
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_a_rod_spread_over_all_ranks_moves_as_on_one(rule):
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        team = {} if comm.size == 1 else {"team": MpiTeam(comm)}
        scene = fm.System(gravity=(0.0, 0.0, -20.0), **team)
        body = scene.add(fm.ContinuumBody(CorotatedInterior(rule(rod(6, comm=comm)), rigid_parts=parts())), name="rod")
        joint = hinged(scene, body.frame("start"))
        run = scene.simulate(t_end=200 * 2e-5, h=2e-5, integrator=fm.CentralDifference())
        found.append(np.append(run.position(body.frame("end"))[-1], [run.beta(joint)[-1], run.beta_rate(joint)[-1]]))
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("rule", RULES)
def test_a_free_plate_keeps_its_momentum_and_energy(rule):
    """Two rigid strips fly off turning, one of them faster: the plate between them bends and twists."""
    p = plate.Parameters(E=2e9, nu=0.3, rho=1500.0, t=0.01)
    edges = [Interface("x_min"), Interface("x_max")]
    mesh = meshes.sheet(1.0, 0.5, divisions=(4, 2), comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, plate, p, degree=1, interfaces=edges)
    interior = CorotatedInterior(rule(model), rigid_parts=parts(("x_min", "x_max")))
    scene = fm.System()
    body = scene.add(fm.ContinuumBody(interior), name="plate")
    frames = [body.frame(edge.name) for edge in edges]
    places = [frame.p_BI_B for frame in interior.frames]
    for frame, place, speed in zip(frames, places, ((1.0, 2.0, 3.0), (1.0, 2.5, 3.0)), strict=True):
        joint = scene.connect(fm.joint.Free(), scene.ground.frame(p=place), frame)
        joint.velocity = (*speed, 0.5, 1.0, 2.0)
    run = scene.simulate(t_end=0.02, h=0.1 * interior.stable_step(), integrator=fm.CentralDifference())
    energies = run.energies(body)
    total = run.energy().total + sum(energies.values())
    # of a tenth of the stable step, and of its square
    assert abs(total - total[0]).max() < 4e-3 * energies["elastic"].max()
    assert energies["elastic"].max() > 0.5

    memory, operator = interior.snapshot(), interior.operator
    nodes, turns = model.displacement_dofs[:, 0], operator.rotations[:, 0]
    masses, inertias = (operator.masses[which[operator.moving[which]]] for which in (nodes, turns))
    x = model.node_x[operator.moving[nodes]]
    w = np.array([0.5, 1.0, 2.0])
    first = momentum(run, 0, frames, interior.frames)
    v = np.array([1.0, 2.0, 3.0]) + np.cross(w, x - places[0])
    first += of_nodes(masses, x, v, inertias, np.tile(w, (len(inertias), 1)))
    last = momentum(run, -1, frames, interior.frames)
    last += of_nodes(masses, memory["x"], memory["v"], inertias, memory["w"])
    assert abs(last - first)[:3].max() < 1e-12 * abs(first).max()
    # turning the frames is the machine's affair, of its step's order
    assert abs(last - first)[3:].max() < 1e-6 * abs(first).max()


def of_nodes(masses, x, v, inertias, w):
    """Momentum and moment of momentum of nodes about the origin."""
    return np.append(masses @ v, masses @ np.cross(x, v) + inertias @ w)


def momentum(run, row, frames, data):
    """Of the frames' rigid bodies, about the origin."""
    total = np.zeros(6)
    for frame, part in zip(frames, data, strict=True):
        R, w = run.rotation(frame)[row], run.angular_velocity(frame)[row]
        c = R @ part.com
        x, v = run.position(frame)[row] + c, run.velocity(frame)[row] + np.cross(w, c)
        total += part.mass * np.append(v, np.cross(x, v))
        total[3:] += R @ part.inertia @ R.T @ w
    return total


def test_the_page_on_turning_bodies():
    """Its code runs and does what it says: the rope falls; the rod turns, and bends back."""
    page = Path(__file__).parents[2] / "docs" / "rotational_dofs.md"
    names = {}
    for code in re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
        exec(compile(code, str(page), "exec"), names)
    falls, rope = names["falls"], names["rope"]
    assert -0.1 < falls.position(rope.frame("end"))[-1, 2] < -0.03
    run, rod, hinge = names["run"], names["rod"], names["hinge"]
    angle = run.beta(hinge)[-1]
    gap = run.position(rod.frame("end"))[-1] - (np.cos(angle), 0.0, -np.sin(angle))
    assert 0.1 < angle < 0.3
    assert 1e-3 < np.linalg.norm(gap) < 0.05
