# # A flexible connecting rod in a slider-crank
#
# A crank of 80 mm turns at 2000 and at 8000 revolutions a minute and drives a piston through a steel connecting rod.
# How far does the piston miss the place where a rigid rod would put it, how much does the rod bend, and how highly is
# it stressed by nothing but its own inertia and the piston's?
#
# The way from the part to the answer is that of every problem here: a gmsh mesh, a UFL form, PETSc matrices, a
# Craig-Bampton reduction, a reduced body in a machine, an integrator, and pictures. It runs as it is on one process,
# `./run python demos/slider_crank.py`, and on several, `./run mpirun -n 2 python demos/slider_crank.py`, which then
# share the mesh. Pictures and a film go to the folder `out_slider_crank`.

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import quad
from scipy.interpolate import CubicSpline, PPoly

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import Keep, ModalDamping, craig_bampton
from flexmbd.visual import plot_stress

CRANK = 0.08  # m
LENGTH = 0.3  # m, of the rod between the pins
SPEEDS = (2000.0, 8000.0)  # revolutions a minute
PISTON = 0.8  # kg
IDLE = 0.2  # of full speed
START_UP, STEADY = 5.0, 1.0  # duration of the start-up and of the rest, in revolutions at full speed
DAMPING = 0.02  # of critical, in every mode of the rod: oil films, and a little the steel

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_slider_crank")
if root:
    out.mkdir(exist_ok=True)


def say(text: str) -> None:
    if root:
        print(text, flush=True)


# ## From the mesh to a reduced body
#
# Second-order tetrahedra follow the curved bores. Both bores become frames of six degrees of freedom on the axes of the
# pins; the body frame sits on the big end, where the crank pin holds the rod, so that no mode moves it. Of the rod are
# left six static shapes of the small end and twelve modes of the rod fixed at both ends.

steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
began = time.perf_counter()
mesh = meshes.connecting_rod(length=LENGTH, h=7e-3, comm=comm)
pins = [Interface("big_end", origin=(0.0, 0.0, 0.0)), Interface("small_end", origin=(LENGTH, 0.0, 0.0))]
model = ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=pins)
meshed = time.perf_counter()
kept = Keep(modes=True, surface=True)
rod = craig_bampton(model, modes=12, frame="big_end", damping=ModalDamping(DAMPING, held=["big_end"]), keep=kept)
reduced = time.perf_counter()

hinged = rod.frequencies({"big_end": ("x", "y", "z", "rx", "ry"), "small_end": ("y", "z", "rx", "ry")})
say(f"rod: {model.K.getSize()[0]} degrees of freedom, reduced to {rod.n_modes}; {rod.mass:.4f} kg")
say(f"     mesh and matrices {meshed - began:.1f} s, reduction {reduced - meshed:.1f} s")
say("     frequencies on its pins: " + ", ".join(f"{f:.0f}" for f in hinged[:4]) + " Hz")

# ## The machine
#
# The crank's angle is prescribed. From idling its speed rises as $10 s^3 - 15 s^4 + 6 s^5$, without a jump up to its
# second derivative, so that the rod hardly rings. The joints up to the piston form a tree and become joint
# coordinates; the cylinder closes the loop, and its side force is among the multipliers.


DARK = "#3c4650"
DISC = fm.Shape.cylinder(0.055, 0.024, at=(-0.02, 0.0, -0.034))
WEB = DISC + fm.Shape.box((0.11, 0.07, 0.024), at=(0.03, 0.0, -0.034))
PIN = fm.Shape.cylinder(0.034, 0.05, at=(CRANK, 0.0, 0.0), colour=DARK)
SHAFT = fm.Shape.cylinder(0.028, 0.05, at=(0.0, 0.0, -0.07), colour=DARK)
CROWN = fm.Shape.cylinder(0.045, 0.035, axis="x", at=(0.05, 0.0, 0.0))
SKIRT = fm.Shape.box((0.07, 0.05, 0.01), at=(0.0, 0.0, -0.022)) + fm.Shape.cylinder(0.0175, 0.04, colour=DARK)
GUIDE = fm.Shape.box((0.17, 0.008, 0.08), at=(0.335, 0.05, 0.0))
LINER = GUIDE + GUIDE.moved((0.0, -0.1, 0.0))


def crank_angle(omega: float, ramp: float, end: float) -> PPoly:
    """Angle (rad) over time (s): up to the speed omega (rad/s) at the time `ramp`."""
    rise = (1.0 - IDLE) * np.array([6.0 / ramp**5, -15.0 / ramp**4, 10.0 / ramp**3, 0.0, 0.0, 0.0])
    rise[-1] = IDLE
    steady = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return PPoly(omega * np.column_stack([rise, steady]), [0.0, ramp, end]).antiderivative()


