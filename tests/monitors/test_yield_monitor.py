"""YieldMonitor against beam theory, against the model's own stress, and as an event."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import fsolve

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, ModalDamping, craig_bampton

# no lateral contraction: what the rigid ends would hinder
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.0, rho=7850.0)
LENGTH, WIDTH, HEIGHT = 0.6, 0.01, 0.02
MODULUS = WIDTH * HEIGHT**2 / 6.0
WEIGHT = STEEL.rho * LENGTH * WIDTH * HEIGHT * 9.81
SHIFT = np.array([1.0, 2.0, 3.0])


def rod(modes=4, **how):
    """A rod along x, bricks of degree 2, its model and record."""
    mesh = meshes.block(LENGTH, WIDTH, HEIGHT, divisions=(30, 1, 2), comm=MPI.COMM_SELF)
    # the mesh's origin is not the body frame's
    mesh.mesh.geometry.x[:] += SHIFT
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    return model, craig_bampton(model, modes=modes, frame="x_min", keep=Keep(modes=True, stress=True), **how)


@pytest.fixture(scope="module")
def linear():
    return rod(geometric_stiffness=False)


@pytest.fixture(scope="module")
def stretched():
    return rod()[1]


def at_rest(record, wrench):
    return record.interface("x_max").modes.T @ np.asarray(wrench) / record.stiffness


def pendulum(record):
    """Hinged at one end, released horizontally along x; it swings about y."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(record), name="rod")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("x_min"))
    return scene, body, hinge


def test_cantilever(linear):
    """F (l - x) / Z at the first nodes that are watched, three depths from the clamped end."""
    record, force, stress = linear[1], 250.0, 3e8
    monitor = fm.YieldMonitor(fm.FlexibleBody(record), yield_stress=stress, clearance=3.0 * HEIGHT + 1e-6)
    first = 3.0 * HEIGHT + 0.01  # the next nodes: at the middles of the cells
    assert monitor.x[:, 0].min() == pytest.approx(SHIFT[0] + first)
    assert monitor.x[:, 0].max() == pytest.approx(SHIFT[0] + LENGTH - first)
    expected = force * (LENGTH - first) / MODULUS / stress
    assert monitor.utilisation(at_rest(record, (0, 0, force, 0, 0, 0))) == pytest.approx(expected, rel=2e-3)


def bent(record, moment):
    """Modal coordinates in balance under a moment about y at the end, by the strain energy of the record."""
    modes, stretch, k = record.interface("x_max").modes, record.stretch, record.stiffness
    scale = 1.0 / np.sqrt(k)

    def balance(z):
        q = scale * z
        force = k * q
        second_order = 0.5 * np.einsum("i,mij,j->m", q, stretch.P, q)
        turned = np.einsum("m,mij,j->i", stretch.strain @ q + second_order, stretch.P, q)
        return scale * (force + stretch.strain.T @ second_order + turned - moment * modes[4])

    start = at_rest(record, (0, 0, 0, 0, moment, 0)) / scale
    return scale * fsolve(balance, start, xtol=1e-13)


@pytest.mark.parametrize("angle", [0.05, 0.1, 0.2])
def test_the_shortening_of_a_bent_rod_is_no_stress(stretched, angle):
    """A rod bent to an arc by a moment: M / Z all along."""
    moment = angle * STEEL.E * WIDTH * HEIGHT**3 / 12.0 / LENGTH
    q, stress = bent(stretched, moment), moment / MODULUS
    monitor = fm.YieldMonitor(fm.FlexibleBody(stretched), yield_stress=stress, clearance=3.0 * HEIGHT)
    assert monitor.utilisation(q) == pytest.approx(1.0, abs=1e-6)
    # of q alone the rod's shortening would be a strain
    alone = fm.FlexibleBody(dataclasses.replace(stretched, stretch=None))
    assert fm.YieldMonitor(alone, yield_stress=stress, clearance=3.0 * HEIGHT).utilisation(q) > 2.0


