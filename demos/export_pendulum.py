# # A pendulum in every program that is at hand
#
# A bar of soft rubber hangs from a hinge and is pushed, so hard that it swings over the horizontal and bends by four
# per cent of its length. One reduced body is made of it, and moves here, in Exudyn, in MBDyn and as an FMU in FMPy:
# in each of them that is installed, by the files and helpers of `fm.export`. Then their paths are laid over each other,
# and what lies between them is measured.
#
# `./run python demos/export_pendulum.py`; the picture and all files go to `out_export_pendulum`.

import importlib.util
import shutil
import subprocess
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import Keep, craig_bampton

LENGTH = 1.0  # m
RATE, END = 5.5, 0.8  # rad/s at the start, s
TIMES = np.linspace(0.0, END, 81)  # when the tip is looked at

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_export_pendulum")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The body
#
# Its body frame floats (`frame=None`), for which MBDyn's iteration converges however much the bar bends. Few modes, so
# that each program's steps resolve the fastest. What they do not know is how a body grows
# stiffer by being stretched; the same pendulum with it runs here for comparison.

rubber = forms.solid_linear.Parameters(E=1.3e7, nu=0.3, rho=1100.0)
mesh = meshes.block(LENGTH, 0.04, 0.06, divisions=(10, 1, 1), comm=comm)
model = ContinuumModel(mesh, forms.solid_linear, rubber, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
bar = craig_bampton(model, modes=4, frame=None, geometric_stiffness=False, keep=Keep(modes=True, surface=True))
stretched = craig_bampton(model, modes=4, frame=None)
say(f"bar: {model.K.getSize()[0]} degrees of freedom, reduced to {bar.n_modes}; {bar.mass:.3f} kg")
say(f"     frequencies with its start held: {', '.join(f'{f:.2f}' for f in bar.frequencies(['x_min'])[:4])} Hz")


@dataclass(frozen=True)
class Found:
    """Positions (81, 3) m of the bar's tip, in the body frame of the hanging bar, and what they took (s)."""

    tip: np.ndarray
    seconds: float


# ## Here
#
# `mbdyn_deck` writes a ready input for MBDyn, and says what is in it: the hinge's axis through the start of the bar,
# gravity along it, so that it hangs, and an angular velocity. The world's axes and origin are those of the body
# frame at the start. The same numbers make the machine here.

if root:
    fm.export.mbdyn(bar, out / "bar.fem")
    pendulum = fm.export.mbdyn_deck(bar, out / "bar.fem", out / "bar.mbd", hinge="x_min", rate=RATE, end=END, step=2e-4)
    start = bar.interface("x_min").p_BI_B
    say("written: bar.fem and bar.mbd for MBDyn, " + ", ".join(f"node {k} is {n}" for n, k in pendulum.nodes.items()))


def machine(body: fm.ReducedBody) -> tuple[fm.System, fm.FlexibleBody]:
    scene = fm.System(gravity=tuple(pendulum.gravity))
    link = scene.add(fm.FlexibleBody(body), name="bar")
    hinge = scene.connect(fm.joint.Revolute(tuple(pendulum.axis)), scene.ground.frame(p=start), link.frame("x_min"))
    hinge.velocity = pendulum.rate
    return scene, link


def here(body: fm.ReducedBody) -> tuple[Found, float]:
    """The exact path, by tight tolerances, and by how much the tip was bent away from the bar."""
    scene, link = machine(body)
    began = time.perf_counter()
    run = scene.simulate(END, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    seconds = time.perf_counter() - began
    # in the axes of the bar's start, along which the undeformed bar lies
    line = np.einsum("tji,tj->ti", run.rotation(link.frame("x_min")), run.position(link.frame("x_max")) - start)
    bend = np.linalg.norm(line[:, 1:], axis=1).max()
    return Found(run.position(link.frame("x_max"), t=TIMES), seconds), float(bend)


# ## Exudyn
#
# The file has the arrays that Exudyn would compute of a finite element model. `add_to_exudyn` adds the body with
# markers at its frames and lets weight act where the bent body has its centre of mass. The error of its
# integrator goes with the square of the step, so two runs give the limit.


def in_exudyn() -> Found:
    import exudyn
    from exudyn import itemInterface as item

    warnings.simplefilter("ignore", DeprecationWarning)  # some of its settings have newer names
    fm.export.exudyn(bar, out / "bar.npz")

    def tip(h: float) -> np.ndarray:
        mbs = exudyn.SystemContainer().AddSystem()
        added = fm.export.add_to_exudyn(
            mbs,
            out / "bar.npz",
            gravity=tuple(pendulum.gravity),
            velocity=tuple(np.cross(pendulum.rate * pendulum.axis, -start)),
            angular_velocity=tuple(pendulum.rate * pendulum.axis),
        )
        ground = mbs.AddMarker(
            item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround(referencePosition=start)))
        )
        free = [int(abs(part) < 0.5) for part in pendulum.axis]  # the hinge turns about one of the axes
        mbs.AddObject(
            item.GenericJoint(markerNumbers=[ground, added.markers["x_min"]], constrainedAxes=[1, 1, 1, *free])
        )
        kind = exudyn.OutputVariableType.Position
        sensor = mbs.AddSensor(
            item.SensorMarker(
                markerNumber=added.markers["x_max"], outputVariableType=kind, storeInternal=True, writeToFile=False
            )
        )
        mbs.Assemble()
        settings = exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps, integration.endTime, integration.verboseMode = round(END / h), END, 0
        integration.newton.relativeTolerance = integration.newton.absoluteTolerance = 1e-10
        settings.solutionSettings.writeSolutionToFile = False  # type: ignore[attr-defined]
        settings.solutionSettings.sensorsWritePeriod = END / (len(TIMES) - 1)  # type: ignore[attr-defined]
        mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
        return np.array(mbs.GetSensorStoredData(sensor))[:, 1:]

    began = time.perf_counter()
    coarse, fine = tip(1.25e-4), tip(6.25e-5)
    return Found((4.0 * fine - coarse) / 3.0, time.perf_counter() - began)


