# # A spray boom behind a tractor: finite elements and discrete elements side by side
#
# A field sprayer's boom sprays evenly only where its tips stay level while the wheels run over the ground. Anthonis and
# Ramon (2003, J. Sound Vib. 266, 515-534) derive linear equations of such a machine in two ways: the beams by finite
# elements, or by discrete elements, lumps of mass on a massless beam spring. Their paper has no numbers. Chosen here: a
# tractor of 4 t on two tyres 1.8 m apart, of 400 kN/m and 4 kN s/m each; on its back a boom of steel, 12 m wide, on a
# hinge with a torsion spring and a damper, which let the tractor roll beneath it.
#
# Both booms go into the same machine. It is brought to equilibrium, linearised there, and asked for frequencies and for
# the tip's motion by that of a wheel; then the wheel runs over a bump. `./run python demos/spray_boom.py`; pictures go
# to `out_spray_boom`.

import time
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.beams import DiscreteFrame, discrete_body
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import KelvinVoigtDamping, craig_bampton

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_spray_boom")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The boom
#
# Two arms from a mast, held by stays, and thin ends; x is the way forward, y to the left, z up.

POINTS = {
    "hitch": (0.0, 0.0, 0.0), "left": (0.0, 3.0, 0.0), "right": (0.0, -3.0, 0.0),
    "top": (0.0, 0.0, 0.6), "left tip": (0.0, 6.0, 0.0), "right tip": (0.0, -6.0, 0.0),
}  # fmt: skip
BEAMS = {
    "arms": [("hitch", "left"), ("hitch", "right")],
    "mast": [("hitch", "top")],
    "stays": [("top", "left"), ("top", "right")],
    "ends": [("left", "left tip"), ("right", "right tip")],
}
beam, forward = forms.beam_timoshenko, (1.0, 0.0, 0.0)
arm = beam.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.06, height=0.08, orientation=forward)
rod = beam.Parameters.tube(2.1e11, 0.3, 7850.0, outer_radius=0.015, inner_radius=0.012, orientation=forward)
SECTIONS = {"arms": arm, "mast": arm, "stays": rod, "ends": rod}
ENDS = ("hitch", "left tip", "right tip")
VISCOUS = 1e-3  # s, of Kelvin and Voigt's model


def finite_elements(divisions: int, modes: int | None = None) -> fm.ReducedBody:
    """Timoshenko elements of degree 2; without a number of modes all their coordinates."""
    mesh = meshes.frame(POINTS, BEAMS, divisions=divisions, comm=MPI.COMM_SELF)
    pairs = {group: (beam, section) for group, section in SECTIONS.items()}
    model = ContinuumModel(mesh, pairs, degree=2, interfaces=[Interface(name) for name in ENDS])
    every = model.n_owned - 6 * len(ENDS)
    count = every if modes is None else modes
    damping = KelvinVoigtDamping(VISCOUS)
    return craig_bampton(model, modes=count, frame="hitch", damping=damping, geometric_stiffness=False)


def discrete_elements(divisions: int, modes: int | None = None) -> fm.ReducedBody:
    """Rigid pieces on a massless beam spring; its modes are damped as the material's."""
    frame = DiscreteFrame(POINTS, BEAMS, SECTIONS, divisions=divisions)
    plain = discrete_body(frame, interfaces=ENDS, frame="hitch", modes=modes)
    ratios = np.minimum(0.5 * VISCOUS * np.sqrt(plain.stiffness), 0.9)
    damped = {"damping_ratio": ratios, "damping_held": ["hitch"]}
    return discrete_body(frame, interfaces=ENDS, frame="hitch", modes=modes, **damped)


# ## The machine
#
# What the wheels roll over moves up and down by a prescribed motion, and the tyres stand on it.

RISE, WIDTH = 0.05, 0.4  # m, s: the bump, 64 s^3 (1 - s)^3 of its height
powers = RISE * np.array([-64.0, 192.0, -192.0, 64.0, 0.0, 0.0, 0.0]) / WIDTH ** np.arange(6, -1, -1)
bump = PPoly(np.stack([powers, np.zeros(7)], axis=1), [0.0, WIDTH, 10.0])


