"""Small machines that need the kernels of an integrator: `python -m flexmbd.command.sample_machines radau_iia`.

Between them they have what most machines have: rigid and flexible bodies, joints in the tree and in a loop, springs, a
torque from a table. To simulate a moment of each compiles, or finds in the cache, what such machines take. Prints the
number of kernels that were compiled, as JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, discrete_body
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.kernels.base.kernel_store import kernels_written
from flexmbd.scene_file.entry_kinds import INTEGRATORS

_END = 1e-3  # s


@dataclass(frozen=True)
class _Bar:
    """The section of a round bar of steel, 10 mm thick (SI units)."""

    E: float = 2.1e11
    nu: float = 0.3
    rho: float = 7850.0
    A: float = 7.85e-5
    Iy: float = 4.9e-10
    Iz: float = 4.9e-10
    Iyz: float = 0.0
    J: float = 9.8e-10
    ky: float = 0.89
    kz: float = 0.89
    orientation: tuple[float, float, float] = (0.0, 1.0, 0.0)


def pendulum() -> fm.System:
    """A rigid body on a hinge."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1), com=(0.5, 0.0, 0.0)))
    scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), body.frame()).position = 0.3
    return scene


def slider_crank(rod: fm.ReducedBody | None) -> fm.System:
    """A slider-crank with a spring, a torque and a top on its piston; ``rod``: the record of its rod, None: rigid."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(mass=0.9, inertia=(4e-4, 6e-4, 8e-4), com=(0.02, 0.0, 0.0)))
    piston, top = (scene.add(fm.RigidBody(mass=0.5, inertia=(2e-4, 2e-4, 2e-4))) for _ in range(2))
    turn = fm.joint.Revolute(axis="z")
    drive = scene.connect(turn, scene.ground.frame(), crank.frame())
    if rod is None:
        conrod = scene.add(fm.RigidBody(mass=0.2, inertia=(1e-5, 1e-3, 1e-3), com=(0.15, 0.0, 0.0)))
        ends = conrod.frame(), conrod.frame(p=(0.3, 0.0, 0.0))
    else:
        flexible = scene.add(fm.FlexibleBody(rod))
        ends = flexible.frame("big"), flexible.frame("small")
    scene.connect(turn, crank.frame(p=(0.08, 0.0, 0.0)), ends[0])
    scene.connect(turn, ends[1], piston.frame())
    scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), piston.frame())
    scene.connect(fm.joint.Spherical(), piston.frame(), top.frame(p=(0.0, -0.1, 0.0)))
    scene.add_force(fm.force.JointTorque(drive, fm.Table([0.0, 1.0, 2.0], [0.0, 1.0, 0.5])))
    scene.add_force(fm.force.JointSpring(drive, stiffness=1.0))
    above = scene.ground.frame(p=(0.6, 0.1, 0.0))
    scene.add_force(fm.force.SpringDamper(above, piston.frame(), length=0.3, stiffness=100.0))
    drive.velocity = 5.0
    return scene


def compile_for(integrator: Integrator) -> None:
    """Simulate a moment of each machine."""
    frame = DiscreteFrame(
        {"big": (0.0, 0.0, 0.0), "small": (0.3, 0.0, 0.0)}, {"rod": [("big", "small")]}, {"rod": _Bar()}, divisions=2
    )
    rod = discrete_body(frame, interfaces=("big", "small"), frame="big", modes=2)
    for scene in (pendulum(), slider_crank(None), slider_crank(rod)):
        scene.simulate(_END, integrator=integrator, rtol=1e-3)


if __name__ == "__main__":
    compile_for(INTEGRATORS[sys.argv[1]]())
    print(json.dumps({"written": kernels_written()}))