# ## MBDyn
#
# It runs the deck as it is, at two steps.


def in_mbdyn() -> Found:
    def tip(h: float) -> np.ndarray:
        fm.export.mbdyn_deck(bar, out / "bar.fem", out / "bar.mbd", hinge="x_min", rate=RATE, end=END, step=h)
        subprocess.run(["mbdyn", "-s", "-f", "bar.mbd", "-o", "mbdyn"], cwd=out, check=True, stdout=subprocess.DEVNULL)
        rows = np.loadtxt(out / "mbdyn.mov")
        rows = rows[rows[:, 0] == pendulum.nodes["x_max"], 1:4]
        return rows[:: round(END / (len(TIMES) - 1) / h)]

    began = time.perf_counter()
    coarse, fine = tip(2e-4), tip(1e-4)
    return Found((4.0 * fine - coarse) / 3.0, time.perf_counter() - began)


# ## An FMU
#
# An FMU of a reduced body knows small motions alone, but the whole machine goes into one as well: its compiled steps
# become a library that FMPy, Simulink or Dymola load, without Python.


def in_fmpy() -> Found:
    from fmpy import simulate_fmu

    scene, link = machine(bar)
    fm.export.fmu_machine(scene, out / "pendulum.fmu", h=2e-4, outputs={"tip": fm.output.Position(link.frame("x_max"))})
    began = time.perf_counter()
    found = simulate_fmu(str(out / "pendulum.fmu"), stop_time=END, output_interval=END / (len(TIMES) - 1))
    return Found(np.array([found[f"tip.{axis}"] for axis in "xyz"]).T, time.perf_counter() - began)


# ## All of them
#
# How far each is off the path here, and may be. MBDyn begins without solving for the first accelerations, which
# shifts the bar's small vibration along itself by a part of a step.


@dataclass(frozen=True)
class Client:
    """A program, how it runs the pendulum, whether it is here, and how far (m) it may be off."""

    name: str
    run: Callable[[], Found]
    there: bool
    off: float


def has(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


clients = (
    Client("Exudyn", in_exudyn, has("exudyn"), 1e-6),
    Client("MBDyn", in_mbdyn, shutil.which("mbdyn") is not None, 1e-4),
    Client("FMPy", in_fmpy, has("fmpy") and shutil.which("gcc") is not None, 1e-6),
)

if root:
    exact, bend = here(bar)
    with_stretch, _ = here(stretched)
    say(f"\nthe tip is bent away from the bar by up to {bend:.3f} m\n")
    say(f"{'program':<18}{'off, m':>10}{'seconds':>10}")
    say(f"{'here':<18}{'-':>10}{exact.seconds:>10.2f}")
    paths = {}
    for client in clients:
        if not client.there:
            say(f"{client.name:<18}{'not installed':>20}")
            continue
        found = paths[client.name] = client.run()
        off = np.abs(found.tip - exact.tip).max()
        say(f"{client.name:<18}{off:>10.1e}{found.seconds:>10.2f}")
        assert off < client.off
    loss = np.abs(with_stretch.tip - exact.tip).max()
    say(f"{'here, stretched':<18}{loss:>10.1e}{with_stretch.seconds:>10.2f}")
    say("the last is what the others cannot know: how stretch and weight make the bar stiffer and shorter")

    # The picture: the tip's path, seen along the hinge, and how far each is off over time.

    across = np.cross(pendulum.axis, pendulum.gravity / np.linalg.norm(pendulum.gravity))
    plane = np.array([across, -pendulum.gravity / np.linalg.norm(pendulum.gravity)])
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(*((exact.tip - start) @ plane.T).T, color="0.8", lw=6, label="flexmbd")
    left.plot(*((with_stretch.tip - start) @ plane.T).T, color="0.5", ls="--", lw=1, label="flexmbd, with stretch")
    for (name, found), mark in zip(paths.items(), ".x+", strict=False):
        left.plot(*((found.tip - start) @ plane.T).T, mark, ms=4, label=name)
        right.semilogy(TIMES[1:], np.linalg.norm(found.tip - exact.tip, axis=1)[1:], label=name)
    left.plot(0.0, 0.0, "ko", ms=4)
    left.set(aspect="equal", xlabel="across, m", ylabel="up, m", title="the tip of the bar")
    right.set(xlabel="time, s", ylabel="m", title="off flexmbd's path")
    for axes in (left, right)[: 2 if paths else 1]:
        axes.legend(frameon=False)
        axes.grid(color="0.9")
    figure.savefig(out / "export_pendulum.png", dpi=140)
    say(f"\nin {out}: export_pendulum.png, and the files that the programs read")

    assert bend > 0.04 * LENGTH
    assert np.allclose(exact.tip[0] - start, [LENGTH, 0.0, 0.0])

# The round trip: what MBDyn and Exudyn read is the body that was written.

if root:
    fm.export.exudyn(bar, out / "bar.npz")
    for back in (fm.export.read_exudyn(out / "bar.npz"), fm.export.read_mbdyn(out / "bar.fem")):
        assert np.allclose(back.frequencies(), bar.frequencies(), rtol=1e-9)
        assert abs(back.mass / bar.mass - 1.0) < 1e-12
    say("all checks passed")
