"""The shapes of a scene's groups of hard contacts as one table, by which their points are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.shape_tables import shape_table
from flexmbd.multibody.contact.shapes import TouchShape
from flexmbd.multibody.kernels.contact.finding.shape_table import new_contact_points, new_finding_work
from flexmbd.multibody.kernels.elements.hard_element import N_LAW
from flexmbd.multibody.kernels.impulses.group_points import ShapeGroups
from flexmbd.multibody.kernels.reading.force_tables import element_numbers, group_frames
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def groups_of(scene: CompiledScene) -> list[HardGroup]:
    """A scene's groups, in the order of their laws."""
    return [force for force in scene.index.forces if isinstance(force, HardGroup)]


def group_shapes(groups: list[HardGroup]) -> list[TouchShape]:
    """All shapes of the groups, each once, in the order of their table."""
    return list({id(shape): shape for group in groups for shape in group.shapes}.values())


def new_groups(scene: CompiledScene) -> ShapeGroups:
    """The table of a scene's groups.

    Raises:
        SceneError: two groups have laws for the same shapes; see ``shape_table``.
    """
    groups = groups_of(scene)
    shapes = group_shapes(groups)
    number = {id(shape): k for k, shape in enumerate(shapes)}
    sides: list[set[tuple[int, int]]] = [set() for _ in shapes]
    frame = np.zeros(len(shapes), np.int64)
    rows = [scene.index.forces[group].elements.start for group in groups]
    for g, (group, row) in enumerate(zip(groups, rows, strict=True)):
        for side, several in enumerate((group.one, group.other)):
            for shape in several:
                sides[number[id(shape)]].add((g, side))
        frame[[number[id(shape)] for shape in group.shapes]] = group_frames(scene.plan, row)
    kinds = list(dict.fromkeys(frozenset(one) for one in sides))
    laws = np.full((max(1, len(kinds)),) * 2, -1)
    for i, a in enumerate(kinds):
        for j, b in enumerate(kinds):
            both = {g for g, side in a if (g, 1 - side) in b}
            if len({groups[g].law for g in both}) > 1:
                raise SceneError(f"{groups[max(both)].what}: some of these shapes touch by another law already")
            laws[i, j] = min(both, default=-1)
    now = [replace(one, frame=scene.index.frame_now(one.frame)) for one in shapes]  # type: ignore[type-var]
    places = {kind: k for k, kind in enumerate(kinds)}
    body = scene.index.bodies
    original = {id(a.frame.body): b.frame.body for a, b in zip(now, shapes, strict=True)}
    table = shape_table(
        now, body_of=lambda one: body[original.get(id(one), one)],
        groups=[places[frozenset(one)] for one in sides] if shapes else None, laws=laws,
        excluded=_joined(groups, shapes),
    )  # fmt: skip
    n = len(scene.plan.tree)
    law = np.array([group.law.numbers for group in groups]).reshape(-1, N_LAW)
    return ShapeGroups(
        table, new_finding_work(table), new_contact_points(8 * len(shapes)), frame, law,
        element_numbers(scene.plan, rows), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)),
    )  # fmt: skip


def _joined(groups: list[HardGroup], shapes: list[TouchShape]) -> list[tuple[int, int]]:
    """Pairs of numbers of shapes on bodies that a joint joins."""
    on: dict[int, list[int]] = {}
    for k, shape in enumerate(shapes):
        on.setdefault(id(shape.frame.body), []).append(k)
    pairs: dict[tuple[int, int], tuple[Body, Body]] = {}
    for group in groups:
        pairs.update({(id(a), id(b)): (a, b) for a, b in group.joined})
    return [(i, j) for a, b in pairs for i in on.get(a, []) for j in on.get(b, [])]
