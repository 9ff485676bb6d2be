"""Forward dynamics of a rigid chain and of reduced bodies, beside exudyn's kinematic tree and Pinocchio's ABA.

A chain of N links (0.2 m, square section 0.02 m, 7800 kg/m^3) on hinges about z falls from the horizontal: time of an
explicit Runge-Kutta step of order 4 and of one forward dynamics, in one run on one core, and where the tip is after
1 s.  Then the time of one forward dynamics of a reduced body on a hinge, with and without a child at its tip.

    ./run pip install exudyn pin
    ./run python benchmarks/forward_dynamics.py
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from benchmark import Report

import flexmbd as fm
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody

try:
    import exudyn
except ImportError:
    exudyn = None  # type: ignore[assignment]
try:
    import pinocchio
except ImportError:
    pinocchio = None

MINUTES = 3.0
PEERS: tuple[str, ...] = ("exudyn", "pin")
LENGTH, WIDTH, GRAVITY, STEP = 0.2, 0.02, 9.81, 1e-3
MASS = 7800.0 * LENGTH * WIDTH**2
ACROSS = MASS * (LENGTH**2 + WIDTH**2) / 12.0
INERTIA = np.diag([MASS * WIDTH**2 / 6.0, ACROSS, ACROSS])
NOTHING = np.zeros(0)
# the tip after 1 s, by an independent integration of the planar chain at rtol 1e-12
TIP = {10: (-1.76473832079, -0.92720286516), 50: (7.53368009933, -4.90499985199)}


@entry_kernel
def repeat(count, plan, work, aw, x, v, a, nothing):
    for _ in range(count):
        forward_dynamics(plan, work, aw, x, v, a, nothing)


@entry_kernel
def runge_kutta(steps, h, plan, work, aw, x, v, xs, vs, k, nothing):
    for _ in range(steps):
        forward_dynamics(plan, work, aw, x, v, k[0], nothing)
        for i in range(x.shape[0]):
            xs[i] = x[i] + 0.5 * h * v[i]
            vs[i] = v[i] + 0.5 * h * k[0, i]
        forward_dynamics(plan, work, aw, xs, vs, k[1], nothing)
        for i in range(x.shape[0]):
            xs[i] = x[i] + 0.5 * h * vs[i]
            vs[i] = v[i] + 0.5 * h * k[1, i]
        forward_dynamics(plan, work, aw, xs, vs, k[2], nothing)
        for i in range(x.shape[0]):
            xs[i] = x[i] + h * vs[i]
            vs[i] = v[i] + h * k[2, i]
        forward_dynamics(plan, work, aw, xs, vs, k[3], nothing)
        for i in range(x.shape[0]):
            x[i] += h * v[i] + h * h / 6.0 * (k[0, i] + k[1, i] + k[2, i])
            v[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])


def chain(count):
    scene = fm.System(gravity=(0.0, -GRAVITY, 0.0))
    body: Body = scene.ground
    place = (0.0, 0.0, 0.0)
    for _ in range(count):
        link = scene.add(fm.RigidBody(MASS, INERTIA, (LENGTH / 2.0, 0.0, 0.0)))
        scene.connect(fm.joint.Revolute("z"), body.frame(p=place), link.frame())  # type: ignore[attr-defined]
        body, place = link, (LENGTH, 0.0, 0.0)
    return scene.start().unreduced


def least(function, repeats):
    """The least time (us) of a call; interruptions by other processes only add."""
    function()
    best = np.inf
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - began)
    return best * 1e6


def tip(x):
    angle = np.cumsum(x)
    return LENGTH * np.array([np.cos(angle).sum(), np.sin(angle).sum()])


def measure_chain(count):
    """Forward dynamics, Runge-Kutta step (us), error of the tip after 1 s (m)."""
    compiled = chain(count)
    plan, work, aw = compiled.plan, new_work(compiled.plan), new_articulated_work(compiled.plan)
    x, v, a, xs, vs = np.zeros((5, count))
    k = np.zeros((4, count))
    calls = max(1, 4000 // count)
    dynamics = least(lambda: repeat(calls, plan, work, aw, x, v, a, NOTHING), 300) / calls
    calls = max(1, 1000 // count)
    step = least(lambda: runge_kutta(calls, 1e-9, plan, work, aw, x, v, xs, vs, k, NOTHING), 300) / calls
    error = np.nan
    if count in TIP:
        x[:], v[:] = 0.0, 0.0
        runge_kutta(4000, STEP / 4.0, plan, work, aw, x, v, xs, vs, k, NOTHING)
        error = np.abs(tip(x) - TIP[count]).max()
    return dynamics, step, error


def exudyn_chain(count, steps):
    """Time of a Runge-Kutta step (us) of a kinematic tree, and the error of its tip if it ran 1 s (m)."""
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    zeros = [0.0] * count
    node = mbs.AddNode(
        exudyn.itemInterface.NodeGenericODE2(
            referenceCoordinates=zeros,
            initialCoordinates=zeros,
            initialCoordinates_t=zeros,
            numberOfODE2Coordinates=count,
        )
    )
    turns, offsets, inertias, centres = (
        exudyn.Matrix3DList(), exudyn.Vector3DList(), exudyn.Matrix3DList(), exudyn.Vector3DList()
    )  # fmt: skip
    for i in range(count):
        turns.Append(np.eye(3))
        offsets.Append([LENGTH if i else 0.0, 0.0, 0.0])
        inertias.Append(INERTIA)
        centres.Append([LENGTH / 2.0, 0.0, 0.0])
    mbs.AddObject(
        exudyn.itemInterface.ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exudyn.JointType.RevoluteZ] * count,
            linkParents=np.arange(-1, count - 1),
            jointTransformations=turns,
            jointOffsets=offsets,
            linkInertiasCOM=inertias,
            linkCOMs=centres,
            linkMasses=[MASS] * count,
            gravity=[0.0, -GRAVITY, 0.0],
        )
    )
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = steps * STEP
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.show.statistics = False
    began = time.process_time()  # not the wall's: one long run has no least of many
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)
    seconds = time.process_time() - began
    end = tip(mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates))
    error = np.abs(end - TIP[count]).max() if count in TIP and steps == 1000 else np.nan
    return seconds / steps * 1e6, error


def pinocchio_chain(count):
    """Time of Pinocchio's articulated-body algorithm (us), called from Python."""
    model = pinocchio.Model()
    joint = 0
    for i in range(count):
        place = pinocchio.SE3(np.eye(3), np.array([LENGTH if i else 0.0, 0.0, 0.0]))
        joint = model.addJoint(joint, pinocchio.JointModelRZ(), place, f"j{i}")
        inertia = pinocchio.Inertia(MASS, np.array([LENGTH / 2.0, 0.0, 0.0]), INERTIA)
        model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
    model.gravity.linear[:] = [0.0, -GRAVITY, 0.0]
    data = model.createData()
    q, v, tau = np.zeros((3, count))
    calls = max(1, 2000 // count)

    def call():
        for _ in range(calls):
            pinocchio.aba(model, data, q, v, tau)

    return least(call, 200) / calls


def reduced_body(modes):
    """A body of random particles with mass-orthonormal modes: what a record costs does not depend on its mesh."""
    rng = np.random.default_rng(0)
    count = max(12, modes)
    mass = rng.uniform(0.1, 0.3, count)
    x = rng.standard_normal((count, 3)) * 0.3
    basis = np.linalg.qr(rng.standard_normal((3 * count, modes)))[0] / np.repeat(np.sqrt(mass), 3)[:, None]
    phi = basis.reshape(count, 3, modes)
    fields = np.concatenate([np.ones((1, count)), x.T, phi.transpose(2, 1, 0).reshape(-1, count)])
    tip_modes = rng.standard_normal((6, modes)) * 0.4
    return ReducedBody(
        gram=(fields * mass) @ fields.T,
        stiffness=np.sort(rng.uniform(50.0, 200.0, modes)),
        damping=np.zeros((modes, modes)),
        interfaces=(
            InterfaceFrame("root", np.zeros(3), np.eye(3), np.zeros((6, modes))),
            InterfaceFrame("tip", np.array([0.3, 0.1, 0.0]), np.eye(3), tip_modes),
        ),
        frame="root",
        partition=np.eye(modes),
        partition_names=tuple(f"mode {i}" for i in range(modes)),
    )


def measure_reduced(modes, where):
    """One forward dynamics (us) of a reduced body on a hinge with a rigid child at ``where`` (None: no child)."""
    scene = fm.System(gravity=(0.0, -GRAVITY, 0.0))
    body = scene.add(fm.FlexibleBody(reduced_body(modes)))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("root"))
    if where is not None:
        child = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), (0.1, 0.0, 0.0)))
        scene.connect(fm.joint.Revolute("z"), body.frame(where), child.frame())
    compiled = scene.start().unreduced
    plan, work, aw = compiled.plan, new_work(compiled.plan), new_articulated_work(compiled.plan)
    rng = np.random.default_rng(0)
    x, v, a = rng.standard_normal(compiled.nx) * 0.05, rng.standard_normal(compiled.nv), np.zeros(compiled.nv)
    calls = max(1, 400 // modes)
    return least(lambda: repeat(calls, plan, work, aw, x, v, a, NOTHING), 300) / calls


def quick(report: Report) -> None:
    """The shortest chain and the fewest modes."""
    chains(report, (10,))
    bodies(report, (8,))


def full(report: Report) -> None:
    """To 3000 links and 100 modes."""
    chains(report, (10, 50, 200, 1000, 3000))
    bodies(report, (8, 20, 50, 100))


def chains(report: Report, counts: tuple[int, ...]) -> None:
    """A row for each number of links."""
    report.table(
        "N", "forward dynamics, us", "ns a body", "pin / ours", "RK4 step, us", "exudyn, us", "exudyn / ours",
        "tip's error: ours at h / 4, exudyn's at h, m",
    )  # fmt: skip
    for count in counts:
        dynamics, step, error = measure_chain(count)
        pin = pinocchio_chain(count) if pinocchio and count <= 200 else np.nan
        peer, peer_error = np.nan, np.nan
        if exudyn and count <= 200:
            steps = 1000 if count <= 50 else 20
            peer, peer_error = min(exudyn_chain(count, steps) for _ in range(3))
        report.say(
            f"| {count} | {dynamics:.2f} | {dynamics / count * 1e3:.0f} | {pin / dynamics:.1f} | {step:.2f} | "
            f"{peer:.1f} | {peer / step:.1f} | {error:.1e}, {peer_error:.1e} |"
        )
        name = f"rigid chain, {count}"
        report.beside(name, task="forward dynamics", peer="Pinocchio, ABA from Python", theirs=pin, ours=dynamics)
        report.beside(name, task="a step of RK4", peer="exudyn, kinematic tree", theirs=peer, ours=step)
    report.say()


def bodies(report: Report, numbers: tuple[int, ...]) -> None:
    """A row for each number of modes."""
    report.table(
        "modes", "leaf, us", "child at a frame that is rigid, us", "child at the tip, us", "tip / rigid", "tip / leaf"
    )
    for modes in numbers:
        leaf, rigid, bears = (measure_reduced(modes, where) for where in (None, "root", "tip"))
        times = f"{leaf:.2f} | {rigid:.2f} | {bears:.2f}"
        report.say(f"| {modes} | {times} | {bears / rigid:.2f} | {bears / leaf:.2f} |")


if __name__ == "__main__":
    full(Report(Path("out_forward_dynamics")))
