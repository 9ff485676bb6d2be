"""The impulses of hard contacts over a run's rows: its steps are taken once more, each from the row where it began."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import set_row_scales
from flexmbd.integrate.moreau.impact import STRUCK_IMPULSE, STRUCK_NORMAL
from flexmbd.integrate.moreau.moreau_jean import new_workspace, with_room
from flexmbd.integrate.moreau.shape_groups import group_shapes, groups_of
from flexmbd.integrate.moreau.step import (
    TOLD_FORCE,
    TOLD_FRICTION,
    TOLD_NORMAL,
    TOLD_SLIP,
    MoreauWorkspace,
    repeat,
)
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.contact_series import IMPULSE, N_TOLD_PAIR, WORKS, HardGroupSeries
from flexmbd.run.impacts import struck
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.series.departure import Departure
from flexmbd.run.snapshot import bound_by_span, new_groups

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FoundPoints:
    """The points of groups, k of all rows one after the other; vectors in inertial axes.

    Attributes:
        row: (k,) of the trajectory, at the end of the step.
        shapes: (k, 2) in the table of all groups; group: (k,) which one's law holds.
        point, normal: (k, 3) m; out of the second shape.  gap: (k,) m, in the middle of the step.
        force, slip: (k, 3) N on the first shape, m/s at the end of the step.
        works: (k, 2) J, of normal forces and of friction, in the step.
    """

    row: IntArray
    shapes: IntArray
    group: IntArray
    point: FloatArray
    normal: FloatArray
    gap: FloatArray
    force: FloatArray
    slip: FloatArray
    works: FloatArray


@dataclass(frozen=True, eq=False)
class RepeatedImpulses:
    """What hard contacts did.

    Attributes:
        pairs: (nt, n, N_TOLD_PAIR) force (N, inertial axes) on the sphere in the step that ends at a row, works (J)
            since the start, impulse (N s) in the step.
        groups: the points of groups.
    """

    pairs: FloatArray
    groups: FoundPoints


def repeated_impulses(
    scene: CompiledScene, t: FloatArray, x: FloatArray, v: FloatArray, departures: Sequence[Departure], *, rtol: float
) -> RepeatedImpulses:
    """Take the steps again, impulses to ``rtol``; ``scene`` with the kept rows; t (nt,) s, x (nt, nx), v (nt, nv).

    Functions of time are evaluated anew.

    Raises:
        SceneError: a function of the user failed, or a step that a run took cannot be repeated.
    """
    work = new_work(scene.plan)
    s = new_workspace(scene, work)
    pairs = len(s.watched.element)
    told, found = np.zeros((len(t), pairs, N_TOLD_PAIR)), [_points(s, 0, np.zeros(0, np.int64))]
    number, count = np.zeros(st.N_NUMBER), np.zeros(st.N_COUNT, np.int64)
    bound_by_span(number, t_start=float(t[0]), t_end=float(t[-1]) or 1.0, h=float(np.diff(t).max(initial=1e-300)))
    number[st.TOLERANCE], number[st.LATEST], count[st.FIXED_STEP] = rtol, np.inf, 1
    state = st.State(x[0].copy(), v[0].copy(), np.zeros(scene.nv), np.zeros(len(scene.plan.rows)), number, count)
    departing = v.copy()
    for one in departures:
        departing[one.row] = one.v
    scene.forget_failure()
    evaluate_inputs(scene, work, float(t[0]))
    set_row_scales(scene, s.machine.loops, state, work)
    scales = new_groups(scene)
    for r in np.flatnonzero(np.diff(t) > 0.0):
        while (code := repeat(s, state, scales, t[r], t[r + 1], x[r], departing[r])) == st.NO_ROOM:
            s = with_room(s)
        scene.refuse_failed(work)
        if code != st.DONE:
            raise SceneError(f"the step from t = {t[r]:.6g} s cannot be repeated, so that no impulses are known")
        n = int(s.contacts.count[0])
        of = s.contacts.watched[:n]
        told[r + 1, of[of < pairs], :IMPULSE] = s.told[:n][of < pairs, :IMPULSE]
        found.append(_points(s, int(r) + 1, np.flatnonzero(of >= pairs)))
    told[1:, :, IMPULSE:] = np.diff(t)[:, None, None] * told[1:, :, :WORKS]
    told[:, :, WORKS:IMPULSE] = np.cumsum(told[:, :, WORKS:IMPULSE], axis=0)
    columns = [np.concatenate(parts) for parts in zip(*found, strict=True)]
    return RepeatedImpulses(told, FoundPoints(*columns))


def _points(s: MoreauWorkspace, row: int, chosen: IntArray) -> tuple[NDArray, ...]:
    """Copies of what the step at hand tells of these contacts."""
    w, k, told = s.watched, s.contacts.watched[chosen], s.told[chosen]
    law = s.groups.out.law[k - len(w.element)]
    return (
        np.full(len(chosen), row), w.shapes[k], law, w.point[k], w.normal[k], w.gap[k],
        told[:, TOLD_FORCE : TOLD_FORCE + 3], told[:, TOLD_SLIP : TOLD_SLIP + 3],
        told[:, [TOLD_NORMAL, TOLD_FRICTION]],
    )  # fmt: skip


def impulses_of_impacts(scene: CompiledScene, t: FloatArray, x: FloatArray, v: FloatArray) -> RepeatedImpulses:
    """Of a run that located impacts as events, found once more between its rows of one time; no force in no time.

    Raises:
        SceneError: as ``impacts.struck``.
    """
    found = struck(scene, t, x, v)
    told = np.zeros((*found.shape[:2], N_TOLD_PAIR))
    told[:, :, IMPULSE:] = found[:, :, STRUCK_IMPULSE:STRUCK_NORMAL]
    told[:, :, WORKS:IMPULSE] = np.cumsum(found[:, :, STRUCK_NORMAL:], axis=0)
    none, ids = np.zeros((0, 3)), np.zeros(0, np.int64)
    points = FoundPoints(ids, np.zeros((0, 2), np.int64), ids, none, none, none[:, 0], none, none, none[:, :2])
    return RepeatedImpulses(told, points)


def impulses_at(pairs: FloatArray, t: FloatArray, times: ArrayLike | None) -> FloatArray:
    """``RepeatedImpulses.pairs`` of rows t at other times: of the step that each is in, works as they grow."""
    if times is None:
        return pairs
    asked = np.atleast_1d(np.asarray(times, float))
    k = np.clip(np.searchsorted(t, asked), 1, max(1, len(t) - 1))
    share = (asked - t[k - 1]) / (t[k] - t[k - 1])
    found = pairs[k].copy()
    before = pairs[k - 1, :, WORKS:IMPULSE]
    found[:, :, WORKS:IMPULSE] = before + share[:, None, None] * (found[:, :, WORKS:IMPULSE] - before)
    return found


def group_series(scene: CompiledScene, group: HardGroup, points: FoundPoints, *, rows: int) -> HardGroupSeries:
    """The points of one group in a run of so many rows.

    Raises:
        SceneError: it is of another scene.
    """
    groups = groups_of(scene)
    if not any(group is one for one in groups):
        raise SceneError(f"{group.what} is not in this trajectory's scene")
    own = points.group == [one is group for one in groups].index(True)
    place = {id(shape): k for k, shape in enumerate(group.shapes)}
    here = np.array([place.get(id(shape), -1) for shape in group_shapes(groups)], np.int64)
    works = np.zeros((rows, 2))
    np.add.at(works, points.row[own], points.works[own])
    parts = (points.point, points.normal, points.gap, points.force, points.slip)
    return HardGroupSeries(
        points.row[own], here[points.shapes[own]], group.shapes, *(part[own] for part in parts),
        *np.cumsum(works, axis=0).T,
    )  # fmt: skip
