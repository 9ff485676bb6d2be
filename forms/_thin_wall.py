"""The strain of a thin brick that does not lock: a solid-shell of eight nodes.

Its third edges go through the thickness of the wall.

The displacement's own strain E of a trilinear brick locks where walls are thin and curved. In its
place stand fields of the cell (Hu & Washizu: an assumed strain, and the stress that ties it to the
displacement's):

- transverse shear: E_13 and E_23 in the middle of the cell's edges, between which they are linear
  (Dvorkin & Bathe 1984); neighbours share these values, so that cells may be askew;
- thickness strain: E_33 at the corners, between which it is bilinear (Betsch & Stein 1995), and
  besides linear through the thickness, where the stress has no say (Buechter, Ramm & Roehl 1994); or, where walls
  bend far and yield, the change of volume in its place, as flow keeps that: sqrt(C_33) times the area in the wall,
  which it is but for transverse shear;
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

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import basix.ufl
import ufl

from flexmbd.forms._shared import Expr, Quadrature, Terms

_FIELDS = 16  # constants of a cell: of shears, of shear stresses, of thickness stresses, of membrane strains; 4 each


class _StrainPart(NamedTuple):
    """A part of the assumed strain: an amount times a tensor.

    Attributes:
        tensor: (3, 3), symmetric.
        amount: of the fields of the cell, linear in them.
    """

    tensor: Expr
    amount: Callable[[_Fields], Expr]


class _Tie(NamedTuple):
    """What ties the displacement's strain to the assumed one in a corner: a stress times what one lacks of the other.

    Attributes:
        stress: of the fields of the cell, linear in them.
        have: of the displacement's strain.
        slope: (3, 3), symmetric, the derivative of ``have`` by that strain.
        given: what the fields of the cell say it is, linear in them.
    """

    stress: Callable[[_Fields], Expr]
    have: Expr
    slope: Expr
    given: Callable[[_Fields], Expr]


class _Thickness(NamedTuple):
    """E_33 over the square of the third edge, as a function of a field and of the strain in the wall.

    Attributes:
        strain: its value.
        by_field: its derivative by the field.
        by_wall: (3, 3), symmetric, its derivative by the strain in the wall.
    """

    strain: Expr
    by_field: Expr
    by_wall: Expr


class AssumedStrain(NamedTuple):
    """The assumed strain in place of the displacement's own.

    Attributes:
        strain: (3, 3).
        ties: terms, J/m^3, whose stationary value ties the assumed strain to the displacement's; added to the energy.
        virtual_work: of a symmetric stress (3, 3), Pa, and a virtual unknown: work on the strain's variation, J/m^3.
        virtual_ties: of a virtual unknown, the variation of ``ties``.
    """

    strain: Expr
    ties: Terms
    virtual_work: Callable[[Expr, Expr], Expr]
    virtual_ties: Callable[[Expr], Terms]


class _Fields(NamedTuple):
    """The fields of the cell: of the thickness; constants of shears, of both kinds of ties, of membrane strains."""

    thickness: Expr
    shear: list[Expr]
    force: list[Expr]
    across: list[Expr]
    membrane: list[Expr]


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Displacement, the field of the thickness, and the constants of a cell."""
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


