"""A part cut in three, each piece a body with a frame of its own, against the part as one body."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, cut_mesh
from flexmbd.forms import solid_linear
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.reduction import Keep, KelvinVoigtDamping, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
SOFT = solid_linear.Parameters(E=2.1e8, nu=0.3, rho=7850.0)
pytestmark = pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # pairs are kept whole

SIDE = 0.02
MODULUS = SIDE**3 / 6.0
ENDS = {"x": (Interface("x_min"), Interface("x_max")), "z": (Interface("z_min"), Interface("z_max"))}


def bar(depths, *, fine=1):
    """A square bar along x, so many sections deep long; bricks."""
    divisions = (fine * depths, 2 * fine, 2 * fine)
    return meshes.block(depths * SIDE, SIDE, SIDE, divisions=divisions, comm=MPI.COMM_SELF)


def reduced(mesh, material, interfaces, *, modes=9, **how):
    model = ContinuumModel(mesh, solid_linear, material, degree=2, interfaces=interfaces)
    return craig_bampton(model, modes=modes, frame=interfaces[0].name, keep=Keep(stress=True), **how)


def in_pieces(mesh, regions, *, coupling, axis="x", soft=(), **how):
    """The cut, and the records of the pieces in their order; each frame lies on the side of the part's start."""
    cut = cut_mesh(mesh, regions)
    first, last = ENDS[axis]
    records = {}
    for name, piece in cut.pieces.items():
        interfaces = cut.interfaces(name, coupling=coupling)
        if first.name in piece.facet_groups:
            interfaces = [first, *interfaces]
        if last.name in piece.facet_groups:
            interfaces = [*interfaces, last]
        records[name] = reduced(piece, SOFT if name in soft else STEEL, interfaces, **how)
    return cut, records


def joined(records, cuts, joint, *, gravity=(0.0, 0.0, 0.0), axis="x"):
    """A scene with the bodies, the first of them jointed to the ground."""
    scene = fm.System(gravity=gravity)
    bodies = {name: scene.add(fm.FlexibleBody(record), name=name) for name, record in records.items()}
    scene.connect(joint, scene.ground.frame(), next(iter(bodies.values())).frame(ENDS[axis][0].name))
    for cut in cuts:
        low, high = cut.pieces
        scene.connect(fm.joint.Fixed(), bodies[low].frame(cut.name), bodies[high].frame(cut.name))
    return scene, bodies


def at_rest(scene, x=None):
    """Stiffness, mass and the forces of a scene that does not move, at a configuration."""
    compiled = scene.compile().scene
    plan, nv = compiled.plan, compiled.nv
    assert len(plan.rows) == 0  # fixed joints at the pieces' own frames need no multipliers
    work, scratch = new_work(plan), new_tangent_work(plan, nv, sizes=np.ones((2, nv)))
    still, none, force = np.zeros(nv), np.zeros(0), np.zeros(nv)
    x = compiled.start.copy() if x is None else x
    matrices = []
    for weights in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        matrices.append(np.zeros((nv, nv)))
        tangent(plan, work, scratch, x, still, still, none, *weights, matrices[-1])
    residual(plan, work, x, still, still, none, force)
    return *matrices, -force, x


def measures(records, cuts):
    """Lowest frequencies and the deflection under a unit force at the end, along z, of the clamped bar."""
    scene, bodies = joined(records, cuts, fm.joint.Fixed())
    end = list(bodies.values())[-1].frame("x_max")
    scene.add_force(fm.force.FrameForce(end, force=(0.0, 0.0, 1.0)))
    K, M, force, _ = at_rest(scene)
    return np.sqrt(scipy.linalg.eigvalsh(K, M)[:4]), force @ np.linalg.solve(K, force)


def thirds(depths):
    return {"hinge": fm.Slab((1.0, 0.0, 0.0), depths * SIDE / 3.0, depths * SIDE * 2.0 / 3.0)}


