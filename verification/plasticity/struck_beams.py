"""Plastic beams that are struck (Parkes, Jones).

Rigid and perfectly plastic: a cantilever whose tip carries a mass that is struck, with the hinge that travels from the
tip to the root; and a simply supported beam of which all is set off at one speed, with the hinges that travel from the
ends to the middle. Here chains of five and of ten rigid pieces with hinges that are elastic and then plastic, whose
permanent turns are summed; the hinges store 3e-5 of the energy. What is told is extrapolated to pieces without length,
for the error falls with that.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Parkes 1955, Proceedings of the Royal Society A 228, as derived again from the momentum of the pieces between "
    "hinges; Jones, Structural Impact, as in Khan et al. 2022, Scientific Reports 12, table 3",
    "10.1038/s41598-022-14082-4",
)
PIECES, STORED, TURN = (5, 10), 3e-5, 0.01


def parkes(ratio: float) -> float:
    """Way of the tip times M0 / (m V^2 L^2), by the beam's mass over twice the tip's."""
    return (ratio / (1.0 + ratio) + 2.0 * float(np.log(1.0 + ratio))) / (12.0 * ratio**2)


RATIOS = (0.2, 1.0, 5.0)
REFERENCES = (
    *(
        Reference(
            f"cantilever, m L / 2 G = {ratio:g}: way of the tip M0 / (m V^2 L^2)", "", (parkes(ratio),), 2e-2,
            Sureness.PRIMARY,
        )
        for ratio in RATIOS
    ),
    Reference("supported beam: way of the middle (m L) M0 / (L I^2)", "", (0.08333,), 2e-2, Sureness.SECONDARY),
    Reference("supported beam: time to rest M0 / (I L)", "", (0.25,), 2e-2, Sureness.SECONDARY),
)  # fmt: skip
METHOD = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def chain(
    scene: fm.System, root: fm.Frame, energy: float, pieces: int
) -> tuple[list[Connection], list[fm.force.PlasticJointSpring], fm.Frame]:
    """Pieces of 1 m and 1 kg in all along x, hinges that bear 1 N m, and the frame at their end.

    The hinges store a share `STORED` of the energy at that moment.
    """
    h, slack = 1.0 / pieces, 2.0 * STORED * energy / pieces
    hinges, springs, before = [], [], root
    for k in range(pieces):
        piece = scene.add(rod(h, h), name=f"piece {k}")
        hinges.append(scene.connect(fm.joint.Revolute("z"), before, piece.frame()))
        springs.append(fm.force.PlasticJointSpring(hinges[-1], (0.0, slack, 1.0), (0.0, 1.0, 1.0)))
        scene.add_force(springs[-1])
        before = piece.frame(p=(h, 0.0, 0.0))
    return hinges, springs, before


def bent(run: fm.Trajectory, springs: list[fm.force.PlasticJointSpring]) -> float:
    """m, way of the chain's end by its permanent turns."""
    turns = [run.remembered(one)["plastic_deformation"][-1] for one in springs]
    return float(np.dot(turns, 1.0 - np.arange(len(turns)) / len(turns)))


def cantilever(ratio: float, pieces: int) -> float:
    """As `parkes`."""
    mass, h = 0.5 / ratio, 1.0 / pieces
    speed = float(np.sqrt(2.0 * TURN / mass))
    scene = fm.System()
    hinges, springs, end = chain(scene, scene.ground.frame(), TURN, pieces)
    tip = scene.add(fm.PointMass(mass), name="tip")
    scene.connect(fm.joint.Fixed(), end, tip.frame())
    hinges[-1].velocity = speed / (1.0 + 0.5 * h / mass) / h
    run = scene.simulate(1.5 * (mass + 0.5) * speed, rtol=1e-5, integrator=METHOD)
    return bent(run, springs) / speed**2


def supported(pieces: int) -> tuple[float, float]:
    """Half of it, from its middle, which slides: way, and time to rest."""
    speed = float(np.sqrt(2.0 * TURN))
    scene = fm.System()
    middle = scene.add(fm.RigidBody(1e-6, (1e-9, 1e-9, 1e-9)), name="middle")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), middle.frame())
    hinges, springs, end = chain(scene, middle.frame(), TURN, pieces)
    scene.connect(fm.joint.PointOnPlane("y"), scene.ground.frame(), end)
    slide.velocity, hinges[-1].velocity = speed, -speed * pieces
    run = scene.simulate(0.75 * speed, rtol=1e-5, integrator=METHOD)
    rate = run.beta_rate(slide)
    rest = int(np.argmax(rate < 0.0))
    # the impulse of the whole beam is twice the half's momentum, `speed`
    return -bent(run, springs) / (2.0 * speed) ** 2, float(run.t[rest]) / (2.0 * speed)


def without_length(of: Callable[[int], ArrayLike]) -> tuple[float, ...]:
    """Numbers of ever shorter pieces, by those of two lengths; their errors are in proportion to the lengths."""
    (coarse, fine), (few, many) = (np.asarray(of(pieces)) for pieces in PIECES), PIECES
    return numbers(fine + (fine - coarse) * few / (many - few))


def compute() -> Computed:
    """Three cantilevers, and the supported beam."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fm.StepsWarning)  # the hinges' vibration is to be followed
        ways = [without_length(partial(cantilever, ratio)) for ratio in RATIOS]
        way, rest = without_length(supported)
    return Computed(
        (*ways, numbers(way), numbers(rest)), mesh="5 and 10 rigid pieces, extrapolated",
        accuracy="Dormand & Prince 8(5,3), rtol 1e-5",
    )  # fmt: skip
