"""A part of which one piece may yield and the others are reduced, against the part as one body that may."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, ImplicitContinuum, Interface, NonlinearModel, cut_mesh
from flexmbd.forms import hencky_plasticity, j2_plasticity, solid_linear
from flexmbd.reduction import Keep, craig_bampton

SIDE, YIELD = 0.02, 2.5e8
STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}
ELASTIC = solid_linear.Parameters(**STEEL)
PLASTIC = hencky_plasticity.Parameters(**STEEL, yield_stress=YIELD, hardening=j2_plasticity.LinearHardening(2e8))
ENDS = ("x_min", "x_max")
WEIGHT, PUSH = 4.0, 5e-3


def bar(depths, divisions, *, waist=None):
    """A square bar along x; with a waist, so many depths from its start, of half the height."""
    mesh = meshes.block(depths * SIDE, SIDE, SIDE, divisions=divisions, comm=MPI.COMM_SELF)
    if waist is not None:
        x = mesh.mesh.geometry.x
        x[:, 2] *= 1.0 - 0.25 * (1.0 + np.cos(np.pi * np.minimum(abs(x[:, 0] / SIDE - waist), 1.0)))
    return mesh


def solid(mesh, form, parameters, interfaces):
    body = NonlinearModel(mesh, form, parameters, degree=1, interfaces=interfaces)
    return fm.ContinuumBody(ImplicitContinuum(body))


@dataclass
class Part:
    """A scene with a part clamped at its start and a weight at its end."""

    scene: fm.System
    bodies: dict
    tip: object

    def pushed(self, force, t_end, **how):
        self.scene.add_force(fm.force.FrameForce(self.tip, force=(0.0, 0.0, force)))
        run = self.scene.simulate(t_end, integrator=fm.GeneralizedAlpha(rho=0.8), **how)
        return run, run.position(self.tip)


def clamped(bodies, first, last):
    scene = fm.System()
    for name, body in bodies.items():
        scene.add(body, name=name)
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bodies[first].frame("x_min"))
    weight = scene.add(fm.RigidBody(WEIGHT, WEIGHT * np.full(3, 0.4 * 0.04**2)), name="weight")
    tip = bodies[last].frame("x_max")
    scene.connect(fm.joint.Fixed(), tip, weight.frame())
    return scene, tip


def whole(mesh, form, parameters):
    body = solid(mesh, form, parameters, [Interface(name) for name in ENDS])
    scene, tip = clamped({"bar": body}, "bar", "bar")
    return Part(scene, {"bar": body}, tip)


def in_pieces(mesh, form, parameters, *, region, coupling, modes=8):
    cut = cut_mesh(mesh, {"hinge": fm.Slab((1.0, 0.0, 0.0), *(SIDE * np.array(region)))})
    bodies = {}
    for name, piece in cut.pieces.items():
        at_cuts = cut.interfaces(name, coupling=coupling)
        held = [Interface(end) for end in ENDS if end in piece.facet_groups]
        if name in cut.yielding:
            bodies[name] = solid(piece, form, parameters, at_cuts)
            continue
        model = ContinuumModel(piece, solid_linear, ELASTIC, degree=1, interfaces=[*held, *at_cuts])
        frame = "x_min" if "x_min" in piece.facet_groups else at_cuts[0].name
        bodies[name] = fm.FlexibleBody(craig_bampton(model, modes=modes, frame=frame, keep=Keep(stress=True)))
    scene, tip = clamped(bodies, "rest 1", "rest 2")
    for one in cut.cuts:
        low, high = (bodies[name] for name in one.pieces)
        scene.connect(fm.joint.Fixed(), low.frame(one.name), high.frame(one.name))
    return Part(scene, bodies, tip)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # pairs are kept whole
def test_elastic_cuts():
    """What the cuts alone cost: a rigid one takes the flexibility of some 0.07 depths, an averaged one nearly none.

    The same bricks on both sides; a small load that stays, so that the end goes up and comes down.
    """
    mesh, how = bar(6, (12, 2, 2)), {"t_end": 1.6e-3, "h": 1e-4}
    _, reference = whole(mesh, solid_linear, ELASTIC).pushed(100.0, **how)
    off = {}
    for coupling in fm.Coupling:
        part = in_pieces(mesh, solid_linear, ELASTIC, region=(2, 4), coupling=coupling)
        _, way = part.pushed(100.0, **how)
        off[coupling] = abs(way - reference).max() / abs(reference - reference[0]).max()
    assert off[fm.Coupling.AVERAGED] < 1e-3
    assert 5e-3 < off[fm.Coupling.RIGID] < 3e-2


def push(speed):
    """A push that gives the weight alone a speed."""
    t = np.linspace(0.0, 2.0 * PUSH, 81)
    force = np.where(t < PUSH, 2.0 * WEIGHT * speed / PUSH * np.sin(np.pi * t / PUSH) ** 2, 0.0)
    return fm.Table(np.append(t, [0.05, 1.0]), np.append(force, [0.0, 0.0]))


def test_a_waist_bends_by_thirty_degrees(reference):
    """The bricks of the body that yields, with mean dilatation, are softer by a little than those of the remainders."""
    mesh = bar(10, (20, 1, 2), waist=3)
    part = in_pieces(mesh, hencky_plasticity, PLASTIC, region=(1, 5), coupling=fm.Coupling.AVERAGED)
    text = part.scene.explain()
    assert "beyond rest 1/hinge: rest 1, reduced, no history" in text
    assert "beyond hinge/rest 2: rest 2, reduced, no history" in text
    run, way = part.pushed(push(SPEED), **HOW)
    way_of_whole, turn, work = reference
    assert turn > 30.0
    assert abs(way - way_of_whole).max() < 0.01 * abs(way_of_whole - way_of_whole[0]).max()
    assert run.energies(part.bodies["hinge"])["plastic"][-1] == pytest.approx(work, rel=0.005)
    for name in ("rest 1", "rest 2"):
        history = fm.YieldMonitor(part.bodies[name], yield_stress=YIELD).over(run)
        assert history.first is None
        assert history.largest.utilisation > 0.3


SPEED, HOW = 9.0, {"t_end": 0.024, "h": 6e-4}


@pytest.fixture(scope="module")
def reference():
    """The way of the whole bar's end, its turn and its plastic work."""
    part = whole(bar(10, (20, 1, 2), waist=3), hencky_plasticity, PLASTIC)
    run, way = part.pushed(push(SPEED), **HOW)
    R = run.rotation(part.tip)[-1]
    return way, np.degrees(np.arctan2(R[2, 0], R[0, 0])), run.energies(part.bodies["bar"])["plastic"][-1]


def test_a_remainder_that_yields_is_reported():
    """A cut in the middle of the waist leaves bricks that yield to one of the remainders."""
    part = in_pieces(
        bar(10, (20, 1, 2), waist=3), hencky_plasticity, PLASTIC, region=(1, 3), coupling=fm.Coupling.AVERAGED
    )
    monitors = [fm.YieldMonitor(part.bodies[name], yield_stress=YIELD, clearance=None) for name in ("rest 1", "rest 2")]
    events = [monitor.event(stop=True) for monitor in monitors]
    run, _ = part.pushed(push(SPEED), **HOW, events=events)
    assert run.t[-1] < 0.5 * HOW["t_end"]
    first, second = (monitor.over(run).first for monitor in monitors)
    assert first is None
    assert 3.0 <= second.x[0] / SIDE < 3.6