def assumed_strain(w: Expr, modulus: Expr, *, by_volume: bool = False) -> AssumedStrain:
    """The assumed strain of an unknown w, Green's and Lagrange's.

    Args:
        w: of this ``element``.
        modulus: Pa, of the material; gives the stresses among the fields no dimension, and changes no result.
        by_volume: whether the field of the thickness is the change of volume but for transverse shear; else E_33.
    """
    domain = ufl.domain.extract_unique_domain(w)
    centre, place = _centre(domain)
    over = ufl.inv(centre)
    edge, fields = ufl.Jacobian(domain), _fields(w)
    h = ufl.grad(displacement(w))
    own = (h + h.T + h.T * h) / 2
    size = [ufl.sqrt(ufl.dot(centre[:, k], centre[:, k])) for k in range(3)]
    ratio = ufl.det(centre) / ufl.JacobianDeterminant(domain)
    dual, square = ufl.inv(edge), ufl.dot(edge[:, 2], edge[:, 2])
    normal, third = ufl.outer(dual[2, :], dual[2, :]), ufl.outer(edge[:, 2], edge[:, 2])
    shears, modes = list(_shears(edge, dual, over, size, place)), _membrane(place, over, size, ratio)
    slanted = [ufl.sym(ufl.outer(edge[:, a], edge[:, 2])) for a in range(2)]
    membrane = sum(mode.amount(fields) * mode.tensor for mode in modes)
    # modes change the volume by their trace, whose mean is zero; the tie has none of them
    swells = ufl.Identity(3) if by_volume else ufl.zero(3, 3)
    field = fields.thickness + ufl.inner(swells, membrane)
    across = _at_volume(field, *_area(edge, own + membrane)) if by_volume else _as_given(field)
    have = _volume(edge, own) if by_volume else (ufl.inner(third, own) / square, third / square)
    ties = [*_shear_ties(own, slanted, edge, over, size, place)]
    ties.append(_Tie(_thickness_stress(place), *have, lambda f: f.thickness))
    corners = Quadrature(1, "vertex")

    def lack(tie: _Tie) -> Expr:
        return tie.have - tie.given(fields)

    def on_own(stress: Expr, v: Expr) -> Expr:
        return ufl.inner((ufl.Identity(3) + h) * stress, ufl.grad(displacement(v)))

    def virtual_work(stress: Expr, v: Expr) -> Expr:
        # numbers are multiplied before tensors are: by the chain rule outwards there would be many times the products
        varied, through = _fields(v), ufl.inner(stress, normal)
        on_field, on_wall = through * square * across.by_field, stress + through * square * across.by_wall
        work, left = on_field * varied.thickness, on_wall - through * third
        for shear, slant in zip(shears, slanted, strict=True):
            amount = ufl.inner(stress, shear.tensor)
            work += amount * shear.amount(varied)
            left -= amount * slant
        on_modes = on_wall + on_field * swells
        for mode in modes:
            work += ufl.inner(on_modes, mode.tensor) * mode.amount(varied)
        return work + on_own(left, v)

    def virtual_ties(v: Expr) -> Terms:
        varied, left, work = _fields(v), ufl.zero(3, 3), 0.0
        for tie in ties:
            stress = tie.stress(fields)
            work += tie.stress(varied) * lack(tie) - stress * tie.given(varied)
            left += stress * tie.slope
        return [(modulus * ratio * (work + on_own(left, v)), corners)]

    change = membrane + (square * across.strain - ufl.inner(third, own)) * normal
    change += sum(
        (shear.amount(fields) - ufl.inner(slant, own)) * shear.tensor
        for shear, slant in zip(shears, slanted, strict=True)
    )
    tie = sum(tie.stress(fields) * lack(tie) for tie in ties)
    return AssumedStrain(own + change, [(modulus * ratio * tie, corners)], virtual_work, virtual_ties)


