"""Welds: nodes of a part that are tied to facets of another, or of the same, along an edge, a face or at spots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.interface import AveragedInterface, mesh_group
from flexmbd.continuum.finite_elements.nodal_ties import Tie, bound_ties, told_place
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.weld_places import FoundPlaces, find_places
from flexmbd.continuum.grid.pieces import pieces
from flexmbd.errors import MeshError
from flexmbd.given import checked, is_list, numbers, shown
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Nodes of a spot that lie as near to a line, of their extent.
_HINGE = 1e-3


@checked("nodes", "facets", "within", "radius", error=MeshError)
@dataclass(frozen=True, eq=False)
class Weld:
    """Nodes of a group that follow facets which they lie on, or near.

    A node moves as the material of the cell behind the nearest facet does at its place, extrapolated where it lies off
    the facet: rigid motions cost nothing, however large, and an offset turns with the facet. Its own displacement is
    no unknown any more. Take the finer mesh's nodes, and the facets of the coarser or stiffer side. A node that several
    welds of a model take, as in the corner of a bulkhead, follows by the first of them.

    Attributes:
        nodes: the group of facets, edges, vertices or cells whose nodes follow.
        facets: the group of facets that they follow.
        within: how far from its facet a node may lie at most, in sizes of the facet, the root of its area.
        points: (n, 3) m, middles of spot welds, at which alone the nodes follow; None: all do.
        radius: m, of the spots.

    Raises:
        MeshError: a distance that is not positive, points that are no points, or a radius without points.
    """

    nodes: str
    facets: str
    within: float = 0.1
    points: ArrayLike | None = None
    radius: float | None = None

    def __post_init__(self) -> None:
        if not self.within > 0.0:
            raise MeshError(f"{self}: within must be positive, in sizes of a facet, got {self.within!r}")
        if (self.points is None) != (self.radius is None):
            raise MeshError(f"{self}: spots have both, points=[(x, y, z), ...] and radius= (m); give both or none")
        if self.points is None:
            return
        found = numbers(self.points)
        if found.ndim != 2 or found.shape[1:] != (3,) or not len(found) or not np.isfinite(found).all():
            raise MeshError(f"{self}: points must be places (n, 3) in m, got {shown(self.points)}")
        if not (self.radius is not None and self.radius > 0.0):
            raise MeshError(f"{self}: the radius of spots must be positive (m), got {self.radius!r}")

    def __str__(self) -> str:
        """What is welded to what."""
        return f"weld of {self.nodes!r} to {self.facets!r}"


def with_welds(forms: DiscreteForms, welds: Sequence[Weld]) -> DiscreteForms:
    """Formulations on a mesh with the ties of welds. Collective.

    Args:
        forms: without.
        welds: the same on all ranks.

    Raises:
        MeshError: on all ranks: what is no weld, or not the same on all ranks; an unknown or empty group; cells that
            are no solids, or unknowns besides the displacement; nodes that are too far from the facets, or in a
            circle; a weld all of whose nodes follow by welds before it; a spot of fewer than three nodes, or larger
            than the group; nodes that an interface holds; pieces of the mesh that can move against each other.
    """
    described = [_described(one) for one in welds] if is_list(welds) else repr(welds)
    parallel.check_same(forms.comm, MeshError, welds=described)
    if not is_list(welds) or not all(isinstance(one, Weld) for one in welds):
        raise MeshError(f'welds must be a list, as welds=[Weld("web.bottom", "flange.top")], got {welds!r:.100}')
    if welds and forms.mesh.dim < 3:
        raise MeshError(f"{welds[0]}: the cells of the mesh are no solids; make a wall of them (meshes.wall)")
    if welds and forms.layout.has_further:
        raise MeshError(
            f"{welds[0]}: {forms.form_name} has unknowns besides the displacement, which a weld does not join; take a "
            "formulation of displacements, or mesh the parts in one"
        )
    if not welds:
        _refuse_loose(forms, None, ())
        return forms
    known = node_numbers(forms)
    ties = _first_of_each([_ties(one, forms, known) for one in welds])
    ties = _without_held(ties, forms, known)
    found = bound_ties(ties, comm=forms.comm, layout=forms.layout, numbers=known, kind=MeshError)
    _refuse_loose(forms, known, ties)
    return replace(forms, ties=found)


def _described(weld: object) -> str:
    if not isinstance(weld, Weld):
        return repr(weld)
    points = None if weld.points is None else numbers(weld.points).tolist()
    return f"{weld} {weld.within!r} {points} {weld.radius!r}"


def _ties(weld: Weld, forms: DiscreteForms, known: IntArray) -> list[Tie]:
    """The ties of a weld, the same on all ranks, in the order of the nodes. Collective."""
    mesh, layout, comm = forms.mesh, forms.layout, forms.comm
    groups = {**mesh.facet_groups, **mesh.edge_groups, **mesh.vertex_groups, **mesh.cell_groups}
    for name, there in ((weld.nodes, groups), (weld.facets, mesh.facet_groups)):
        if name not in there:
            kinds = "facets" if there is mesh.facet_groups else "facets, edges, vertices or cells"
            listed = ", ".join(map(repr, sorted(there))) or "none"
            raise MeshError(f"{weld}: the mesh has no group {name!r} of {kinds}; it has: {listed}")
    group = mesh_group(weld.nodes, mesh)
    mesh.mesh.topology.create_connectivity(2, 3)
    nodes = layout.nodes_on(group.dim, group.entities)
    facing = layout.nodes_on(2, mesh.facets(weld.facets))
    held = np.unique(np.concatenate(comm.allgather(known[facing])))
    mine = nodes[(nodes < layout.n_owned_nodes) & ~np.isin(known[nodes], held)]
    every = [np.concatenate(part) for part in zip(*comm.allgather((known[mine], layout.node_x[mine])), strict=True)]
    order = np.argsort(every[0])
    numbers_of, x = every[0][order], every[1][order]
    if not len(x):
        raise MeshError(f"{weld}: all nodes of {weld.nodes!r} are nodes of {weld.facets!r} already; leave the weld out")
    if weld.points is not None:
        chosen = np.unique(np.concatenate([*_spots(weld, x)]))
        _refuse_large_spots(weld, x)
        numbers_of, x = numbers_of[chosen], x[chosen]
    found = find_places(forms, weld.facets, x, known)
    _refuse_gaps(weld, numbers_of, x, found)
    return [
        Tie(str(weld), int(number), place, leaders, weights)
        for number, place, leaders, weights in zip(numbers_of, x, found.nodes, found.weights, strict=True)
    ]


def _spots(weld: Weld, x: FloatArray) -> Iterator[IntArray]:
    """Which of the nodes at x (n, 3) m each spot holds."""
    radius = 0.0 if weld.radius is None else weld.radius
    for point in numbers([] if weld.points is None else weld.points):
        far = np.linalg.norm(x - point, axis=1)
        inside = np.flatnonzero(far <= radius * (1.0 + SEVEN_DIGITS))
        arms = x[inside] - x[inside].mean(axis=0) if len(inside) else x[:0]
        spread = np.linalg.svd(arms, compute_uv=False) if len(inside) > 2 else np.zeros(3)
        if not spread[1] > _HINGE * max(spread[0], radius):
            third = np.sort(far)[2] if len(far) > 2 else np.inf
            raise MeshError(
                f"{weld}: {len(inside)} nodes lie within {radius:g} m of the spot at {told_place(point)} m, and it "
                f"needs three that are not in one line, for fewer are a hinge; the third is {third:.4g} m away: take "
                "a larger radius, or smaller cells"
            )
        yield inside


def _refuse_large_spots(weld: Weld, x: FloatArray) -> None:
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    if weld.radius is not None and weld.radius > extent:
        raise MeshError(
            f"{weld}: spots of the radius {weld.radius:g} m are larger than {weld.nodes!r}, whose nodes lie "
            f"{extent:.4g} m apart at most: give the radius in m, or neither points nor radius, and all nodes follow"
        )


def _refuse_gaps(weld: Weld, numbers_of: IntArray, x: FloatArray, found: FoundPlaces) -> None:
    far = ~(found.gaps <= weld.within * found.sizes)
    if not far.any():
        return
    worst = int(np.where(far, found.gaps, -1.0).argmax())
    gap, size = found.gaps[worst], found.sizes[worst]
    raise MeshError(
        f"{weld}: {far.sum()} of {len(far)} nodes lie off the facets; the greatest gap is {gap:.4g} m, of node "
        f"{numbers_of[worst]} at {told_place(x[worst])} m, beside a facet of the size {size:.4g} m: bring the "
        f"parts together, take the group that lies there, or allow for it, within={1.05 * gap / size:.3g} (now "
        f"{weld.within:g})"
    )


def _first_of_each(several: Sequence[list[Tie]]) -> list[Tie]:
    """The ties of several welds, of a node that several want that of the first weld."""
    taken: dict[int, Tie] = {}
    for ties in several:
        if all(tie.node in taken for tie in ties):
            others = " and the ".join(dict.fromkeys(taken[tie.node].weld for tie in ties))
            raise MeshError(
                f"{ties[0].weld}: all of its {len(ties)} nodes follow already, by the {others}, and a node follows one "
                "facet alone; leave the weld out, or take the nodes of its other side"
            )
        for tie in ties:
            taken.setdefault(tie.node, tie)
    return list(taken.values())


def _without_held(ties: Sequence[Tie], forms: DiscreteForms, known: IntArray) -> list[Tie]:
    """The ties that interfaces do not hold already: those of nodes of one frame among themselves. Collective."""
    frames = {}
    for found in forms.interfaces:
        nodes = np.concatenate(forms.comm.allgather(known[found.nodes]))
        frames[found.name] = set(nodes.tolist()), isinstance(found, AveragedInterface)
    kept = []
    for tie in ties:
        on = [(name, nodes, averaged) for name, (nodes, averaged) in frames.items() if tie.node in nodes]
        if not on:
            kept.append(tie)
            continue
        name, nodes, averaged = on[0]
        if averaged or not all(int(leader) in nodes for leader in tie.leaders):
            raise MeshError(
                f"{tie.weld}: node {tie.node} at {told_place(tie.place)} m is one of interface {name!r}, which says by "
                "itself how it moves; end the weld before it, let the other side follow, or take both sides into the "
                "interface, Coupling.RIGID"
            )
    return kept


def _refuse_loose(forms: DiscreteForms, known: IntArray | None, ties: Sequence[Tie]) -> None:
    """Refuse pieces of a mesh that can move against each other as rigid bodies. Collective."""
    mesh, comm = forms.mesh, forms.comm
    if not mesh.in_pieces:
        return
    found = pieces(mesh.mesh)
    if not ties or known is None:
        raise MeshError(
            f"the mesh is {found.count} parts that nothing joins; weld them, as welds=[Weld(nodes, facets)], or make a "
            "body of each"
        )
    dofmap, owned = forms.layout.node_space.dofmap.list, len(found.of_cells)
    of_node = np.full(1 + max(comm.allgather(int(known.max(initial=-1)))), -1)
    of_node[known[dofmap[:owned]]] = found.of_cells[:, None]
    of_node = np.maximum.reduce(comm.allgather(of_node))
    x = np.array([tie.place for tie in ties])
    x -= x.mean(axis=0)
    sides = np.array([(of_node[tie.node], of_node[tie.leaders[0]]) for tie in ties])
    # of each tie what it opens by each piece's translation, and turn about the middle of its own seams in their size
    rows = np.zeros((len(ties), 3, found.count, 6))
    back = np.tile(np.eye(6), (found.count, 1, 1))  # of a piece's motion that of the middle of all, and its turn
    for piece in range(found.count):
        seams = (sides == piece).any(axis=1)
        if not seams.any():
            continue
        middle, size = x[seams].mean(axis=0), np.ptp(x[seams], axis=0).max() or 1.0
        moved = np.zeros((seams.sum(), 3, 6))
        moved[:, :, :3] = np.eye(3)
        moved[:, :, 3:] = -np.cross(np.eye(3), (x[seams, None] - middle) / size)
        rows[seams, :, piece] += ((sides[seams] == piece) @ (1.0, -1.0))[:, None, None] * moved
        back[piece, :3, 3:] = np.cross(np.eye(3), middle / size)
        back[piece, 3:, 3:] /= size
    values, shapes = np.linalg.svd(np.linalg.qr(rows.reshape(3 * len(ties), -1), mode="r"))[1:]
    opened = np.zeros(6 * found.count)
    opened[: len(values)] = values
    loose = opened <= SEVEN_DIGITS * opened[0]
    if loose.sum() <= 6:
        return
    # what moves against the piece of most cells
    free = np.einsum("pij,kpj->kpi", back, shapes[loose].reshape(-1, found.count, 6))
    most = int(np.argmax(found.cells))
    apart = free - free[:, most : most + 1]
    apart[..., 3:] *= np.ptp(x, axis=0).max()
    moves = np.linalg.norm(apart, axis=(0, 2))
    k = int(moves.argmax())
    raise MeshError(
        f"the welds leave the part around {told_place(found.middles[k])} m ({found.cells[k]} cells) free to move, or "
        "to turn about a line as on a hinge: weld it along more than one straight line of nodes, as the facets of an "
        "edge's whole thickness"
    )