@dataclass
class Case:
    """A run of the machine, and what to ask it for."""

    run: fm.Trajectory
    angle: PPoly
    omega: float
    drive: fm.joint.Connection
    conrod: Any  # a RigidBody or a FlexibleBody
    piston: fm.RigidBody

    @property
    def turn(self) -> float:
        """Time of a revolution at full speed, s."""
        return 2.0 * np.pi / self.omega

    @property
    def last_turn(self) -> np.ndarray:
        """(nt,) which instants belong to the last revolution."""
        return self.run.t >= self.run.t[-1] - self.turn

    def last_angles(self) -> np.ndarray:
        """Crank angles (rad) of these instants, from 0 to 2 pi: the start-up is three whole revolutions."""
        return self.angle(self.run.t[self.last_turn]) - self.angle(self.run.t[-1] - self.turn)


def simulate(speed: float, *, flexible: bool) -> Case:
    omega = speed * 2.0 * np.pi / 60.0
    turn = 2.0 * np.pi / omega
    scene = fm.System(gravity=(0.0, -9.81, 0.0), team=MpiTeam(comm))
    crank = scene.add(fm.RigidBody(mass=1.5, inertia=(1e-3, 3e-3, 3e-3), com=(0.02, 0.0, 0.0)), name="crank")
    crank.shape = WEB + PIN + SHAFT  # for pictures
    conrod: Any
    if flexible:
        conrod = scene.add(fm.FlexibleBody(rod), name="conrod")
        big, small = conrod.frame("big_end"), conrod.frame("small_end")
    else:
        conrod = scene.add(fm.RigidBody(mass=rod.mass, inertia=rod.inertia, com=tuple(rod.com)), name="conrod")
        big, small = conrod.frame(), conrod.frame((LENGTH, 0.0, 0.0))
    piston = scene.add(fm.RigidBody(mass=PISTON, inertia=(5e-4, 5e-4, 5e-4)), name="piston")
    piston.shape, scene.ground.shape = CROWN + SKIRT, LINER
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame(), name="main bearing")
    scene.connect(fm.joint.Revolute("z"), crank.frame((CRANK, 0.0, 0.0)), big, name="crank pin")
    scene.connect(fm.joint.Revolute("z"), small, piston.frame(), name="piston pin")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="cylinder")
    angle = crank_angle(omega, START_UP * turn, (START_UP + STEADY) * turn)
    drive.prescribe(angle)
    # many small steps, for the work of the drive is summed over them below
    method = fm.GeneralizedAlpha()
    if flexible and speed == SPEEDS[0]:
        say("\n" + scene.explain(integrator=method) + "\n")
    run = scene.simulate((START_UP + STEADY) * turn, rtol=1e-4 if flexible else 1e-6, integrator=method)
    return Case(run, angle, omega, drive, conrod, piston)


cases = {(speed, flexible): simulate(speed, flexible=flexible) for speed in SPEEDS for flexible in (False, True)}

# ## What a rigid rod would do
#
# With the crank at the angle $a$ the piston is at $x = r \cos a + \sqrt{l^2 - r^2 \sin^2 a}$.


def piston_position(a: np.ndarray) -> np.ndarray:
    """Position (m) of the piston at the crank angle a (rad)."""
    return CRANK * np.cos(a) + np.sqrt(LENGTH**2 - (CRANK * np.sin(a)) ** 2)


def piston_deviation(case: Case) -> np.ndarray:
    """How far (m) the piston is from there over the whole run."""
    return case.run.position(case.piston.frame())[:, 0] - piston_position(case.angle(case.run.t))


# ## How far the rod bends
#
# The lateral displacement of the shank's middle from the line between the pins is linear in the modal coordinates.
#
# For comparison, a beam: at a steady speed every point of a rigid rod has an acceleration that is linear along it, so
# the rod is loaded across by $-\varrho A a_n(\xi)$, a trapezium. Of a hinged beam only the symmetric part of that load,
# $-\varrho A a_n(l/2)$, moves the middle: by $w = -5 \varrho A a_n l^4 / (384 E I)$, with $I/A = b^2/12$. The eyes,
# a quarter of the length and far stiffer than the shank, will make the rod bend less.

WIDTH, THICKNESS = 0.037, 0.016  # m, of the shank in the middle


def bending_row() -> np.ndarray:
    """(n,) lateral deflection (m) of the middle per unit of each modal coordinate."""
    surface = rod.surface
    assert surface is not None
    middle = np.abs(surface.x[:, 0] - LENGTH / 2.0) < 0.01
    share = surface.x[middle, 0].mean() / LENGTH
    return surface.phi[middle, 1].mean(axis=0) - share * rod.interface("small_end").modes[1]


