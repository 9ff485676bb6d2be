"""Cook's membrane, elastic.

A tapered panel of 48 mm, clamped on the left, a shear force over its right end: in plane stress with E = 1, nu = 1/3
and a force of 1; and in plane strain with E = 70, a shear stress of 6.25 (CoFEA's comparison, linear elasticity).
"""

from __future__ import annotations

from mpi4py import MPI

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import j2_plasticity
from flexmbd.reduction import Traction, load_vectors
from verification.plasticity._pieces import node_at
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Cook 1974, Journal of the Structural Division ASCE 100; CoFEA benchmarks: "
    "CalculiX 32.27, Code_Aster 32.20, Elmer 32.28"
)
REFERENCES = (
    Reference("plane stress, rise of the end's middle", "mm", (23.96,), 1e-3, Sureness.PRIMARY),
    Reference("plane strain, rise of the end's upper corner, Elmer", "mm", (32.28,), 2.5e-3, Sureness.SECONDARY),
)


def rise(young: float, load: float, held: tuple[str, ...], place: tuple[float, float, float]) -> float:
    """mm, of 16 x 16 cells that get smaller towards the sides."""
    mesh = meshes.block(48.0, 1.0, 1.0, divisions=(16, 16, 1), comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    along, up = (s**2 / (s**2 + (1.0 - s) ** 2) for s in (x[:, 0] / 48.0, x[:, 1] + 0.5))
    x[:, 0], x[:, 1] = 48.0 * along, 44.0 * along + up * (44.0 - 28.0 * along)
    elastic = j2_plasticity.Parameters(E=young, nu=1.0 / 3.0, rho=1.0, yield_stress=1e9)
    body = NonlinearModel(mesh, j2_plasticity, elastic, degree=2)
    fixed = prescribed_dofs(body, {"x_min": "xy"} | dict.fromkeys(held, "z"))
    force = load / 16.0 * load_vectors(body, [Traction("shear", "x_max", (0.0, 1.0, 0.0))])[:, 0]
    follow(body, [1.0], prescribed=fixed, load=lambda t: t * force)
    return float(body.displacement[body.displacement_dofs[node_at(body, place), 1]])


def compute() -> Computed:
    """Both."""
    stress = rise(1.0, 1.0, ("z_min",), (48.0, 52.0, -0.5))
    strain = rise(70.0, 100.0, ("z_min", "z_max"), (48.0, 60.0, -0.5))
    return Computed((numbers(stress), numbers(strain)), mesh="16 x 16 graded quadratic bricks")