@pytest.mark.parametrize("depths", [12, 24])
def test_frequencies_and_deflection(depths):
    """A rigid cut takes the flexibility of some 0.07 depths of the bar, an averaged one next to nothing."""
    mesh = bar(depths)
    frequencies, deflection = measures({"bar": reduced(mesh, STEEL, list(ENDS["x"]))}, ())
    found = {}
    for coupling in fm.Coupling:
        cut, records = in_pieces(mesh, thirds(depths), coupling=coupling)
        found[coupling] = measures(records, cut.cuts)
    rigid, averaged = found[fm.Coupling.RIGID], found[fm.Coupling.AVERAGED]
    # (1/3)^2 and (2/3)^2 of the curvature's share, of two cuts
    share = 3.0 * ((1.0 / 3.0) ** 2 + (2.0 / 3.0) ** 2)
    assert (deflection - rigid[1]) / deflection * depths / share == pytest.approx(0.08, abs=0.015)
    assert averaged[1] == pytest.approx(deflection, rel=1e-4)
    assert (rigid[0] > frequencies).all()
    assert rigid[0] == pytest.approx(frequencies, rel=0.1 / depths)
    assert averaged[0][:2] == pytest.approx(frequencies[:2], rel=1e-4)
    assert averaged[0] == pytest.approx(frequencies, rel=1e-3)


@pytest.mark.parametrize("coupling", list(fm.Coupling))
def test_a_depth_from_the_cut_the_stress_is_that_of_the_whole(coupling):
    depths = 9
    mesh = bar(depths, fine=2)
    whole = reduced(mesh, STEEL, list(ENDS["x"]), modes=2)
    cut, records = in_pieces(mesh, thirds(depths), coupling=coupling, modes=2)
    piece = records["rest 2"]
    places = {tuple(np.round(x @ whole.R_MB.T + whole.p_MB_M, 9)): i for i, x in enumerate(whole.stress.x)}
    x = piece.stress.x @ piece.R_MB.T + piece.p_MB_M
    same = [places[tuple(row)] for row in np.round(x, 9)]
    from_cut = x[:, 0] - cut.cuts[1].p[0]
    # tension, shear with bending, torsion, bending; with bricks half as long at most half of it
    wrenches = np.diag([1.0, 0.0, 1.0, 0.02, 0.02, 0.0])[[0, 2, 3, 4]]
    bounds = (0.03,) * 4 if coupling is fm.Coupling.RIGID else (1e-6, 2e-3, 0.01, 1e-6)
    for wrench, bound in zip(wrenches, bounds, strict=True):
        stresses = []
        for record in (whole, piece):
            q = record.interface("x_max").modes.T @ wrench / record.stiffness
            stresses.append(record.stress.sigma @ q)
        error = np.linalg.norm(stresses[1] - stresses[0][same], axis=1)
        size = np.linalg.norm(stresses[0][same], axis=1)[from_cut < 2.0 * SIDE].max()
        watched = (from_cut > SIDE - 1e-9) & (from_cut < 2.0 * SIDE)
        assert error[watched].max() < bound * size
        if coupling is fm.Coupling.RIGID:
            assert error[from_cut < 0.1 * SIDE].max() > 0.5 * size


def test_pendulum():
    """The same swing, and the same stress a depth from the cut, once the jerk of the release has gone."""
    depths, damping = 12, KelvinVoigtDamping(2e-5)
    mesh = bar(depths)
    times = np.linspace(0.0, 0.3, 31)
    cut, records = in_pieces(mesh, thirds(depths), coupling=fm.Coupling.AVERAGED, modes=20, damping=damping)
    alone = {"rest 2": reduced(mesh, STEEL, list(ENDS["x"]), modes=40, damping=damping)}
    tips, utilisations = [], []
    for bodies_of, cuts in ((alone, ()), (records, cut.cuts)):
        scene, bodies = joined(bodies_of, cuts, fm.joint.Revolute("y"), gravity=(0.0, 0.0, -9.81))
        run = scene.simulate(0.3, rtol=1e-6)
        tips.append(run.position(bodies["rest 2"].frame("x_max"), t=times))
        far = (depths * 2.0 / 3.0 + 1.0) * SIDE
        monitor = fm.YieldMonitor(bodies["rest 2"], yield_stress=1e6, where=lambda x, far=far: x[0] > far)
        utilisations.append(monitor.over(run, t=times[3:]).utilisation)
    assert abs(tips[1] - tips[0]).max() < 2e-5 * depths * SIDE
    # of a distributed load the stress converges slowly: 5 % with 8 modes
    assert utilisations[1] == pytest.approx(utilisations[0], rel=0.02)


def bent(records, cuts, moment):
    """The bodies in balance under a moment about y at the end, and a monitor's view of it."""
    x = None
    for load in np.linspace(0.1, 1.0, 10) * moment:
        scene, bodies = joined(records, cuts, fm.joint.Fixed(), axis="z")
        end = list(bodies.values())[-1].frame("z_max")
        scene.add_force(fm.force.FrameForce(end, torque=(0.0, load, 0.0)))
        for _ in range(30):
            K, _, force, x = at_rest(scene, x)
            step = np.linalg.solve(K, force)
            x = x + step
            if abs(step).max() < 1e-12:
                break
    run = scene.simulate(1e-9, rtol=1e-3)
    return dataclasses.replace(run, x=np.tile(x, (len(run.t), 1))), bodies


