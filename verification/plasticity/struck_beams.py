"""Plastic beams that are struck (Parkes, Jones).

Rigid and perfectly plastic: a cantilever whose tip carries a mass that is struck, with the hinge that travels from the
tip to the root; and a simply supported beam of which all is set off at one speed, with the hinges that travel from the
ends to the middle. Here chains of twenty rigid pieces, whose hinges bear one moment while they turn, as dry friction
does, and creep below it by 1e-4 of the blow's speed.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Parkes 1955, Proceedings of the Royal Society A 228, as derived again from the momentum of the pieces between "
    "hinges; Jones, Structural Impact, as in Khan et al. 2022, Scientific Reports 12, table 3",
    "10.1038/s41598-022-14082-4",
)
PIECES, CREEP, TURN = 20, 1e-4, 0.01


def parkes(ratio: float) -> float:
    """Way of the tip times M0 / (m V^2 L^2), by the beam's mass over twice the tip's."""
    return (ratio / (1.0 + ratio) + 2.0 * float(np.log(1.0 + ratio))) / (12.0 * ratio**2)


COARSE = (
    "The hinge goes from joint to joint; the difference falls slowly with the pieces' length, as from 3.4 to 2.3 % of "
    "the supported beam's way from 20 to 40 pieces, and so it does by hinges that are elastic and then plastic."
)
RATIOS = {0.2: "", 1.0: COARSE, 5.0: COARSE}
REFERENCES = (
    *(
        Reference(
            f"cantilever, m L / 2 G = {ratio:g}: way of the tip M0 / (m V^2 L^2)", "", (parkes(ratio),), 2e-2,
            Sureness.PRIMARY, fails=fails,
        )
        for ratio, fails in RATIOS.items()
    ),
    Reference(
        "supported beam: way of the middle (m L) M0 / (L I^2)", "", (0.08333,), 2e-2, Sureness.SECONDARY, fails=COARSE
    ),
    Reference("supported beam: time to rest M0 / (I L)", "", (0.25,), 2e-2, Sureness.SECONDARY),
)  # fmt: skip


def chain(scene: fm.System, root: fm.Frame, speed: float) -> tuple[list[Connection], fm.Frame]:
    """Pieces of 1 m and 1 kg in all along x, hinges that bear 1 N m, and the frame at their end."""
    h, hinges, before = 1.0 / PIECES, [], root
    for k in range(PIECES):
        piece = scene.add(rod(h, h), name=f"piece {k}")
        hinges.append(scene.connect(fm.joint.Revolute("z"), before, piece.frame()))
        scene.add_force(fm.force.JointFriction(hinges[-1], coulomb=1.0, regularisation=CREEP * speed))
        before = piece.frame(p=(h, 0.0, 0.0))
    return hinges, before


def bent(run: fm.Trajectory, hinges: list[Connection]) -> float:
    """m, way of the chain's end by small turns."""
    turns = [run.beta(one)[-1] for one in hinges]
    return float(np.dot(turns, 1.0 - np.arange(PIECES) / PIECES))


def cantilever(ratio: float) -> float:
    """As `parkes`."""
    mass, h = 0.5 / ratio, 1.0 / PIECES
    speed = float(np.sqrt(2.0 * TURN / mass))
    scene = fm.System()
    hinges, end = chain(scene, scene.ground.frame(), speed)
    tip = scene.add(fm.PointMass(mass), name="tip")
    scene.connect(fm.joint.Fixed(), end, tip.frame())
    hinges[-1].velocity = speed / (1.0 + 0.5 * h / mass) / h
    run = scene.simulate(1.5 * (mass + 0.5) * speed, rtol=1e-5, integrator=fm.RadauIIA())
    return bent(run, hinges) / speed**2


def supported() -> tuple[float, float]:
    """Half of it, from its middle, which slides: way, and time to rest."""
    speed = float(np.sqrt(2.0 * TURN))
    scene = fm.System()
    middle = scene.add(fm.RigidBody(1e-6, (1e-9, 1e-9, 1e-9)), name="middle")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), middle.frame())
    hinges, end = chain(scene, middle.frame(), speed)
    scene.connect(fm.joint.PointOnPlane("y"), scene.ground.frame(), end)
    slide.velocity, hinges[-1].velocity = speed, -speed * PIECES
    run = scene.simulate(0.75 * speed, rtol=1e-5, integrator=fm.RadauIIA())
    rest = int(np.argmax(run.beta_rate(slide) < 1e-3 * speed))
    # the impulse of the whole beam is twice the half's momentum, `speed`
    return -bent(run, hinges) / (2.0 * speed) ** 2, float(run.t[rest]) / (2.0 * speed)


def compute() -> Computed:
    """Three cantilevers, and the supported beam."""
    ways = [numbers(cantilever(ratio)) for ratio in RATIOS]
    way, rest = supported()
    return Computed(
        (*ways, numbers(way), numbers(rest)), mesh=f"{PIECES} rigid pieces", accuracy="Radau IIA, rtol 1e-5"
    )
