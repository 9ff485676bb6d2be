"""Pseudo-rigid bodies that touch: their steps, with room that grows, and what is known of their contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.multibody.contact.contact_laws import Friction, PowerLaw
from flexmbd.multibody.contact.polytopes import Polytope
from flexmbd.multibody.contact.shapes import TouchShape
from flexmbd.multibody.kernels.contact import normal_force as law_numbers
from flexmbd.multibody.kernels.contact.finding.find_contacts import make_room
from flexmbd.multibody.kernels.contact.finding.shape_table import MOST_POINTS, new_contact_points, new_finding_work
from flexmbd.multibody.kernels.swarm import stones as places
from flexmbd.multibody.kernels.swarm import touching_steps as kernel
from flexmbd.multibody.kernels.swarm.stone_forces import PRESSED, TOO_FAST, TOO_LONG, TOO_SMALL
from flexmbd.multibody.kernels.swarm.stones import Stones, new_stone_work, with_room
from flexmbd.multibody.swarm.stone_tables import data_of, polytopes_of, table_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
SwarmArrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


class SwarmContacts(NamedTuple):
    """The k points at which a swarm's bodies touch each other or walls, each array (k, ...).

    Attributes:
        bodies: (k, 2) of the two, a < b; -1 - w of wall w, which is always the second.
        point: (k, 3) m, in the middle of the overlap.
        normal: (k, 3) from b to a.
        depth: (k,) m, how far they overlap.
        force: (k, 3) N on a; the opposite is on b.
        energy: (k,) J stored by the overlap and the bristle.
    """

    bodies: IntArray
    point: FloatArray
    normal: FloatArray
    depth: FloatArray
    force: FloatArray
    energy: FloatArray


class Bristles(NamedTuple):
    """Points of the step before and their bristles (m)."""

    id: IntArray
    z: FloatArray


NOTHING = Bristles(np.zeros(0, np.int64), np.zeros((0, 3)))


class StoneContacts:
    """The compiled steps of bodies that touch, and their room."""

    def __init__(
        self,
        solids: Sequence[Solid],
        inverse: FloatArray,
        lame: FloatArray,
        damping: float,
        *,
        shapes: Sequence[Polytope | ArrayLike] | None,
        walls: Sequence[TouchShape],
        law: PowerLaw,
        friction: Friction | None,
    ) -> None:
        self.data = data_of(law, friction)
        self._shapes = len(solids)
        forms = polytopes_of(solids, shapes)
        table = table_of(forms, np.array([solid.com for solid in solids]), walls)
        per_second = np.linalg.inv([solid.second for solid in solids])
        self.stones = Stones(
            table=table,
            corners=table.cores.vertices.copy(),
            faces=table.cores.normals.copy(),
            reach=table.bound[: len(solids)].copy(),
            inverse=inverse,
            lame=lame,
            per_mass=1.0 / np.array([solid.mass for solid in solids]),
            per_second=np.ascontiguousarray(per_second.reshape(-1, 9)),
            stiffest=fastest_squared(solids, lame),
            data=self.data,
            gravity=np.zeros(3),
            retardation=damping,
        )
        corners = [form.vertices - solid.com for form, solid in zip(forms, solids, strict=True)]
        self._give = 1.0 / np.array([solid.mass for solid in solids]) + np.array(
            [np.einsum("ki,ij,kj->k", x, one, x).max() for x, one in zip(corners, per_second, strict=True)]
        )
        self._finding, self._points = new_finding_work(table), new_contact_points(4 * len(solids))
        self._work = new_stone_work(len(solids), 4 * len(solids))

    def _grow(self) -> None:
        """Make room for what was found; near pairs are to be found anew."""
        self._finding, self._points = make_room(self.stones.table, self._finding, self._points)
        self._work = with_room(self._work, len(self._points.gap))
        self._work.whole[places.PAIRS] = -1

    def _begin(self, memory: Bristles, gravity: FloatArray) -> None:
        self.stones.gravity[:] = gravity
        self._work.whole[:] = 0
        self._work.whole[places.PAIRS] = -1
        count = len(memory.id)
        self._work = with_room(self._work, count)
        self._work.id_before[:count], self._work.z_before[:count] = memory
        self._work.whole[places.BEFORE] = count

    def step(
        self, state: SwarmArrays, memory: Bristles, gravity: FloatArray, *, t: float, h: float, count: int
    ) -> Bristles:
        """Step r, v, F and their rates, the arrays of ``state``, which change; returns what is to be kept.

        Raises:
            SceneError: det F <= 0; a step longer than a body or a contact can bear, or in which bodies may pass.
        """
        self._begin(memory, gravity)
        while True:
            code = kernel.advance_stones(self.stones, self._work, self._finding, self._points, *state, h, count)
            if code != TOO_SMALL:
                break
            self._grow()
        whole, value = self._work.whole, self._work.told[places.VALUE]
        time = t + (whole[places.STEP] + 0.5) * h
        if code == PRESSED:
            raise pressed(int(whole[places.BODY]), float(value), time)
        if code == TOO_LONG:
            raise SceneError(
                f"body {whole[places.BODY]} of the swarm cannot bear steps of h = {h:.4g} s at t = {time:.6g} s, where "
                f"{self._touching_body(int(whole[places.BODY]))} points touch it: the longest stable one is "
                f"{value:.4g} s; take a shorter one, or a softer law"
            )
        if code == TOO_FAST:
            raise SceneError(
                f"body {whole[places.BODY]} of the swarm moves so far in steps of h = {h:.4g} s at t = {time:.6g} s "
                f"that it may pass through the smallest: take steps of {value:.4g} s at most"
            )
        kept = int(whole[places.BEFORE])
        return Bristles(self._work.id_before[:kept].copy(), self._work.z_before[:kept].copy())

    def _touching_body(self, body: int) -> int:
        bodies = self._points.bodies[: self._work.whole[places.POINTS]]
        return int((bodies == body).any(axis=1).sum())

    def contacts(self, state: SwarmArrays, memory: Bristles, *, t: float) -> SwarmContacts:
        """Where the bodies touch as they are, with the forces there.

        Raises:
            SceneError: det F <= 0.
        """
        self._begin(memory, np.zeros(3))
        while True:
            code = kernel.touch(self.stones, self._work, self._finding, self._points, *state)
            if code != TOO_SMALL:
                break
            self._grow()
        if code == PRESSED:
            raise pressed(int(self._work.whole[places.BODY]), float(self._work.told[places.VALUE]), t)
        n = int(self._work.whole[places.POINTS])
        found, work = self._points, self._work
        shapes = found.shapes[:n]
        bodies = np.where(shapes < self._shapes, shapes, self._shapes - 1 - shapes)
        point = 0.5 * (found.position_a[:n] + found.position_b[:n])
        arrays = found.normal[:n].copy(), -found.gap[:n], work.force[:n].copy(), work.energy[:n].copy()
        return SwarmContacts(bodies, point, *arrays)

    def longest_step(self, state: SwarmArrays, memory: Bristles, *, t: float) -> float:
        """The longest step (s) for the contacts that are there, and for a pair that meets at its corners."""
        self.contacts(state, memory, t=t)
        data, stones = self.data, self.stones
        linear = data[law_numbers.STIFFNESS] if data[law_numbers.EXPONENT] == 1.0 else 0.0
        one_stiff, one_damp = max(linear, data[law_numbers.BRISTLE]), data[law_numbers.BRISTLE_DAMPING]
        damp = stones.retardation * stones.stiffest
        more = 2.0 * MOST_POINTS * self._give
        stiff = np.maximum(self._work.stiff, stones.stiffest + more * one_stiff)
        damp = np.maximum(self._work.damp, damp + more * one_damp)
        return float((2.0 / (0.5 * damp + np.sqrt(0.25 * damp**2 + stiff))).min())


def fastest_squared(solids: Sequence[Solid], lame: FloatArray) -> FloatArray:
    """(n,) 1/s^2, a bound of the square of the fastest vibration of each body nearly undeformed."""
    lam, mu = lame.T
    stiffest = np.maximum(3.0 * lam + 2.0 * mu, 2.0 * mu)
    lightest = np.array([np.linalg.eigvalsh(solid.second)[0] for solid in solids])
    return np.asarray(np.array([solid.volume for solid in solids]) * stiffest / lightest)


def pressed(body: int, det: float, t: float) -> SceneError:
    """The error of a body with det F <= 0 from the time t (s) on."""
    return SceneError(
        f"body {body} of the swarm has det F = {det:.3g} or worse from t = {t:.6g} s on: it is pressed flat or turned "
        "inside out; take a smaller step, or slower or stiffer bodies"
    )