def test_against_the_pictures_of_a_run(linear):
    """At every node, instant by instant, as `Trajectory.stress` has it."""
    model, record = linear
    scene, body, _ = pendulum(record)
    run = scene.simulate(0.02, rtol=1e-5)
    monitor = fm.YieldMonitor(body, yield_stress=1e7, clearance=None)
    times = np.linspace(0.0, 0.02, 7)
    history = monitor.over(run, t=times)
    pictures = [run.stress(body, model, t=t) for t in times]
    of_all = np.array([picture.von_mises for picture in pictures]) / 1e7
    np.testing.assert_array_equal(history.watched, pictures[0].node)
    np.testing.assert_allclose(history.utilisation, of_all.max(axis=1), rtol=1e-9)
    np.testing.assert_allclose(history.peak, of_all.max(axis=0), rtol=1e-9)
    for i in range(1, 7):
        place = np.flatnonzero(pictures[i].node == history.node[i])[0]
        assert of_all[i, place] == pytest.approx(of_all[i].max(), rel=1e-9)
        np.testing.assert_allclose(pictures[i].x[place] + SHIFT, history.x[i], atol=1e-12)
    assert history.largest.utilisation == history.utilisation.max() == pytest.approx(history.peak.max())
    # in blocks of nodes and instants or one by one
    many = np.tile(run.q(body), (300 // len(run.t) + 1, 1))
    one_by_one = [monitor.utilisation(q) for q in many]
    np.testing.assert_allclose(monitor.utilisation(many), one_by_one, rtol=1e-12)


def test_swinging_rod():
    """Bending W cos(a) x (l - x)^2 / 4 l^2 and the pull of weight and swing, once its vibration has gone."""
    _, record = rod(modes=20, damping=ModalDamping(0.1, held=["x_min"]))
    scene, body, hinge = pendulum(record)
    run = scene.simulate(0.3, rtol=1e-6)
    monitor = fm.YieldMonitor(body, yield_stress=1e6, where=lambda x: x[0] - SHIFT[0] > 3.0 * HEIGHT)
    times = np.array([0.1, 0.2, 0.3])
    history = monitor.over(run, t=times)
    x = np.linspace(0.0, LENGTH, 61)
    for angle, found, place in zip(run.beta(hinge, t=times), history.utilisation, history.x, strict=True):
        bending = WEIGHT * np.cos(angle) * x * (LENGTH - x) ** 2 / (4.0 * LENGTH**2) / MODULUS
        swing = 3.0 * 9.81 * np.sin(angle) / LENGTH
        pull = STEEL.rho * (swing * (LENGTH**2 - x**2) / 2.0 + 9.81 * np.sin(angle) * (LENGTH - x))
        assert found * 1e6 == pytest.approx((bending + pull).max(), rel=0.01)
        assert abs(place[0] - SHIFT[0] - x[(bending + pull).argmax()]) < 0.05
        assert abs(place[2] - SHIFT[2]) == pytest.approx(HEIGHT / 2.0)


def ramp(record, rate):
    """A cantilever whose end is pulled along z by a force that grows slowly."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    scene.add_force(fm.force.FrameForce(body.frame("x_max"), force=(0.0, 0.0, fm.Table([0.0, 1.0], [0.0, rate]))))
    return scene, body


def test_first_yield(linear):
    """When a slowly growing force reaches Z sigma / (l - x), and the run stopped there by the event."""
    record, stress, rate = linear[1], 2e8, 500.0
    scene, body = ramp(record, rate)
    clearance = 3.0 * HEIGHT + 1e-6
    monitor = fm.YieldMonitor(body, yield_stress=stress, clearance=clearance)
    run = scene.simulate(0.6, rtol=1e-6)
    history = monitor.over(run)
    when = stress * MODULUS / (LENGTH - clearance - 0.01) / rate
    assert history.first.t == pytest.approx(when, rel=5e-3)
    assert history.first.utilisation == pytest.approx(1.0, rel=1e-9)
    assert history.first.x[0] == pytest.approx(SHIFT[0] + clearance + 0.01, abs=1e-5)
    assert history.first.node in history.watched
    assert history.t[history.utilisation >= 1.0][0] >= history.first.t
    # of few instants the same, since it is found between them
    assert monitor.over(run, t=[0.0, 0.6]).first.t == pytest.approx(history.first.t, rel=1e-3)
    text = str(history)
    assert "arm: von Mises stress over the yield stress of 200 MPa" in text
    assert f"first yields      {history.first}" in text
    ended = scene.simulate(0.6, rtol=1e-6, events=[monitor.event(stop=True)])
    assert [one.event.name for one in ended.events] == ["yield of arm"]
    assert ended.t[-1] == pytest.approx(history.first.t, rel=1e-6)
    assert monitor.over(ended).first.t == pytest.approx(ended.t[-1], rel=1e-9)
    stronger = fm.YieldMonitor(body, yield_stress=1e10).over(run)
    assert stronger.first is None
    assert "yields            nowhere" in str(stronger)


def test_a_run_that_yield_stopped_has_yielded(linear):
    """Whatever the last bits of its last row, on this processor or another, but not by more than that."""
    record, stress = linear[1], 2e8
    scene, body = ramp(record, 500.0)
    ended = scene.simulate(0.6, rtol=1e-6, events=[fm.YieldMonitor(body, yield_stress=stress).event(stop=True)])
    for bits in range(-4, 5):
        off = stress * (1.0 + bits * np.finfo(float).eps)
        history = fm.YieldMonitor(body, yield_stress=off).over(ended)
        assert history.first.t == pytest.approx(ended.t[-1], rel=1e-12)
        assert history.first.utilisation == pytest.approx(1.0, rel=1e-12)
        assert "yields            1 nodes" in str(history) or "yields            2 nodes" in str(history)
    assert fm.YieldMonitor(body, yield_stress=stress * (1.0 + 1e-11)).over(ended).first is None


def test_nodes_left_out(linear):
    record = linear[1]
    body = fm.FlexibleBody(record)
    everywhere = fm.YieldMonitor(body, yield_stress=1e8, clearance=None)
    np.testing.assert_array_equal(everywhere.node, record.stress.node)
    inside = fm.YieldMonitor(body, yield_stress=1e8).x[:, 0] - SHIFT[0]
    assert inside.min() == pytest.approx(0.01)
    assert inside.max() == pytest.approx(LENGTH - 0.01)
    half = fm.YieldMonitor(body, yield_stress=1e8, where=lambda x: x[2] > SHIFT[2] + 1e-6)
    assert half.x[:, 2].min() == pytest.approx(SHIFT[2] + HEIGHT / 4.0)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"yield_stress": 0.0}, "yield stress must be positive"),
        ({"yield_stress": float("nan")}, "yield_stress must be a finite number, got nan"),
        ({"yield_stress": 1e8, "clearance": -1.0}, "clearance must be a distance"),
        ({"yield_stress": 1e8, "clearance": 10.0}, "none of its .* nodes is left"),
        ({"yield_stress": 1e8, "where": lambda x: x[0]}, "must return n truth values, got float64"),
        ({"yield_stress": 1e8, "where": lambda x: x[5] > 0}, "`where` raised IndexError"),
    ],
)
def test_bad_input(linear, how, message):
    with pytest.raises(SceneError, match=message):
        fm.YieldMonitor(fm.FlexibleBody(linear[1]), **how)


def test_bad_bodies_and_runs(linear):
    with pytest.raises(SceneError, match=r"holds no stress modes; reduce it with keep=Keep\(stress=True\)"):
        fm.YieldMonitor(fm.FlexibleBody(dataclasses.replace(linear[1], stress=None)), yield_stress=1e8)
    with pytest.raises(SceneError, match="watches a FlexibleBody"):
        fm.YieldMonitor(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), yield_stress=1e8)
    scene, body = ramp(linear[1], 1.0)
    monitor = fm.YieldMonitor(body, yield_stress=1e8)
    run = scene.simulate(1e-3, rtol=1e-3)
    with pytest.raises(SceneError, match="must ascend"):
        monitor.over(run, t=[1e-3, 0.0])
    with pytest.raises(SceneError, match=r"modal coordinates, got \(1, 3\)"):
        monitor.utilisation(np.zeros(3))
    other = fm.YieldMonitor(fm.FlexibleBody(linear[1]), yield_stress=1e8)
    with pytest.raises(SceneError, match="no modal coordinates here"):
        other.over(run)