def test_sixty_degrees():
    """A soft middle, in six pieces of ten degrees each, turns one end by 60 degrees against the other.

    Each piece has its own frame: the stiff ends stay straight, as long as they were, under the stress of the moment
    alone.  Of one body for all a rotation of 60 degrees is a strain.
    """
    soft, layer = [f"soft {i}" for i in range(6)], 4.0 * SIDE
    layers = ["a", "b", *soft, "c", "d"]
    mesh = meshes.block(SIDE, SIDE, 10.0 * layer, divisions=(1, 2, 40), layers=layers, comm=MPI.COMM_SELF)
    angle, middle = np.radians(60.0), 6.0 * layer
    moment = angle * SOFT.E * SIDE**4 / 12.0 / middle
    regions = {name: name for name in soft}
    cut, records = in_pieces(mesh, regions, coupling=fm.Coupling.AVERAGED, axis="z", soft=soft, modes=2)
    assert cut.elastic == ("rest 1", "rest 2")
    run, bodies = bent(records, cut.cuts, moment)
    top, bottom = bodies["rest 2"].frame("z_max"), bodies["rest 2"].frame(cut.cuts[-1].name)
    R = run.rotation(top)[0]
    turned = np.arctan2(R[0, 2], R[2, 2])
    assert turned == pytest.approx(angle, rel=0.05)  # of third order in each piece's ten degrees
    assert np.linalg.norm(run.position(top)[0] - run.position(bottom)[0]) == pytest.approx(2.0 * layer, rel=1e-6)
    arc = middle / turned * np.array([1.0 - np.cos(turned), 0.0, np.sin(turned)]) + [0.0, 0.0, 2.0 * layer]
    straight = arc + 2.0 * layer * np.array([np.sin(turned), 0.0, np.cos(turned)])
    assert np.linalg.norm(run.position(top)[0] - straight) < 0.01 * 10.0 * layer
    for name in ("rest 1", "rest 2"):
        monitor = fm.YieldMonitor(bodies[name], yield_stress=moment / MODULUS, clearance=1.2 * SIDE)
        assert monitor.over(run).largest.utilisation == pytest.approx(1.0, rel=0.01)


def test_from_the_linear_run_to_the_cut():
    """A bar that yields in the middle: the proposed cut leaves remainders that do not."""
    depths, stress = 24, 1e8
    mesh = bar(depths)
    record = reduced(mesh, STEEL, list(ENDS["x"]), geometric_stiffness=False)
    scene = fm.System()
    whole = scene.add(fm.FlexibleBody(record), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), whole.frame("x_min"))
    load = 2.0 * stress * MODULUS / (depths * SIDE)
    slow = fm.Table([0.0, 0.1], [0.0, load])
    scene.add_force(fm.force.FrameForce(whole.frame("x_max"), force=(0.0, 0.0, slow)))
    run = scene.simulate(0.1, rtol=1e-5)
    history = fm.YieldMonitor(whole, yield_stress=stress, clearance=None).over(run)
    (slab,) = fm.yielding_slabs(history)
    # 2 (1 - x / l) > 0.9 and the diagonal, from the clamped end on
    assert slab.cuts == pytest.approx((0.55 * depths * SIDE + np.sqrt(2.0) * SIDE,), abs=SIDE)
    cut, records = in_pieces(mesh, {"hinge": slab}, coupling=fm.Coupling.AVERAGED, geometric_stiffness=False)
    assert list(cut.pieces) == ["hinge", "rest 1"]
    scene, bodies = joined(records, cut.cuts, fm.joint.Fixed())
    scene.add_force(fm.force.FrameForce(bodies["rest 1"].frame("x_max"), force=(0.0, 0.0, slow)))
    again = scene.simulate(0.1, rtol=1e-5)
    remainder = fm.YieldMonitor(bodies["rest 1"], yield_stress=stress, clearance=None).over(again)
    assert remainder.first is None
    assert remainder.largest.utilisation == pytest.approx(2.0 * (1.0 - cut.cuts[0].p[0] / (depths * SIDE)), rel=0.05)
    hinge = fm.YieldMonitor(bodies["hinge"], yield_stress=stress, clearance=None).over(again)
    assert hinge.first.t == pytest.approx(history.first.t, rel=0.01)
