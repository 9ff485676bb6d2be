"""Princeton beam.

A strip of 0.508 m, 12.3777 mm x 3.2024 mm, E = 71.7 GPa, nu = 0.31, clamped, a dead force across its tip at an angle
to the stiff axis: way of the tip along the stiff and the soft axis, by another program's beam. In the planes of the
section nothing depends on torsion; at 45 degrees the table has that of a torsion constant 3.4 % above Saint-Venant's.
"""

from __future__ import annotations

import dataclasses

import numpy as np

import flexmbd as fm
from flexmbd.forms import beam_timoshenko
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Dowell & Traybar 1975; beam rows of Obrezkov et al. 2022, in Exudyn's ANCFBeamTest")
REFERENCES = (
    Reference("8.896 N at 0 degrees", "m", (0.01071417630, 0.0), 2e-4, Sureness.PRIMARY),
    Reference("8.896 N at 90 degrees", "m", (0.0, 0.146245978), 2e-4, Sureness.PRIMARY),
    Reference("13.345 N at 90 degrees", "m", (0.0, 0.200677707), 2e-4, Sureness.PRIMARY),
    Reference("8.896 N at 45 degrees, torsion constant 1.034 of Saint-Venant's", "m", (0.008837226265, 0.108987937),
              2e-4, Sureness.PRIMARY),
    Reference("8.896 N at 45 degrees, way along the stiff axis by Saint-Venant's constant", "m", (0.008837226265,),
              2e-4, Sureness.PRIMARY,
              fails="The table is not of Saint-Venant's torsion constant; see the row above it."),
)  # fmt: skip
STRIP = beam_timoshenko.Parameters.rectangle(
    71.7e9, 0.31, 2700.0, width=12.3777e-3, height=3.2024e-3, orientation=(0.0, 1.0, 0.0)
)


def way(force: float, angle: float, *, torsion: float = 1.0) -> tuple[float, ...]:
    """Sizes of the tip's ways along y and z."""
    section = dataclasses.replace(STRIP, J=torsion * STRIP.J)
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (0.508, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"strip": [("clamp", "tip")]}, {"strip": section}, 32), name="strip")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    c, s = float(np.cos(np.deg2rad(angle))), float(np.sin(np.deg2rad(angle)))
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, lambda t: -force * c * t, lambda t: force * s * t)))
    about = scene.equilibrium(t=0.5)
    return numbers(abs(scene.equilibrium(t=1.0, about=about).position(beam.frame("tip"))[1:]))


def compute() -> Computed:
    """Each row."""
    return Computed(
        (
            way(8.896, 0.0), way(8.896, 90.0), way(13.345, 90.0), way(8.896, 45.0, torsion=1.034), way(8.896, 45.0)[:1],
        ),
        mesh="32 exact elements",
    )  # fmt: skip
