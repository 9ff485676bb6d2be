# # Campbell diagrams: a rotor with two discs, and a blade on a hub
#
# Frequencies change with the speed of what spins: discs whirl forward and backward, blades grow stiff by centrifugal
# force. Where a frequency meets an engine order, a multiple of the speed, the machine resonates. `fm.campbell`
# linearises a machine at speed after speed and follows its vibrations, through crossings too.
#
# `./run python demos/campbell.py`; the pictures go to `out_campbell`.

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import numpy as np
import scipy.linalg

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import craig_bampton

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_campbell")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


def show(diagram: fm.Campbell, names: Sequence[str] = ()) -> None:
    for one in diagram.critical:
        name = f" ({names[one.branch]})" if names else ""
        say(
            f"  {60.0 * one.speed / (2.0 * np.pi):8.1f} turns a minute: {one.order:g} times the speed meets vibration "
            f"{one.branch + 1}{name} at {one.frequency:7.2f} Hz, damping ratio {one.damping_ratio:z.4f}"
        )


# ## The rotor
#
# A steel shaft in three equal pieces, of one record: a bearing, a disc in the middle of two bearings, and a second
# disc that overhangs. The thin shaft has little angular momentum of its own, so it need not turn: the discs spin about
# it, and all that is computed are bending and tilts in axes at rest. The bearings are softer sideways than upright.

PIECE = 0.25  # m
steel = forms.beam_timoshenko.Parameters.tube(2.1e11, 0.3, 7850.0, outer_radius=0.02, orientation=(0.0, 1.0, 0.0))
line = meshes.line(PIECE, divisions=8, comm=comm)
ends = [Interface("start"), Interface("end")]
piece = craig_bampton(
    ContinuumModel(line, forms.beam_timoshenko, steel, degree=2, interfaces=ends), modes=6, frame="start"
)

rotor = fm.System(team=MpiTeam(comm))
shaft = [rotor.add(fm.FlexibleBody(piece), name=f"shaft {k}") for k in (1, 2, 3)]
rotor.connect(fm.joint.Free(), rotor.ground.frame(), shaft[0].frame("start"))
for before, after in pairwise(shaft):
    rotor.connect(fm.joint.Fixed(), before.frame("end"), after.frame("start"))
spins = []
for k, mass, radius in ((0, 12.0, 0.20), (2, 8.0, 0.25)):
    polar, across = mass * radius**2 / 2.0, mass * (3.0 * radius**2 + 0.03**2) / 12.0
    disc = rotor.add(fm.RigidBody(mass, (polar, across, across)), name=f"disc {len(spins) + 1}")
    spins.append(rotor.connect(fm.joint.Revolute("x"), shaft[k].frame("end"), disc.frame()))
for k, end, x in ((0, "start", 0.0), (1, "end", 2.0 * PIECE)):
    stiffness = np.array([1e7, 3e7, 6e7, 1e3, 0.0, 0.0])  # N/m, N m/rad
    bearing = fm.force.Bushing(rotor.ground.frame(p=(x, 0.0, 0.0)), shaft[k].frame(end), stiffness, 1e-5 * stiffness)
    rotor.add_force(bearing)


def rotor_at(speed: float) -> fm.LinearizedMachine:
    for spin in spins:
        spin.velocity = speed
    return rotor.linearize()


# What a vibration is shows in where it moves the discs: along the axis, about it, or round it, with the rotation or
# against it. What unbalance excites shows in the work of a force that turns with a disc, on the left eigenvector.

discs = [shaft[0].frame("end"), shaft[2].frame("end")]
RADII = np.array([0.20, 0.25])  # m, by which turns are compared with ways
pushes = [fm.force.FrameForce(disc, axis) for disc in discs for axis in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]


