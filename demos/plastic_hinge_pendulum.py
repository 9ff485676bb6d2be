# # A rod with a tip mass swings into a stop and keeps a bend
#
# A hinged steel rod with a heavy tip meets a stop at its root. The root stands still; the tip mass goes on and bends
# the rod in a plastic hinge there, until its energy is spent. With a rigid, perfectly plastic rod (Parkes 1955) the
# bend would be
#
#     theta = G v^2 / (2 Mp),    Mp = sigma_y b h^2 / 4
#
# for a tip mass G of velocity v. The rod here is a mesh of bricks in the machine: an elasto-plastic solid of finite
# strain between two rigid frames, one on the hinge, one with the tip mass. Nothing tells it where to yield.
#
# `./run python demos/plastic_hinge_pendulum.py`; picture and recorded fields go to `out_plastic_hinge_pendulum`.
# `--film` makes a film, coloured by plastic strain.

import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ImplicitContinuum, Interface, MpiTeam, NonlinearModel

LENGTH, SIDE = 0.2, 0.02  # m
TIP, SPEED = 8.0, 8.0  # kg, m/s
YIELD, MODULUS = 250e6, 210e9  # Pa
DENSITY = 7850.0  # kg/m^3
START = np.radians(2.0)  # before the stop
END = 0.034  # s

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_plastic_hinge_pendulum")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The rod
#
# Bricks, four over the height; where the hinge is the solution finds. The means of cells keep them from locking.

steel = forms.hencky_plasticity.Parameters(
    E=MODULUS, nu=0.3, rho=DENSITY, yield_stress=YIELD, hardening=forms.j2_plasticity.LinearHardening(50e6)
)
mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(20, 1, 4), comm=comm)
ends = [Interface("x_min"), Interface("x_max")]
solid = NonlinearModel(mesh, forms.hencky_plasticity, steel, degree=1, interfaces=ends)
ball = fm.RigidBody(TIP, 0.4 * TIP * 0.04**2 * np.ones(3))
rod = fm.ContinuumBody(ImplicitContinuum(solid, rigid_parts={"x_max": ball}))

scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(comm))
scene.add(rod, name="rod")
hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), rod.frame("x_min"), name="hinge")
tip = rod.frame("x_max")
scene.add_force(fm.force.JointStop(hinge, lower=-10.0, upper=START, stiffness=2e5, transition=1e-3))
hinge.velocity = SPEED / LENGTH
say(scene.explain())
say()

# ## The swing

recording = fm.Recording(out / "fields.h5", every=END / 100)
run = scene.simulate(END, integrator=fm.GeneralizedAlpha(rho=0.9), rtol=5e-3, recording=recording)
say(f"{run.stats.steps} steps, {run.stats.iterations} iterations, {run.stats.seconds:.1f} s")
say()

# ## The account

parts, machine = run.energies(rod), run.energy()
kinetic = parts["kinetic"] + machine.kinetic
weight = parts["gravitational"] + machine.gravitational
total = kinetic + weight + parts["elastic"] + parts["plastic"] + machine.spring
say("energies, J     start       end")
for name, series in (
    ("kinetic", kinetic),
    ("weight", weight - weight[0]),
    ("elastic", parts["elastic"] + machine.spring),
    ("plastic", parts["plastic"]),
    ("sum", total - weight[0]),
):
    say(f"{name:12s}{series[0]:9.2f}{series[-1]:10.2f}")
lost = abs(total - total[0]).max() / kinetic[0]
say(f"largest change of the sum: {100 * lost:.2f} % of the kinetic energy at the start")
say()

# ## The bend, and Parkes' bound
#
# All that the tip had and the rod gave it, less what is left, went into the hinge.

R_tip, R_root = run.rotation(tip), run.rotation(rod.frame("x_min"))
bend = np.array([np.arctan2(-(a.T @ b)[2, 0], (a.T @ b)[0, 0]) for a, b in zip(R_root, R_tip, strict=True)])
moment = YIELD * SIDE**3 / 4
bound = TIP * SPEED**2 / (2 * moment)
per_angle = parts["plastic"][-1] / moment
most, last = np.degrees(bend.max()), np.degrees(bend[-1])
say(f"plastic moment {moment:.0f} N m; bend {most:.1f} degrees at most, {last:.1f} at the end")
alone, spent = np.degrees(bound), np.degrees(per_angle)
say(f"Parkes for the tip alone {alone:.1f} degrees; dissipated over plastic moment {spent:.1f}")

assert lost < 0.01
assert parts["plastic"][-1] < kinetic[0] + weight[0] - weight[-1] + 0.01 * kinetic[0]
# what yields is the hinge: within two heights of the root, and nothing else
fields = run.recorded(rod)
strain, place = fields.values("plastic_strain", row=-1), fields.mesh.x[:, 0]
say(f"plastic strain up to {strain.max():.3f}, {1e3 * place[strain.argmax()]:.0f} mm from the hinge's axis; "
    f"beyond two heights {strain[place > 2 * SIDE].max():.0e}")  # fmt: skip
assert strain[place > 2 * SIDE].max() < 0.1 * strain.max()
# the hinge hardens, its end is clamped, and bricks of this size are too stiff in bending by some 10 %
assert 1.0 < parts["plastic"][-1] / (moment * bend[-1]) < 1.2

if root:
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for label, series in (("kinetic", kinetic), ("elastic", parts["elastic"]), ("plastic", parts["plastic"])):
        left.plot(1e3 * run.t, series, label=label)
    left.set(xlabel="time, ms", ylabel="energy, J")
    left.legend()
    right.plot(1e3 * run.t, np.degrees(bend), label="bend of the rod")
    right.axhline(np.degrees(per_angle), color="0.5", linestyle="--", label="dissipated / plastic moment")
    right.set(xlabel="time, ms", ylabel="degrees")
    right.legend()
    figure.savefig(out / "bend.png", dpi=150)
FILM = "--film" in sys.argv
if FILM:
    run.animate(out / "hinge.mp4", looks={rod: fm.visual.Look("plastic_strain")})
say(f"in {out}: bend.png, fields.h5{', hinge.mp4' if FILM else ''}")
say("all checks passed")
