# # A formulation of one's own: a rotor blade that turns its own pitch
#
# Pull at a tube wound from fibres that all run along right-handed helices, and it twists. In a rotor the pull comes by
# itself, from the speed: such a blade feathers without a hinge or an actuator. No material that flexmbd brings along
# can do this, because the direction of its fibres changes from place to place. So here is the road of someone who
# writes a formulation: the form file, its check, a mesh, a reduction, a record, a machine.
#
# The form is `demos/own_formulation/wound_solid.py`, one file of sixty lines of UFL; docs/writing_a_form.md says how
# to write one. `./run python demos/own_formulation.py` runs all of it; a picture and the record go to
# `out_own_formulation`.

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import quad

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam, check_form, load_form, on_root
from flexmbd.reduction import Keep, ModalDamping, craig_bampton

FORM = Path(__file__).parent / "own_formulation" / "wound_solid.py"
LENGTH, RADIUS, WALL = 1.0, 0.02, 0.0016  # m, of the blade, a tube; the radius is that of the wall's middle
ANGLE = 0.35  # rad, of the fibres to the blade's axis
POD = 0.25  # kg, a sphere at the blade's tip
HUB = 0.1  # m, from the rotor's axis to the blade's root
OMEGA, RAMP, END = 150.0, 1.0, 1.2  # rad/s, s, s

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_own_formulation")
if root:
    out.mkdir(exist_ok=True)


def say(text: str) -> None:
    if root:
        print(text, flush=True)


# ## The check
#
# Before anything is built on it, the form is tried on small meshes: rigid motions, mass, symmetry, tangents, the order
# at which the error falls, finite rotations. `flexmbd check demos/own_formulation/wound_solid.py` prints the same.

sheet = check_form(FORM, comm=comm)
say(sheet.text() + "\n")
assert sheet.passed

# ## From the mesh to the record
#
# Bricks of degree 2, one through the wall. The root is clamped in a rigid socket. The frame at the tip follows its rim
# in the mean, so that the tube may grow thin where it is pulled. The record is written, and what runs in the machine
# is what was read back: this half would run as well where there is no DOLFINx.

form: Any = load_form(FORM)
carbon = form.Parameters(E1=1.35e11, E2=9.0e9, G12=5.0e9, nu12=0.3, nu23=0.4, rho=1600.0, angle=ANGLE)
mesh = meshes.tube(LENGTH, RADIUS + WALL / 2, RADIUS - WALL / 2, h=0.03, cell="hexahedron", degree=2, comm=comm)
tip = Interface("end", coupling=fm.Coupling.AVERAGED)
model = ContinuumModel(mesh, form, carbon, degree=2, interfaces=[Interface("start"), tip])
damping = ModalDamping(0.05, held=["start"])
reduced = craig_bampton(model, modes=40, frame="start", damping=damping, keep=Keep(surface=True))
on_root(comm, lambda: reduced.save(out / "blade.h5"))
blade = fm.ReducedBody.load(out / "blade.h5")
say(f"blade: {model.K.getSize()[0]} degrees of freedom, reduced to {blade.n_modes}; {blade.mass:.4f} kg")

# ## The rotor
#
# Two blades and their pods about a hub whose turn is prescribed: its speed rises as $10 s^3 - 15 s^4 + 6 s^5$ and then
# stays. All joints become joint coordinates: the rotor is a tree.


@fm.compiled
def angle(t):
    s = t / RAMP
    return OMEGA * RAMP * (2.5 * s**4 - 3.0 * s**5 + s**6) if s < 1.0 else OMEGA * (t - 0.5 * RAMP)


@fm.compiled
def speed(t):
    s = t / RAMP
    return OMEGA * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5) if s < 1.0 else OMEGA


@fm.compiled
def acceleration(t):
    s = t / RAMP
    return OMEGA / RAMP * (30.0 * s**2 - 60.0 * s**3 + 30.0 * s**4) if s < 1.0 else 0.0


scene = fm.System(team=MpiTeam(comm))
hub = scene.add(fm.RigidBody(mass=1.0, inertia=(4e-3, 4e-3, 8e-3)), name="hub")
turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame(), name="shaft")
turn.prescribe(fm.Motion(angle, speed, acceleration))
blades = []
for k, side in enumerate((1.0, -1.0)):
    blades.append(scene.add(fm.FlexibleBody(blade), name=f"blade {k + 1}"))
    pod = scene.add(fm.RigidBody(mass=POD, inertia=(1e-4, 1e-4, 1e-4)), name=f"pod {k + 1}")
    socket = hub.frame((side * HUB, 0.0, 0.0), R=np.diag([side, side, 1.0]))
    scene.connect(fm.joint.Fixed(), socket, blades[k].frame("start"), name=f"socket {k + 1}")
    scene.connect(fm.joint.Fixed(), blades[k].frame("end"), pod.frame(), name=f"pod's joint {k + 1}")
say("\n" + scene.explain() + "\n")
run = scene.simulate(END, rtol=1e-4)


def pitch(body: fm.FlexibleBody) -> np.ndarray:
    """Turn (nt,) of the blade's tip about the blade, against its root, rad."""
    return run.q(body) @ blade.interface("end").modes[3]