def deflection(case: Case) -> np.ndarray:
    """Lateral deflection (m) of the rod's middle over the whole run."""
    return case.run.q(case.conrod) @ bending_row()


def lateral_acceleration(a: np.ndarray, omega: float) -> np.ndarray:
    """Acceleration (m/s^2) of a rigid rod's middle across the rod."""
    reach = np.sqrt(LENGTH**2 - (CRANK * np.sin(a)) ** 2)
    along = CRANK**2 * np.cos(2.0 * a) / reach + CRANK**4 * np.sin(2.0 * a) ** 2 / (4.0 * reach**3)
    piston = -(omega**2) * (CRANK * np.cos(a) + along)
    pin_x, pin_y = -CRANK * omega**2 * np.cos(a), -CRANK * omega**2 * np.sin(a)
    return (0.5 * (pin_x + piston) * CRANK * np.sin(a) + 0.5 * pin_y * reach) / LENGTH


def beam_deflection(a: np.ndarray, omega: float) -> np.ndarray:
    """Lateral deflection (m) of the middle of a hinged beam under its own inertia."""
    return -60.0 * steel.rho * LENGTH**4 * lateral_acceleration(a, omega) / (384.0 * steel.E * WIDTH**2)


# ## Forces and energy


def side_force(case: Case) -> np.ndarray:
    """Force (N) of the cylinder across the piston, over the whole run."""
    rows = [k for k, name in enumerate(case.run.scene.row_names) if "translation" in name]
    return np.linalg.norm(case.run.multipliers[:, rows], axis=1)


def energy_error(case: Case) -> float:
    """What is missing between the drive's work, the losses and the energy; a share of the largest energy."""
    run = case.run
    power = run.drive(case.drive) * run.beta_rate(case.drive)
    if isinstance(case.conrod, fm.FlexibleBody):
        rates = run.q_rate(case.conrod)
        power = power - np.einsum("ti,ij,tj->t", rates, rod.damping, rates)
    work = CubicSpline(run.t, power).antiderivative()(run.t)
    total = run.energy().total
    return float(np.abs(total - total[0] - work).max() / np.abs(total).max())


# ## The stress, and when it is largest


def worst_stress(case: Case) -> tuple[float, fm.StressField]:
    """Time (s) and field of the largest von Mises stress in the last revolution. Collective."""
    times = case.run.t[-1] - case.turn * np.linspace(1.0, 0.0, 49)
    peaks = [case.run.stress(case.conrod, model, t=t).max for t in times]
    worst = float(times[np.argmax(peaks)])
    return worst, case.run.stress(case.conrod, model, t=worst)


stresses = {speed: worst_stress(cases[speed, True]) for speed in SPEEDS}

# ## Results


def row(title: str, values: list[str]) -> str:
    return f"{title:<44}" + "".join(f"{value:>16}" for value in values)


def peak(values: np.ndarray, case: Case) -> float:
    return float(np.abs(values[case.last_turn]).max())


table = {
    "piston off a rigid rod's, µm": [f"{1e6 * peak(piston_deviation(c), c):.4f}" for c in cases.values()],
    "deflection of the rod's middle, mm": [
        f"{1e3 * peak(deflection(c), c):.4f}" if flexible else "-" for (_, flexible), c in cases.items()
    ],
    "first frequency on the pins, Hz": [f"{hinged[0]:.1f}" if flexible else "-" for _, flexible in cases],
    "largest von Mises stress, MPa": [
        f"{1e-6 * stresses[speed][1].max:.1f}" if flexible else "-" for speed, flexible in cases
    ],
    "side force in the cylinder, kN": [f"{1e-3 * peak(side_force(c), c):.3f}" for c in cases.values()],
    "energy at the end, J": [f"{c.run.energy().total[-1]:.2f}" for c in cases.values()],
    "energy not accounted for, relative": [f"{energy_error(c):.1e}" for c in cases.values()],
    "steps (rejected)": [f"{c.run.stats.steps} ({c.run.stats.rejected})" for c in cases.values()],
    "wall time, s": [f"{c.run.stats.seconds:.2f}" for c in cases.values()],
}
say(row("last revolution", [f"{speed:.0f} {'flexible' if flexible else 'rigid'}" for speed, flexible in cases]))
for title, values in table.items():
    say(row(title, values))

# ## Pictures

