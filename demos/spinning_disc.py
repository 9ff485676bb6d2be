# # A disc that spins on an arm on an elastic base
#
# Zienkiewicz & Taylor (The Finite Element Method for Solid and Structural Mechanics, 6th ed., section 8.6.1): a rigid
# disc turns on a revolute joint at the end of a rigid arm, whose foot is bonded to an elastic base. For ten units of
# time a constant vertical load pushes on the joint and a constant torque turns the disc; then both are gone.
#
# The source gives the material (St Venant-Kirchhoff, E = 10000, nu = 0.25, rho = 5) but no dimension, load or torque.
# Chosen here: a base of 24 by 8, an arm of 12 by 2, a disc of radius 7.5, all of unit thickness, a load of 2000, and a
# torque of 4000 by a motor on the arm. Its four-node elements are bricks here, one over the thickness, whose faces are
# free.
#
# The base is a body with history in the machine: its foot is a rigid frame whose nodes are eliminated, and the disc
# hangs on the arm by Lagrange multipliers, as in the source. `./run python demos/spinning_disc.py`; the pictures and
# the recorded fields go to `out_spinning_disc`.

from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ImplicitContinuum, Interface, MpiTeam, NonlinearModel

WIDTH, HEIGHT, COLUMNS, ROWS = 24.0, 8.0, 12, 4
FOOT, ARM, RADIUS = 4.0, 12.0, 7.5  # half the foot's width; length of the arm; of the disc
LOAD, TORQUE = -2000.0, 4000.0
OFF, RAMP = 10.0, 1.0  # both go within a unit: a fall within one step has no impulse of its own
END, STEP = 40.0, 0.05

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_spinning_disc")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The base
#
# A regular grid, numbered from the lower left corner; x to the right, z up.

x, y, z = np.meshgrid(
    np.linspace(-WIDTH / 2, WIDTH / 2, COLUMNS + 1), [-0.5, 0.5], np.linspace(0, HEIGHT, ROWS + 1), indexing="ij"
)
points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
number = np.arange(len(points)).reshape(COLUMNS + 1, 2, ROWS + 1)
corners = [number[i : COLUMNS + i, j, k : ROWS + k].ravel() for k in (0, 1) for j in (0, 1) for i in (0, 1)]
mesh = meshes.from_arrays(
    comm,
    points,
    np.stack(corners, axis=1),
    cell="hexahedron",
    degree=1,
    facet_groups={
        "bottom": lambda x: abs(x[2]) < 1e-9,
        "foot": lambda x: (abs(x[2] - HEIGHT) < 1e-9) & (abs(x[0]) < FOOT + 1e-9),
    },
    cell_groups={"base": lambda x: np.full(x.shape[1], True)},
)
rubber = forms.st_venant_kirchhoff.Parameters(E=1e4, nu=0.25, rho=5.0)
solid = NonlinearModel(
    mesh, forms.st_venant_kirchhoff, rubber, degree=1, interfaces=[Interface("bottom"), Interface("foot")]
)
base = fm.ContinuumBody(ImplicitContinuum(solid))

# ## The machine


def plate(width: float, height: float, offset: float) -> fm.RigidBody:
    """A rectangle in the plane of x and z, its centre above the frame."""
    mass = rubber.rho * width * height
    inertia = mass / 12 * np.array([height**2 + 1, width**2 + height**2, width**2 + 1])
    return fm.RigidBody(mass, inertia, (0.0, 0.0, offset))


mass = rubber.rho * np.pi * RADIUS**2
polar = 0.5 * mass * RADIUS**2
scene = fm.System(team=MpiTeam(comm))
scene.add(base, name="base")
arm = scene.add(plate(2.0, ARM, ARM / 2), name="arm")
disc = scene.add(fm.RigidBody(mass, (polar / 2 + mass / 12, polar, polar / 2 + mass / 12)), name="disc")
scene.connect(fm.joint.Fixed(), scene.ground.frame(), base.frame("bottom"))
scene.connect(fm.joint.Fixed(), base.frame("foot"), arm.frame())
hub = arm.frame(p=(0.0, 0.0, ARM))
scene.connect(fm.joint.Revolute("y"), hub, disc.frame(), name="hub", way=fm.Way.CONSTRAINTS)


def switched(size):
    """What acts until the loads go."""

    @fm.compiled
    def value(t):
        return size * min(1.0, max(0.0, (OFF + RAMP - t) / RAMP))

    return value


# the arm holds the disc's motor
scene.add_force(fm.force.FrameForce(hub, force=(0.0, 0.0, switched(LOAD)), torque=(0.0, switched(-TORQUE), 0.0)))
scene.add_force(fm.force.FrameForce(disc.frame(), torque=(0.0, switched(TORQUE), 0.0)))
say(scene.explain())
say()

# ## Forty units of time

pictures = np.arange(2.5, 17.6, 2.5)
recording = fm.Recording(out / "fields.h5", every=2.5)
run = scene.simulate(END, integrator=fm.GeneralizedAlpha(rho=0.95), h=STEP, rtol=1e-7, recording=recording)
say(f"{run.stats.steps} steps, {run.stats.iterations} iterations, {run.stats.seconds:.1f} s")
marker = disc.frame(p=(RADIUS, 0.0, 0.0))
joint = run.position(hub) - run.position(hub)[0]
rim = run.position(marker) - run.position(marker)[0]
R = run.rotation(disc.frame())
angle = np.unwrap(np.arctan2(R[:, 0, 2], R[:, 0, 0]))