# ## What theory says
#
# In the wall of a thin tube that is pulled there is a stress $\sigma$ along the axis alone. The lamina answers with a
# stretch and a shear, $\bar S_{11} \sigma$ and $\bar S_{16} \sigma$ (Jones 1999, Mechanics of Composite Materials,
# section 2.6), and the shear turns the sections by $\theta' = \bar S_{16} \sigma / r$ per length. A turned tube is
# held back by the pull itself, whose lines have become helices too: with the shear stress $-\sigma r \theta'$ there is
# no torque, and $\theta' = \bar S_{16} \sigma / (r (1 + \bar S_{66} \sigma))$. That last part is geometric stiffness,
# which nobody wrote into the form: it is the third derivative of its energy.
#
# At a distance $s$ from the root the pull is
# $\sigma A = m \Omega^2 (a + l) + \varrho A \Omega^2 (a (l - s) + (l^2 - s^2) / 2)$.

c, s = np.cos(ANGLE), np.sin(ANGLE)
along, poisson, across, shear = 1 / carbon.E1, -carbon.nu12 / carbon.E1, 1 / carbon.E2, 1 / carbon.G12
S11 = along * c**4 + (2 * poisson + shear) * c**2 * s**2 + across * s**4
S16 = (2 * along - 2 * poisson - shear) * s * c**3 - (2 * across - 2 * poisson - shear) * s**3 * c
S66 = 2 * (2 * along + 2 * across - 4 * poisson - shear) * s**2 * c**2 + shear * (s**4 + c**4)
AREA = 2.0 * np.pi * RADIUS * WALL


def theory(omega: float, at: float = LENGTH, *, stiffens: bool = True) -> float:
    """Turn (rad) of the section at the distance `at` (m) from the root, at a steady speed of the hub (rad/s)."""

    def rate(s: float) -> float:
        own = carbon.rho * (HUB * (LENGTH - s) + (LENGTH**2 - s**2) / 2.0)
        sigma = omega**2 * (POD / AREA * (HUB + LENGTH) + own)
        return S16 * sigma / RADIUS / (1.0 + S66 * sigma if stiffens else 1.0)

    return quad(rate, 0.0, at)[0]


# The record at rest answers to a pull of 1 N by sums over its modes; and clamped it is a beam of the modulus
# $1 / \bar S_{11}$.

rows = blade.interface("end").modes
pulled = rows @ (rows[0] / blade.stiffness)
bending = 3.5160 / (2.0 * np.pi) * np.sqrt(RADIUS**2 / 2.0 / (S11 * carbon.rho * LENGTH**4))
pitches, rates = pitch(blades[0]), run.beta_rate(turn)
steady = np.array([theory(rate) for rate in rates])
table = {
    "mass, kg": (blade.mass, carbon.rho * AREA * LENGTH),
    "stretch by 1 N, nm": (1e9 * pulled[0], 1e9 * S11 * LENGTH / AREA),
    "turn by 1 N, µrad": (1e6 * pulled[3], 1e6 * S16 * LENGTH / (AREA * RADIUS)),
    "first frequency, Hz": (blade.frequencies(clamped=["start"])[0], bending),
    f"pitch at {OMEGA:.0f} rad/s, degrees": (np.degrees(pitches[-1]), np.degrees(theory(OMEGA))),
    "    theory without stiffening": (np.degrees(pitches[-1]), np.degrees(theory(OMEGA, stiffens=False))),
}
say(f"{'':<40}{'flexmbd':>12}{'theory':>12}{'off by':>10}")
for name, (found, expected) in table.items():
    say(f"{name:<40}{found:>12.4f}{expected:>12.4f}{found / expected - 1.0:>10.2%}")
say(f"{run.stats.steps} steps in {run.stats.seconds:.2f} s")

# ## The turn along the blade
#
# The record's surface shows how the sections between root and tip have turned: those near the root, which are pulled
# most, most for their length. The tip's pitch is exact in statics with any number of modes; here they count.

surface = blade.surface
assert surface is not None
moved, x = surface.phi @ run.q(blades[0])[-1], surface.x
turned = (moved[:, 2] * x[:, 1] - moved[:, 1] * x[:, 2]) / (x[:, 1] ** 2 + x[:, 2] ** 2)
stations, place = np.unique(x[:, 0].round(6), return_inverse=True)
profile = np.bincount(place, weights=turned) / np.bincount(place)
expected_profile = np.array([theory(OMEGA, at) for at in stations])

if root:
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(rates, np.degrees(pitches), label="spin-up")
    left.plot(rates, np.degrees(steady), "--", label="a thin tube")
    left.set_xlabel("speed of the hub, rad/s")
    left.set_ylabel("pitch of the tip, degrees")
    right.plot(stations, np.degrees(profile), "o", markersize=4, label=f"at {OMEGA:.0f} rad/s")
    right.plot(stations, np.degrees(expected_profile), "--", color="C1", label="a thin tube")
    right.set_xlabel("distance from the root, m")
    right.set_ylabel("turn of the section, degrees")
    for panel in (left, right):
        panel.grid(color="0.9")
        panel.legend(frameon=False)
    figure.savefig(out / "pitch.png", dpi=130)
say(f"\nin {out}: blade.h5, pitch.png")

# ## Checks
#
# The theory is that of a thin wall: what it leaves out is of the order of the wall's share in the radius, squared.

errors = {name: abs(found / expected - 1.0) for name, (found, expected) in table.items()}
assert all(error < 2e-3 for name, error in errors.items() if "without" not in name)
assert errors["    theory without stiffening"] > 5e-3
assert np.abs(pitches - steady).max() < 5e-3 * np.abs(steady).max()
assert np.abs(profile - expected_profile).max() < 1e-2 * np.abs(steady).max()
assert np.abs(pitches - pitch(blades[1])).max() < 1e-6
say("all checks passed")