@dataclass(frozen=True)
class Sprayer:
    """The machine, the ground's joint under its left wheel, and the frame on the boom's left tip."""

    scene: fm.System
    ground: fm.joint.Connection
    tip: fm.Frame


def sprayer(record: fm.ReducedBody, *, ground: float | PPoly = 0.0, gravity: float = -9.81) -> Sprayer:
    """The tractor with its boom; the ground under the left wheel moves as told."""
    scene = fm.System(gravity=(0.0, 0.0, gravity), team=MpiTeam(comm))
    axle = scene.add(fm.RigidBody(200.0, (50.0, 10.0, 50.0)), name="axle")
    tractor = scene.add(fm.RigidBody(4000.0, (1800.0, 4000.0, 4000.0), (0.0, 0.0, 0.4)), name="tractor")
    boom = scene.add(fm.FlexibleBody(record), name="boom")
    scene.connect(fm.joint.Prismatic("z"), scene.ground.frame((0.0, 0.0, 0.8)), axle.frame(), name="heave")
    scene.connect(fm.joint.Revolute("x"), axle.frame(), tractor.frame(), name="roll")
    tracks = []
    for name, y, motion in (("left", 0.9, ground), ("right", -0.9, 0.0)):
        soil = scene.add(fm.RigidBody(10.0, (1.0, 1.0, 1.0)), name=f"{name} soil")
        track = scene.connect(
            fm.joint.Prismatic("z"), scene.ground.frame((0.0, y, 0.0)), soil.frame(), name=f"{name} track"
        )
        track.prescribe(motion)
        tracks.append(track)
        scene.add_force(fm.force.SpringDamper(soil.frame(), tractor.frame((0.0, y, 0.0)), 4e5, 0.8, 4e3))
    back = tractor.frame((-1.5, 0.0, 0.2))
    hinge = scene.connect(fm.joint.Revolute("x"), back, boom.frame("hitch"), name="hinge")
    scene.add_force(fm.force.JointSpring(hinge, 2500.0, 0.0, 500.0))
    return Sprayer(scene, tracks[0], boom.frame("left tip"))


# ## Its linear equations at rest: frequencies, and the tip's height by the ground's

OMEGA = 2.0 * np.pi * np.geomspace(0.005, 20.0, 800)
COUNT = 8  # frequencies


def linearised(record: fm.ReducedBody) -> tuple[np.ndarray, np.ndarray]:
    """The lowest frequencies (Hz) of what swings, and the left tip's height by the ground's (m/m) at `OMEGA`."""
    it = sprayer(record)
    lin = it.scene.linearize(
        about=it.scene.equilibrium(), disturbances=[it.ground], outputs=[fm.output.Position(it.tip)]
    )
    return np.sort(lin.frequencies())[:COUNT], lin.frequency_response(OMEGA)[:, 2, 0]


# ## Over a bump


def over_the_bump(record: fm.ReducedBody) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (s), the left tip's height (m) and the processor time (s) of a run from level ground, without weight."""
    it = sprayer(record, ground=bump, gravity=0.0)
    method = fm.GeneralizedAlpha(rho=0.9)
    it.scene.simulate(0.01, integrator=method, h=4e-3, rtol=1e-6)  # compiles
    began = time.process_time()
    run = it.scene.simulate(4.0, integrator=method, h=4e-3, rtol=1e-6)
    spent = time.process_time() - began
    return run.t, run.position(it.tip)[:, 2], spent


# ## Both methods, with more and more coordinates
#
# All coordinates at one element a beam, then the 60 lowest modes with the shapes of the ends, then fewer of eight
# elements.
# Errors are against finite elements twelve a beam. Of the bump: the largest difference over the tip's largest way.

