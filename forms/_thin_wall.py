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

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import basix.ufl
import ufl

from flexmbd.forms._shared import Expr, Quadrature, Terms

_FIELDS = 16  # constants of a cell: of shears, of shear stresses, of thickness stresses, of membrane strains; 4 each


class _StrainPart(NamedTuple):
    """A part of the assumed strain: an amount times a tensor, in place of what the displacement's strain has of it.

    Attributes:
        tensor: (3, 3), symmetric.
        amount: of the fields of the cell, linear in them.
        edges: (3,) each, between which the displacement's strain is taken; None: the part is on top of it.
    """

    tensor: Expr
    amount: Callable[[_Fields], Expr]
    edges: tuple[Expr, Expr] | None


class _Tie(NamedTuple):
    """What ties the displacement's strain to the assumed one in a corner: a stress times what one lacks of the other.

    Attributes:
        stress: of the fields of the cell, linear in them.
        edges: (3,) each, between which the displacement's strain is taken.
        over: m^2, by which that is divided.
        given: what the fields of the cell say it is, linear in them.
    """

    stress: Callable[[_Fields], Expr]
    edges: tuple[Expr, Expr]
    over: Expr
    given: Callable[[_Fields], Expr]


class AssumedStrain(NamedTuple):
    """The assumed strain in place of the displacement's own.

    Attributes:
        strain: (3, 3), linear in the fields of the cell.
        ties: terms, J/m^3, whose stationary value ties the assumed strain to the displacement's; added to the energy.
        virtual_work: of a symmetric stress (3, 3), Pa, and a virtual unknown: work on the strain's variation, J/m^3.
        virtual_ties: of a virtual unknown, the variation of ``ties``.
    """

    strain: Expr
    ties: Terms
    virtual_work: Callable[[Expr, Expr], Expr]
    virtual_ties: Callable[[Expr], Terms]


class _Fields(NamedTuple):
    """The fields of the cell: thickness strain; constants of shears, of both kinds of ties, of membrane strains."""

    thickness: Expr
    shear: list[Expr]
    force: list[Expr]
    across: list[Expr]
    membrane: list[Expr]


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
    domain = ufl.domain.extract_unique_domain(w)
    centre, place = _centre(domain)
    over = ufl.inv(centre)
    edge, fields = ufl.Jacobian(domain), _fields(w)
    h = ufl.grad(displacement(w))
    own = (h + h.T + h.T * h) / 2 if finite else ufl.sym(h)
    size = [ufl.sqrt(ufl.dot(centre[:, k], centre[:, k])) for k in range(3)]
    ratio = ufl.det(centre) / ufl.JacobianDeterminant(domain)
    parts = [*_edge_parts(edge, over, size, place), *_membrane(place, over, size, ratio)]
    ties = _ties(edge, over, size, place)
    corners = Quadrature(1, "vertex")

    def between(edges: tuple[Expr, Expr]) -> Expr:
        return ufl.dot(edges[0], own * edges[1])

    def lack(tie: _Tie) -> Expr:
        return between(tie.edges) / tie.over - tie.given(fields)

    def on_own(stress: Expr, v: Expr) -> Expr:
        return ufl.inner((ufl.Identity(3) + h) * stress if finite else stress, ufl.grad(displacement(v)))

    def virtual_work(stress: Expr, v: Expr) -> Expr:
        # numbers are multiplied before tensors are: by the chain rule outwards there would be many times the products
        varied, left, work = _fields(v), stress, 0.0
        for part in parts:
            amount = ufl.inner(stress, part.tensor)
            work += amount * part.amount(varied)
            if part.edges is not None:
                left -= amount * ufl.sym(ufl.outer(*part.edges))
        return work + on_own(left, v)

    def virtual_ties(v: Expr) -> Terms:
        varied, left, work = _fields(v), ufl.zero(3, 3), 0.0
        for tie in ties:
            stress = tie.stress(fields)
            work += tie.stress(varied) * lack(tie) - stress * tie.given(varied)
            left += stress / tie.over * ufl.sym(ufl.outer(*tie.edges))
        return [(modulus * ratio * (work + on_own(left, v)), corners)]

    change = sum(
        (part.amount(fields) - (0.0 if part.edges is None else between(part.edges))) * part.tensor for part in parts
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


def _edge_parts(edge: Expr, over: Expr, size: list[Expr], place: Expr) -> Iterator[_StrainPart]:
    """Transverse shear and thickness strain."""
    dual = ufl.inv(edge)
    for a in range(2):
        scale, vector = size[a] * size[2], _shear_vector(edge, over, size, a)

        def shear(fields: _Fields, a: int = a, scale: Expr = scale, vector: Any = vector) -> Expr:
            return vector(fields) + scale * fields.shear[2 + a] * place[1 - a]

        yield _StrainPart(_pair(dual[a, :], dual[2, :]), shear, (edge[:, a], edge[:, 2]))
    square = ufl.dot(edge[:, 2], edge[:, 2])
    yield _StrainPart(
        ufl.outer(dual[2, :], dual[2, :]), lambda fields: fields.thickness * square, (edge[:, 2], edge[:, 2])
    )


def _ties(edge: Expr, over: Expr, size: list[Expr], place: Expr) -> list[_Tie]:
    """Of both transverse shears and of the thickness strain."""
    side = [ufl.conditional(ufl.gt(place[k], 0.0), 1.0, -1.0) for k in range(2)]
    found = []
    for a in range(2):
        scale, vector = size[a] * size[2], _shear_vector(edge, over, size, a)

        def stress(fields: _Fields, a: int = a) -> Expr:
            # the mean over both ends of an edge is the value in its middle
            return fields.force[2 * a] + fields.force[2 * a + 1] * side[1 - a]

        def given(fields: _Fields, a: int = a, scale: Expr = scale, vector: Any = vector) -> Expr:
            return vector(fields) / scale + fields.shear[2 + a] * side[1 - a]

        found.append(_Tie(stress, (edge[:, a], edge[:, 2]), scale, given))

    def across(fields: _Fields) -> Expr:
        first, second, third, both = fields.across
        return first + second * side[0] + third * side[1] + both * side[0] * side[1]

    square = ufl.dot(edge[:, 2], edge[:, 2])
    return [*found, _Tie(across, (edge[:, 2], edge[:, 2]), square, lambda fields: fields.thickness)]


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
        _StrainPart(ufl.outer(first, first), lambda f: stretch * size[0] ** 2 * place[0] * f.membrane[0], None),
        _StrainPart(_pair(first, second), shear, None),
        _StrainPart(ufl.outer(second, second), lambda f: stretch * size[1] ** 2 * place[1] * f.membrane[1], None),
    ]
