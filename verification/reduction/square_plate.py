"""Square plate, one edge clamped and free all round.

1 m x 1 m x 0.01 m, E = 210 GPa, nu = 0.3, 7800 kg/m^3: code_aster's case of substructures and its free twin, by the
theory of thin plates. Here as a solid of bricks, reduced. Those of the free plate are by a method of Ritz, from
above: the last digits of later ones are up to 1 % lower.
"""

from __future__ import annotations

import warnings

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ModesWarning
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("code_aster V2.03.001; Leissa 1969, Vibration of Plates, NASA SP-160")
REFERENCES = (
    Reference(
        "one edge clamped, 1 to 6",
        "Hz",
        (8.7266, 21.3042, 53.5542, 68.2984, 77.7448, 136.0471),
        2.5e-3,
        Sureness.PRIMARY,
    ),
    Reference("free, 1 to 5", "Hz", (33.7119, 49.4558, 61.0513, 87.5160, 87.5160), 1e-2, Sureness.PRIMARY),
)


def compute() -> Computed:
    """One quadratic brick through the thickness."""
    mesh = meshes.plate(1.0, 1.0, 0.01, h=1.0 / 14.0)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7800.0)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[Interface("x_min")])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModesWarning)
        clamped = craig_bampton(model, modes=6, frame="x_min", geometric_stiffness=False).frequencies(["x_min"])
        loose = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[])
        free = craig_bampton(loose, modes=5, frame=None, geometric_stiffness=False).frequencies()
    return Computed((numbers(clamped[:6]), numbers(free[:5])), mesh="14 x 14 x 1 quadratic bricks")
