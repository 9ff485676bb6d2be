"""Elastic brick that bends without locking: trilinear displacement and twelve enhanced strains in each cell.

Unknowns: displacement u (m) of a three-dimensional body, and twelve numbers alpha (dimensionless) in each hexahedron,
which make strains beside those of u.  Functional in the initial configuration:

    W = lambda/2 tr(E)^2 + mu E : E,   E = (H + H^T + H^T H)/2 + e(alpha),   H = Grad u,
    e = det(J0)/det(J) size J0^-T e_xi J0^-1,   e_xi linear in alpha,   size = det(J0)^(2/3)

with J the Jacobian of the cell, J0 that at its centre, and xi its coordinates from -1 to 1, taken as those of the
parallelepiped of J0.  Nine of them are linear in xi, of Simo & Rifai; three, which change volume by xi eta, eta zeta
and zeta xi less their means over the cell, are for nu near 1/2, after Simo, Armero & Taylor.  The enhanced strains
vanish in the mean against constant stresses, so that the patch test is passed in cells of any shape.  W is least in
alpha, which is condensed in the cell: a body has the unknowns of a plain trilinear one, bends as one of quadratic cells
through one cell of thickness, and does not lock where volume is kept.  Isotropic, homogeneous; rotations of any size,
strains of some per cent.  Strongly compressed cells of this kind have modes without stiffness (Wriggers & Reese 1996):
beyond some tens of per cent take quadratic ones.

References: Simo & Rifai 1990, A class of mixed assumed strain methods and the method of incompatible modes,
doi:10.1002/nme.1620290802; Simo, Armero & Taylor 1993, Improved versions of assumed enhanced strain tri-linear elements
for 3D finite deformation problems, doi:10.1016/0045-7825(93)90215-J; Klinkel & Wagner 1997, A geometrical non-linear
brick element based on the EAS-method, International Journal for Numerical Methods in Engineering 40 (the
Green-Lagrange strain).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import basix.ufl
import ufl
from ufl.core.expr import Expr

from flexmbd.forms._shared import IsotropicElastic, Terms, shear_modulus, small_strain_stress
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import thermal_stretch as thermal_stretch

CELLS = ("hexahedron",)

# L2 order of the displacement by element degree.
ORDER = {1: 2}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

_ENHANCED = 12


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material of this form: `IsotropicElastic`."""


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube whose exact displacement is known.

    Attributes:
        parameters: the material.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        return 1e-3 * ufl.as_vector((ufl.sin(2 * x[1] + x[2]), ufl.cos(x[0] + x[2]), ufl.sin(x[0] * x[1])))

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, with which it is in equilibrium at small strain."""
        return -ufl.div(small_strain_stress(self.displacement(x), self.parameters))


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Trilinear displacement, and twelve numbers in each cell."""
    displacement = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return basix.ufl.mixed_element([displacement, basix.ufl.element("DG", cell, 0, shape=(_ENHANCED,))])


def strain_energy(u: Expr, p: Parameters) -> Terms:
    """The functional W per initial volume, J/m^3, of the unknown u = (displacement, alpha)."""
    strain, mu = _strain(u), shear_modulus(p)
    return [(mu * ufl.inner(strain, strain) + mu * p.nu / (1 - 2 * p.nu) * ufl.tr(strain) ** 2, Quadrature(3))]


def kinetic_energy(v: Expr, p: Parameters) -> Terms:
    """Kinetic energy per initial volume, J/m^3, of the rate v of the unknown; on straight cells exact."""
    velocity, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(velocity, velocity), Quadrature(4))]


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """The unknown at x of an infinitesimal rigid motion: translation + rotation x x, no enhanced strain."""
    displacement = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*(displacement[i] for i in range(3)), *[0.0] * _ENHANCED])


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Cauchy stress F S F^T / det F, Pa, 3 x 3, of the deformed body in the axes of its frame."""
    f, mu = ufl.Identity(3) + ufl.grad(ufl.split(u)[0]), shear_modulus(p)
    strain = _strain(u)
    second = 2 * mu * strain + 2 * mu * p.nu / (1 - 2 * p.nu) * ufl.tr(strain) * ufl.Identity(3)
    return f * second * f.T / ufl.det(f)


def reference() -> Reference:
    """A static problem of steel."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0))


class CellFrame(NamedTuple):
    """A cell's Jacobian at its centre, its inverse, the coordinates by it, and the means of their products.

    Attributes:
        j0: (3, 3) m.
        back: (3, 3) 1/m.
        xi: (3,) from -1 to 1 in a parallelepiped.
        means: (3, 3) of xi_i xi_j over the coordinates of the cell, right where i and j differ.
    """

    j0: Expr
    back: Expr
    xi: Expr
    means: Expr


def cell_frame(u: Expr) -> CellFrame:
    """That of the cells of a field's mesh."""
    domain = ufl.domain.extract_unique_domain(u)
    vertices = ufl.geometry.CellVertices(domain)
    # vertex i has the reference coordinates (i & 1, i >> 1 & 1, i >> 2), from 0 to 1
    signs = [[1 if i >> k & 1 else -1 for i in range(8)] for k in range(3)]
    x, y, z = signs
    warps = [[a * b for a, b in zip(*pair, strict=True)] for pair in ((x, y), (y, z), (z, x))]
    warps.append([a * b for a, b in zip(warps[0], z, strict=True)])
    shapes = ufl.as_matrix([[sign / 8 for sign in row] for row in (*signs, *warps, [1] * 8)]) * vertices
    j0 = ufl.as_matrix([[shapes[k, i] for k in range(3)] for i in range(3)])
    back = ufl.inv(j0)
    # x = centre + J0 (xi + sum of w_k N_k), N_k = xi eta, eta zeta, zeta xi, xi eta zeta, whose squares have the means
    w = [back * ufl.as_vector([shapes[3 + k, i] for i in range(3)]) for k in range(4)]
    means = sum(ufl.outer(w[k], w[k]) / (9 if k < 3 else 27) for k in range(4))
    centre = ufl.as_vector([shapes[7, i] for i in range(3)])
    return CellFrame(j0, back, back * (ufl.SpatialCoordinate(domain) - centre), means)


def enhanced_strain(alpha: Expr, frame: CellFrame) -> Expr:
    """The strain e of the twelve numbers of a cell."""
    xi, size = frame.xi, ufl.det(frame.j0)
    xy = (alpha[3] * xi[0] + alpha[4] * xi[1]) / 2
    xz = (alpha[5] * xi[0] + alpha[6] * xi[2]) / 2
    yz = (alpha[7] * xi[1] + alpha[8] * xi[2]) / 2
    volume = sum(
        alpha[9 + k] * (xi[i] * xi[j] - frame.means[i, j]) for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)))
    )
    xx, yy, zz = (alpha[k] * xi[k] + volume for k in range(3))
    local = ufl.as_matrix(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    # J maps from coordinates of length 1: det J = 8 det J0 at the centre
    ratio = 8 * size ** (5 / 3) / ufl.JacobianDeterminant(ufl.domain.extract_unique_domain(frame.j0))
    return ratio * (frame.back.T * local * frame.back)


def _strain(u: Expr) -> Expr:
    """Green and Lagrange's strain of the displacement, and the enhanced one."""
    displacement, alpha = ufl.split(u)
    h = ufl.grad(displacement)
    return (h + h.T + h.T * h) / 2 + enhanced_strain(alpha, cell_frame(u))
