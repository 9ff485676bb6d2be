"""The strain of a thin brick that does not lock: a solid-shell of eight nodes.

Its third edges go through the thickness of the wall.

The displacement's own strain E of a trilinear brick locks where walls are thin and curved. In its
place stand fields of the cell (Hu & Washizu: an assumed strain, and the stress that ties it to the
displacement's):

- transverse shear: E_13 and E_23 in the middle of the cell's edges, between which they are linear
  (Dvorkin & Bathe 1984); neighbours share these values, so that cells may be askew;
- thickness strain: E_33 at the corners, between which it is bilinear (Betsch & Stein 1995), and
  besides linear through the thickness, where the stress has no say (Buechter, Ramm & Roehl 1994);
- membrane strain: four incompatible modes, so that the wall bends in its own plane (Simo & Rifai
  1990).

A wall of cells whose third edges are straight and across it, as an extruded surface's, passes the
patch test; one whose third edges lie askew in a cell does not. Indices are of the cell's edges, at
the point, where nothing else is said.

References: Dvorkin & Bathe 1984, doi:10.1108/eb023562; Betsch & Stein 1995,
doi:10.1002/cnm.1640110506; Buechter, Ramm & Roehl 1994, doi:10.1002/nme.1620371504; Simo & Rifai 1990,
doi:10.1002/nme.1620290802; Vu-Quoc & Tan 2003, doi:10.1016/S0045-7825(03)00336-8. Forms alone import it.
"""

from __future__ import annotations

from typing import NamedTuple

import basix.ufl
import ufl

from flexmbd.forms._shared import Expr, Quadrature, Terms

_FIELDS = 16  # constants of a cell: of shears, of shear stresses, of thickness stresses, of membrane strains; 4 each


class AssumedStrain(NamedTuple):
    """The assumed strain in place of the displacement's own.

    Attributes:
        strain: (3, 3), linear in the fields of the cell.
        ties: terms, J/m^3, whose stationary value ties the assumed strain to the displacement's; added to the energy.
    """

    strain: Expr
    ties: Terms


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Displacement, thickness strain, and the constants of a cell."""
    return basix.ufl.mixed_element([
        basix.ufl.element("Lagrange", cell, 1, shape=(gdim,)),
        basix.ufl.element("DG", cell, 1),
        basix.ufl.element("DG", cell, 0, shape=(_FIELDS,)),
    ])  # fmt: skip


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """The unknown of an infinitesimal rigid motion; the fields of the cell stay zero."""
    moved = translation + ufl.cross(rotation, x)
    return ufl.as_vector([moved[0], moved[1], moved[2], *[0.0] * (1 + _FIELDS)])


def displacement(w: Expr) -> Expr:
    """The displacement's part of the unknown."""
    return ufl.as_vector([w[i] for i in range(3)])


def assumed_strain(w: Expr, modulus: Expr, *, finite: bool) -> AssumedStrain:
    """The assumed strain of an unknown w.

    Args:
        w: of this ``element``.
        modulus: Pa, of the material; gives the stresses among the fields no dimension, and changes no result.
        finite: whether E is Green's and Lagrange's strain; else sym grad u, and so is the assumed one.
    """
    u, thickness, constants = ufl.split(w)
    domain = ufl.domain.extract_unique_domain(w)
    shear, force, across, membrane = (
        [constants[4 * i + k] for k in range(4)] for i in range(4)
    )
    centre, place = _centre(domain)
    over = ufl.inv(centre)
    edge = ufl.Jacobian(domain)
    dual = ufl.inv(edge)
    h = ufl.grad(u)
    own = (h + h.T + h.T * h) / 2 if finite else ufl.sym(h)
    size = [ufl.sqrt(ufl.dot(centre[:, k], centre[:, k])) for k in range(3)]
    side = [ufl.conditional(ufl.gt(place[k], 0.0), 1.0, -1.0) for k in range(2)]
    change = ufl.zero(3, 3)
    tie = 0.0
    for a in range(2):
        # a part that is a vector's lets constant strains stay so in cells that are askew in the wall's plane
        scale, b = size[a] * size[2], 1 - a
        vector = ufl.dot(edge[:, a], over[0, :] * size[0] * shear[0] + over[1, :] * size[1] * shear[1]) * size[2]
        have = ufl.dot(edge[:, a], own * edge[:, 2])
        change += (vector + scale * shear[2 + a] * place[b] - have) * _pair(dual[a, :], dual[2, :])
        # the mean over both ends of an edge is the value in its middle
        lack = (have - vector) / scale - shear[2 + a] * side[b]
        tie += (force[2 * a] + force[2 * a + 1] * side[b]) * lack
    square = ufl.dot(edge[:, 2], edge[:, 2])
    lack = ufl.dot(edge[:, 2], own * edge[:, 2]) / square - thickness
    change -= lack * square * ufl.outer(dual[2, :], dual[2, :])
    tie += (across[0] + across[1] * side[0] + across[2] * side[1] + across[3] * side[0] * side[1]) * lack
    ratio = ufl.det(centre) / ufl.JacobianDeterminant(domain)
    change += _membrane(membrane, place, over, size, ratio)
    return AssumedStrain(own + change, [(modulus * ratio * tie, Quadrature(1, "vertex"))])


def _pair(a: Expr, b: Expr) -> Expr:
    return ufl.outer(a, b) + ufl.outer(b, a)


def _centre(domain: ufl.Mesh) -> tuple[Expr, Expr]:
    """Edges at the cell's centre as columns, m, and places in their halves, -1 to 1 in a parallelepiped."""
    vertices = ufl.geometry.CellVertices(domain)
    corner = [ufl.as_vector([vertices[i, j] for j in range(3)]) for i in range(8)]
    middle = sum(corner[1:], corner[0]) / 8
    edges = []
    for k in range(3):
        # corner i lies at (i & 1, i >> 1 & 1, i >> 2) of the reference cell
        up = [corner[i] for i in range(8) if i >> k & 1]
        low = [corner[i] for i in range(8) if not i >> k & 1]
        edges.append((sum(up[1:], up[0]) - sum(low[1:], low[0])) / 4)
    centre = ufl.as_matrix([[edges[k][i] for k in range(3)] for i in range(3)])
    return centre, 2 * ufl.inv(centre) * (ufl.SpatialCoordinate(domain) - middle)


def _membrane(modes: list[Expr], place: Expr, over: Expr, size: list[Expr], stretch: Expr) -> Expr:
    """The incompatible membrane strain; its mean over the cell is zero."""
    shear = size[0] * size[1] * (modes[2] * place[0] + modes[3] * place[1])
    first, second = over[0, :], over[1, :]
    strain = size[0] ** 2 * modes[0] * place[0] * ufl.outer(first, first) + shear * _pair(first, second)
    return stretch * (strain + size[1] ** 2 * modes[1] * place[1] * ufl.outer(second, second))