def told_apart(diagram: fm.Campbell) -> tuple[list[str], list[bool]]:
    """The name of each vibration at the highest speed, and whether unbalance excites it."""
    for spin in spins:
        spin.velocity = diagram.speeds[-1]
    outputs = [kind(disc) for kind in (fm.output.Position, fm.output.Rotation) for disc in discs]
    A, B, C, _ = rotor.linearize(inputs=pushes, outputs=outputs).state_space()
    values, left, right = scipy.linalg.eig(A, left=True)
    names, works = [], []
    for value in diagram.eigenvalues[-1]:
        k = int(abs(values - value).argmin())
        way, turn = (C @ right[:, k]).reshape(2, 2, 3)  # m, rad: a row a disc
        names.append(kind_of(way, RADII[:, None] * turn))
        turning = B.reshape(len(A), 2, 2) @ [1.0, -1.0j]  # forces that turn with the discs
        works.append(np.linalg.norm(left[:, k].conj() @ turning))
    return names, [bool(work > 1e-6 * max(works)) for work in works]


def kind_of(way: np.ndarray, turn: np.ndarray) -> str:
    """Of complex amplitudes (discs, 3) in m, of the discs' places and of their rims by their turns."""
    sizes = {"axial": abs(way[:, 0]).max(), "torsion": abs(turn[:, 0]).max(), "whirl": abs(way[:, 1:]).max()}
    kind = max(sizes, key=lambda name: sizes[name])
    if kind != "whirl":
        return kind
    sense = (way[:, 1].conj() * way[:, 2]).imag  # negative where z follows y by a quarter, as the discs turn
    if (sense < 0.0).all():
        return "forward"
    return "backward" if (sense > 0.0).all() else "mixed"  # forward at one disc, backward at the other


whirl = fm.campbell(rotor_at, np.linspace(0.0, 1200.0, 25))
kinds, excited = told_apart(whirl)
names = [f"{k + 1}: {kind}" for k, kind in enumerate(kinds)]
what = [f"{kind}{'' if one else ', not excited'}" for kind, one in zip(kinds, excited, strict=True)]
say("rotor: once in a turn meets")
show(whirl, what)
title = "A rotor with two discs, and what unbalance excites"
fm.visual.plot_campbell(whirl, path=out / "rotor.png", title=title, names=names, excited=excited)

# Unbalance excites the backward whirl too, for the bearings are softer sideways than upright.
#
# Of the two lowest, almost one at rest, the backward whirl falls with the speed and the forward whirl rises. What the
# shaft does along its axis knows nothing of the speed, and the others pass it.
#
# ## The blade
#
# A solid blade on a hub that turns, reduced once. At each speed the machine settles in its steady motion, stretched by
# centrifugal force, about which it is linearised. Frequencies are those that the blade sees; it is pushed as many times
# in a turn as there are vanes or burners before it.

alloy = forms.solid_linear.Parameters(E=1.1e11, nu=0.33, rho=4430.0)
bricks = meshes.block(0.2, 0.04, 0.005, divisions=(16, 4, 1), cell="hexahedron", degree=1, comm=comm)
blade = craig_bampton(
    ContinuumModel(bricks, forms.solid_linear, alloy, degree=2, interfaces=[Interface("x_min")]),
    modes=6,
    frame="x_min",
)


def blade_at(speed: float) -> fm.LinearizedMachine:
    scene = fm.System(team=MpiTeam(comm))
    hub = scene.add(fm.RigidBody(1.0, (1e-2, 1e-2, 1e-2)), name="hub")
    body = scene.add(fm.FlexibleBody(blade), name="blade")
    turn = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), hub.frame())
    scene.connect(fm.joint.Fixed(), hub.frame(p=(0.15, 0.0, 0.0)), body.frame("x_min"))
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    return scene.linearize(about=scene.equilibrium())


stiffened = fm.campbell(blade_at, np.linspace(0.0, 1500.0, 11), orders=[2, 4, 6])
say("blade: engine orders meet")
show(stiffened)
fm.visual.plot_campbell(stiffened, path=out / "blade.png", title="A blade on a hub", highest=1600.0)
