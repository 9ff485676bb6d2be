# # The spin-up of a flexible arm, and why geometric stiffness matters
#
# A slender arm of 10 m is brought from rest to 6 rad/s within 15 s by a prescribed turn of its hub (Simo & Vu-Quoc
# 1986, doi:10.1115/1.3171871). While it gains speed it lags behind by more than half a metre; then centrifugal force
# pulls it straight and leaves an extension of half a millimetre. A linear modal body without geometric stiffness knows
# nothing of that pull: it grows softer the faster it turns, and at 6 rad/s, above its first frequency, it collapses.
#
# The arm is a solid here, of square section, meshed by bricks, reduced to its root and its tip, and turned with and
# without the geometric stiffness of the record. `./run python demos/spin_up.py`; pictures go to `out_spin_up`.

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import craig_bampton

LENGTH = 10.0  # m
SIDE = 0.0774597  # m, of the square section: EA = 2.8e7 N, EI = 1.4e4 N m^2, 1.2 kg/m
OMEGA, RAMP, END = 6.0, 15.0, 20.0  # rad/s, s, s
MODES = 10

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_spin_up")
if root:
    out.mkdir(exist_ok=True)


def say(text: str) -> None:
    if root:
        print(text, flush=True)


# ## The arm
#
# Bricks of degree 2, one over the section: bending of a slender bar is a parabola over each of them.

material = forms.solid_linear.Parameters(E=4.6667e9, nu=1.0 / 6.0, rho=200.0)
mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(40, 1, 1), cell="hexahedron", degree=1, comm=comm)
model = ContinuumModel(
    mesh, forms.solid_linear, material, degree=2, interfaces=[Interface("x_min"), Interface("x_max")]
)
arm = craig_bampton(model, modes=MODES, frame="x_min")
assert arm.geometric is not None
soft = replace(arm, geometric=None)
first = arm.frequencies(clamped=["x_min"])[0]
say(f"arm: {model.K.getSize()[0]} degrees of freedom, {arm.mass:.4f} kg, first frequency {first:.4f} Hz, ")
say(f"     {2.0 * np.pi * first:.3f} rad/s, against {OMEGA} rad/s of the hub")

# ## The machine
#
# The hub's angle is $\Omega/T\,(t^2/2 + (T/2\pi)^2 (\cos 2\pi t/T - 1))$ up to the time $T$ and then grows steadily.
# Three compiled functions of time give it and its rates, so that no step returns to Python.

TURN = 2.0 * np.pi / RAMP


@fm.compiled
def angle(t):
    if t < RAMP:
        return OMEGA / RAMP * (0.5 * t * t + (np.cos(TURN * t) - 1.0) / TURN**2)
    return OMEGA * (t - 0.5 * RAMP)


@fm.compiled
def speed(t):
    return OMEGA / RAMP * (t - np.sin(TURN * t) / TURN) if t < RAMP else OMEGA


@fm.compiled
def acceleration(t):
    return OMEGA / RAMP * (1.0 - np.cos(TURN * t)) if t < RAMP else 0.0


def simulate(record: fm.ReducedBody, rtol: float) -> tuple[fm.Trajectory, np.ndarray]:
    """The run, and the tip's displacement (nt, 3) m against an arm that turns with the hub and stays straight."""
    scene = fm.System(team=MpiTeam(comm))
    body = scene.add(fm.FlexibleBody(record), name="arm")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("x_min"), name="hub")
    hub.prescribe(fm.Motion(angle, speed, acceleration))
    run = scene.simulate(END, rtol=rtol)
    turned = np.einsum("tji,tj->ti", run.rotation(body.frame()), run.position(body.frame("x_max")))
    return run, turned - [LENGTH, 0.0, 0.0]