# ## What must hold
#
# The joint has no friction, so that the disc turns as the torque alone has it. Once the loads are gone the energy is
# constant, and is the work that they did. Nothing leaves the plane.

parts, machine = run.energies(base), run.energy()
energy = parts["kinetic"] + parts["elastic"] + machine.kinetic
free = run.t > OFF + RAMP + STEP
foretold = TORQUE / polar * (OFF + RAMP / 2)
say()
say("     t   joint x   joint z     rim x     rim z   disc, rad     energy")
for t in (*pictures, 25.0, 32.5, END):
    k = int(np.searchsorted(run.t, t - 1e-9))
    say(
        f"{run.t[k]:6.1f}{joint[k, 0]:10.4f}{joint[k, 2]:10.4f}{rim[k, 0]:10.3f}{rim[k, 2]:10.3f}"
        f"{angle[k]:12.4f}{energy[k]:11.1f}"
    )
spread = np.ptp(energy[free]) / energy[free].mean()
wrong = abs(run.angular_velocity(disc.frame())[free, 1] / foretold - 1.0).max()
instants = np.linspace(0.0, OFF + RAMP, 5001)
share = np.clip((OFF + RAMP - instants) / RAMP, 0.0, 1.0)
lowered = run.velocity(hub, t=instants)[:, 2]
turned = (run.angular_velocity(disc.frame(), t=instants) - run.angular_velocity(hub, t=instants))[:, 1]
work = np.trapezoid(share * (LOAD * lowered + TORQUE * turned), instants)
aside = max(abs(joint[:, 1]).max(), abs(rim[:, 1]).max())
elastic = parts["elastic"][free]
say()
say(f"disc spins at {foretold:.4f} rad a unit within {wrong:.1e}; energy without loads within {100 * spread:.2f} %")
# what does not spin the disc: it comes from the load, and from the motor's reaction on the arm
swung = (work - 0.5 * polar * foretold**2) / (energy[-1] - 0.5 * polar * foretold**2)
say(f"the loads' work is that energy within {abs(work / energy[-1] - 1):.1e}, without the spin {abs(swung - 1):.1e}")
say(f"of it {100 * elastic.min() / energy[-1]:.1f} to {100 * elastic.max() / energy[-1]:.1f} % elastic")
say(f"joint moves by {abs(joint[:, 0]).max():.2f} across and {abs(joint[:, 2]).max():.2f} down; aside {aside:.1e}")

assert wrong < 1e-5
assert spread < 5e-4
assert abs(work / energy[-1] - 1.0) < 2e-5
assert abs(swung - 1.0) < 1e-3
# the motor's reaction throws the arm aside, by more than the load presses it down
assert abs(joint[:, 0]).max() > 1.5 * abs(joint[:, 2]).max()
assert aside < 1e-7
assert elastic.max() - elastic.min() > 10 * spread * energy[-1]  # or there is no exchange to speak of

# ## Pictures

fields = run.recorded(base)
if root:
    shown = slice(1 + len(pictures))
    row_of = np.argsort(fields.mesh.node)  # of a node's number in the mesh that was given
    places = fields.values("position", row=shown)[:, row_of]
    front = np.stack([number[i : COLUMNS + i, 0, k : ROWS + k].ravel() for i, k in ((0, 0), (1, 0), (1, 1), (0, 1))], 1)
    around = np.linspace(0.0, 2.0 * np.pi, 73)
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    for axes, t, place in zip(figure.subplots(2, 4).ravel(), fields.t[shown], places, strict=True):
        at = np.array([t])
        axes.add_collection(
            PolyCollection(place[front][:, :, [0, 2]], facecolor="lightsteelblue", edgecolor="0.3", lw=0.5)
        )
        foot, R_arm = run.position(arm.frame(), t=at)[0], run.rotation(arm.frame(), t=at)[0]
        box = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, ARM], [-1, 0, ARM]]) @ R_arm.T + foot
        axes.fill(box[:, 0], box[:, 2], color="0.6")
        centre, dot = run.position(disc.frame(), t=at)[0], run.position(marker, t=at)[0]
        axes.plot(centre[0] + RADIUS * np.cos(around), centre[2] + RADIUS * np.sin(around), color="tab:blue")
        axes.plot([centre[0], dot[0]], [centre[2], dot[2]], "o-", color="tab:red", markevery=[1])
        axes.set(xlim=(-14, 14), ylim=(-1, 30), aspect="equal", title=f"t = {t:g}")
    figure.savefig(out / "deformed.png", dpi=120)

    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    for axes, moved, title in zip(
        figure.subplots(1, 2), (joint, rim), ("revolute joint", "rim of the disc"), strict=True
    ):
        axes.plot(run.t, moved[:, 0], label="horizontal")
        axes.plot(run.t, moved[:, 2], "--", label="vertical")
        axes.set(xlabel="time", ylabel="displacement", title=title)
        axes.legend()
    figure.savefig(out / "displacements.png", dpi=150)
say(f"in {out}: deformed.png, displacements.png, fields.h5")
say("all checks passed")