fast = cases[SPEEDS[-1], True]
if root:
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for speed in SPEEDS:
        case, rigid = cases[speed, True], cases[speed, False]
        turned = np.degrees(case.last_angles())
        (line,) = axes[0].plot(turned, 1e6 * piston_deviation(case)[case.last_turn], label=f"{speed:.0f} rpm")
        look = {"color": line.get_color(), "linestyle": "--"}
        axes[1].plot(turned, 1e3 * deflection(case)[case.last_turn], label=f"{speed:.0f} rpm")
        axes[1].plot(turned, 1e3 * beam_deflection(case.last_angles(), case.omega), label="a beam", **look)
        axes[2].plot(turned, 1e-3 * side_force(case)[case.last_turn], label=f"{speed:.0f} rpm")
        axes[2].plot(np.degrees(rigid.last_angles()), 1e-3 * side_force(rigid)[rigid.last_turn], label="rigid", **look)
    axes[0].set_ylabel("piston beyond a rigid rod's, µm")
    axes[1].set_ylabel("deflection of the rod's middle, mm")
    axes[2].set_ylabel("side force in the cylinder, kN")
    axes[2].set_xlabel("crank angle in degrees")
    axes[2].set_xticks(range(0, 361, 45))
    for panel in axes:
        panel.grid(color="0.9")
        panel.legend(frameon=False)
    figure.savefig(out / "slider_crank.png", dpi=130)
    worst, picture = stresses[SPEEDS[-1]]
    degrees = float(np.degrees(fast.angle(worst)) % 360.0)
    title = f"{SPEEDS[-1]:.0f} rpm, crank at {degrees:.0f} degrees"
    plot_stress(picture, out / "stress.png", amplification=10.0, title=title)

fast.run.animate(
    out / "slider_crank.mp4",
    between=(fast.run.t[-1] - fast.turn, fast.run.t[-1]),
    slow_motion=5.0 / fast.turn,
    size=(960, 540),
    amplification=20.0,
    models={fast.conrod: model},
    view=(0.15, 0.2, 1.0),
)
say(f"\nin {out}: slider_crank.png, stress.png, slider_crank.mp4")

# ## Checks
#
# Each figure is held against one that comes from elsewhere. With a rigid rod the piston's motion is the closed form.

for speed in SPEEDS:
    assert np.abs(piston_deviation(cases[speed, False])).max() < 1e-8 * 2.0 * CRANK

# The rod's mass follows from its drawing: two rings, and between them a plate that tapers from 44 to 30 mm.


def drawn_mass() -> float:
    (big_bore, big), (small_bore, small), depth = (0.035, 0.048), (0.018, 0.028), 0.028

    def beside_eyes(x: float) -> float:
        """Half of the plate's width at x, as far as it lies outside of both eyes."""
        eye = max(big**2 - x**2, small**2 - (LENGTH - x) ** 2, 0.0) ** 0.5
        return max(0.022 - 0.007 * x / LENGTH - eye, 0.0)

    plate = 2.0 * THICKNESS * quad(beside_eyes, 0.03, LENGTH - 0.02, points=(big, LENGTH - small), limit=200)[0]
    rings = np.pi * depth * (big**2 - big_bore**2 + small**2 - small_bore**2)
    return steel.rho * (plate + rings)


assert abs(rod.mass / drawn_mass() - 1.0) < 1e-4

# A hinged beam's first frequency is $\pi b / (2 l^2) \sqrt{E / (12 \varrho)}$. The eyes are stiff, which raises it, and
# heavy, which lowers it.

beam_frequency = 0.5 * np.pi * WIDTH / LENGTH**2 * np.sqrt(steel.E / (12.0 * steel.rho))
assert 0.8 < hinged[0] / beam_frequency < 1.1

# At 2000 rpm the rod bends nearly as the beam does; at 8000 rpm sixteen times as much, and a little more, since the
# harmonics of 133 Hz come nearer to the first frequency. Its largest stress is about that of the beam's bending,
# $6 M / (A b)$ with $M = \varrho A a_n l^2 / 8$, and not half as much again with what pulls along the rod.

angles = np.linspace(0.0, 2.0 * np.pi, 721)
bent = {speed: peak(deflection(cases[speed, True]), cases[speed, True]) for speed in SPEEDS}
for speed in SPEEDS:
    omega = cases[speed, True].omega
    assert 0.8 < bent[speed] / np.abs(beam_deflection(angles, omega)).max() < 1.1
    bending = 0.75 * steel.rho * np.abs(lateral_acceleration(angles, omega)).max() * LENGTH**2 / WIDTH
    assert 0.8 < stresses[speed][1].max / bending < 1.5
assert 1.0 < bent[8000.0] / bent[2000.0] / 16.0 < 1.15

# What the drive puts in is found again as energy, or lost in the damping.

assert all(energy_error(case) < 1e-3 for case in cases.values())
say("all checks passed")