def _fields(w: Expr) -> _Fields:
    return _Fields(w[3], *([w[4 + 4 * i + k] for k in range(4)] for i in range(_FIELDS // 4)))


def _shear_vector(edge: Expr, over: Expr, size: list[Expr], a: int) -> Callable[[_Fields], Expr]:
    """The part of a transverse shear that is a vector's: it lets constant strains stay so in cells that are askew."""

    def vector(fields: _Fields) -> Expr:
        along = over[0, :] * size[0] * fields.shear[0] + over[1, :] * size[1] * fields.shear[1]
        return ufl.dot(edge[:, a], along) * size[2]

    return vector


def _as_given(field: Expr) -> _Thickness:
    return _Thickness(field, ufl.as_ufl(1.0), ufl.zero(3, 3))


def _at_volume(field: Expr, area: Expr, by_wall: Expr) -> _Thickness:
    """C_33 A^2 = (1 + field)^2, with the area A of ``_area``."""
    swollen, squared = 1 + field, 1 + 2 * area
    strain = (field + field**2 / 2 - area) / squared
    return _Thickness(strain, swollen / squared, -(swollen**2) / squared**2 * by_wall)


def _volume(edge: Expr, strain: Expr) -> tuple[Expr, Expr]:
    """A sqrt(C_33) - 1 of a strain, the change of volume without transverse shear, and its derivative by the strain."""
    area, by_wall = _area(edge, strain)
    square = ufl.dot(edge[:, 2], edge[:, 2])
    through = ufl.dot(edge[:, 2], strain * edge[:, 2]) / square
    grown = area + (1 + 2 * area) * through
    volume = ufl.sqrt(1 + 2 * grown)
    slope = (1 + 2 * through) * by_wall + (1 + 2 * area) / square * ufl.outer(edge[:, 2], edge[:, 2])
    return 2 * grown / (volume + 1), slope / volume


def _area(edge: Expr, strain: Expr) -> tuple[Expr, Expr]:
    """Of a strain in the wall (A^2 - 1) / 2, with the area A over the initial one, and its derivative by the strain."""
    g = [[ufl.dot(edge[:, a], edge[:, b]) for b in range(2)] for a in range(2)]
    e = [[ufl.dot(edge[:, a], strain * edge[:, b]) for b in range(2)] for a in range(2)]
    initial = g[0][0] * g[1][1] - g[0][1] ** 2
    change = g[1][1] * e[0][0] + g[0][0] * e[1][1] - 2 * g[0][1] * e[0][1] + 2 * (e[0][0] * e[1][1] - e[0][1] ** 2)
    c = [[g[a][b] + 2 * e[a][b] for b in range(2)] for a in range(2)]
    slope = c[1][1] * ufl.outer(edge[:, 0], edge[:, 0]) + c[0][0] * ufl.outer(edge[:, 1], edge[:, 1])
    slope -= c[0][1] * _pair(edge[:, 0], edge[:, 1])
    return change / initial, slope / initial


def _shears(edge: Expr, dual: Expr, over: Expr, size: list[Expr], place: Expr) -> Iterator[_StrainPart]:
    """Transverse shears."""
    for a in range(2):
        scale, vector = size[a] * size[2], _shear_vector(edge, over, size, a)

        def shear(fields: _Fields, a: int = a, scale: Expr = scale, vector: Any = vector) -> Expr:
            return vector(fields) + scale * fields.shear[2 + a] * place[1 - a]

        yield _StrainPart(_pair(dual[a, :], dual[2, :]), shear)


def _sides(place: Expr) -> list[Expr]:
    return [ufl.conditional(ufl.gt(place[k], 0.0), 1.0, -1.0) for k in range(2)]


def _shear_ties(
    own: Expr, slanted: list[Expr], edge: Expr, over: Expr, size: list[Expr], place: Expr
) -> Iterator[_Tie]:
    """Of both transverse shears, which are the products of ``own`` with two tensors ``slanted``."""
    side = _sides(place)
    for a in range(2):
        scale, vector = size[a] * size[2], _shear_vector(edge, over, size, a)

        def stress(fields: _Fields, a: int = a) -> Expr:
            # the mean over both ends of an edge is the value in its middle
            return fields.force[2 * a] + fields.force[2 * a + 1] * side[1 - a]

        def given(fields: _Fields, a: int = a, scale: Expr = scale, vector: Any = vector) -> Expr:
            return vector(fields) / scale + fields.shear[2 + a] * side[1 - a]

        slope = slanted[a] / scale
        yield _Tie(stress, ufl.inner(slope, own), slope, given)


def _thickness_stress(place: Expr) -> Callable[[_Fields], Expr]:
    """Of a corner; the mean over both ends of an edge through the thickness is tied, for it is theirs."""
    side = _sides(place)

    def across(fields: _Fields) -> Expr:
        first, second, third, both = fields.across
        return first + second * side[0] + third * side[1] + both * side[0] * side[1]

    return across


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


def _membrane(place: Expr, over: Expr, size: list[Expr], stretch: Expr) -> list[_StrainPart]:
    """The incompatible membrane strain; its mean over the cell is zero."""
    first, second = over[0, :], over[1, :]

    def shear(fields: _Fields) -> Expr:
        return stretch * size[0] * size[1] * (fields.membrane[2] * place[0] + fields.membrane[3] * place[1])

    return [
        _StrainPart(ufl.outer(first, first), lambda f: stretch * size[0] ** 2 * place[0] * f.membrane[0]),
        _StrainPart(_pair(first, second), shear),
        _StrainPart(ufl.outer(second, second), lambda f: stretch * size[1] ** 2 * place[1] * f.membrane[1]),
    ]