exact, bode = linearised(fine := finite_elements(12, modes=60))
times, path, _ = over_the_bump(fine)
say(f"the lowest frequencies, Hz: {np.array2string(exact, precision=3)}")
say()
say("                    elements  coordinates  frequencies  response       bump   run, s")
rows, curves = {}, {}
for method, label in ((discrete_elements, "discrete elements"), (finite_elements, "finite elements")):
    for divisions, modes in ((1, None), (2, 60), (4, 60), (8, 6), (8, 20)):
        body = method(divisions, modes)
        found, response = linearised(body)
        _, moved, spent = over_the_bump(body)
        errors = (
            abs(found / exact - 1.0).max(),
            abs(response - bode).max() / abs(bode).max(),
            abs(moved - path).max() / abs(path).max(),
        )
        rows.setdefault(label, []).append((body.n_modes, *errors, spent))
        curves[label, divisions] = response
        figures = "".join(f"{error:12.1e}" for error in errors)
        say(f"{label:20}{divisions:8d}{body.n_modes:13d}{figures}{spent:9.3f}")
say()
# What very slow ground does follows from statics of two rigid bodies: the tractor on its tyres, the boom on its spring.

K_ROLL, G = 2 * 4e5 * 0.9**2, 9.81
statics = [
    [K_ROLL + 2500.0 - 4000.0 * G * 0.4 - fine.mass * G * 0.2, -2500.0],
    [-2500.0, 2500.0 - fine.mass * G * fine.com[2]],
]
lifted = 0.5 + 6.0 * np.linalg.solve(statics, [4e5 * 0.9, 0.0])[1]

# So does how the boom rolls on its spring, with the moments of inertia of the two about the axle and the hinge.

coupled = fine.mass * 0.2 * fine.com[2]
inertias = [[1800.0 + 4000.0 * 0.4**2 + fine.mass * 0.2**2, coupled], [coupled, fine.gram[2, 2] + fine.gram[3, 3]]]
rolling = np.sqrt(np.linalg.eigvals(np.linalg.solve(inertias, statics)).min()) / (2 * np.pi)
at = OMEGA[abs(bode).argmax()] / (2 * np.pi)
say(
    f"the tip follows the ground most at {at:.2f} Hz, {abs(bode).max():.1f} times; slow ground lifts it by "
    f"{abs(bode[0]):.3f} (rigid bodies in statics {lifted:.3f})"
)
say(f"the boom rolls on its spring at {exact[0]:.5f} Hz (two rigid bodies {rolling:.5f})")

by_finite, by_discrete = (np.array(rows[label]) for label in ("finite elements", "discrete elements"))
assert abs(abs(bode[0]) / lifted - 1.0) < 2e-3
assert abs(exact[0] / rolling - 1.0) < 2e-3
# both come to the same machine, and finite elements sooner
assert by_finite[-1, 1] < by_discrete[-1, 1] < 2e-3
assert by_finite[-1, 3] < by_discrete[-1, 3] < 1e-2
assert (np.diff(by_discrete[:3, 1:4], axis=0) < 0.0).all()
assert (np.diff(by_finite[:3, 1:4], axis=0) < 0.0).all()

# ## Pictures

if root:
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    hertz = OMEGA / (2.0 * np.pi)
    left.loglog(hertz, abs(bode), color="k", label="finite elements, 12 a beam")
    for (label, divisions), response in curves.items():
        if divisions == 1:
            left.loglog(hertz, abs(response), "--", label=f"{label}, 1 a beam")
    left.set(xlabel="frequency, Hz", ylabel="tip by ground, m/m", title="height of the left tip")
    left.legend(fontsize="small")
    for label, table in rows.items():
        table = np.array(table)
        line = middle.semilogy(table[:3, 0], table[:3, 2], "o-", label=label)[0]
        middle.semilogy(table[3:, 0], table[3:, 2], "s--", color=line.get_color(), label=f"{label}, reduced")
        right.semilogy(1e3 * table[:3, 4], table[:3, 3], "o-", color=line.get_color())
        right.semilogy(1e3 * table[3:, 4], table[3:, 3], "s--", color=line.get_color())
    middle.set(xlabel="coordinates of the boom", ylabel="error", title="error of the response")
    middle.set_ylim(top=20.0)
    middle.legend(fontsize="small", loc="upper left")
    right.set(xlabel="run time, ms", ylabel="error", title="error over the bump")
    figure.savefig(out / "both_ways.png", dpi=130)
say(f"in {out}: both_ways.png")
say("all checks passed")
