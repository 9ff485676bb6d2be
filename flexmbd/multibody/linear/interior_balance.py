"""Bodies with history in equilibria and linear equations: interiors in balance with their frames.

An interior answers small motions xi = T d of its frames, d those of the machine's coordinates, by wrenches; at rest
these change by - (mass xi'' + damping xi' + stiffness xi) and by what its own coordinates do to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, FrameMotion
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior, steady
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.linear.derivatives import Derivatives
from flexmbd.multibody.linear.elimination import Coordinates, own_coordinates
from flexmbd.multibody.linear.whole_turn import SAME_MOTION
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]



def equilibrate_interiors(
    scene: CompiledScene, interiors: Interiors, work: Work, x: FloatArray, v: FloatArray
) -> FloatArray:
    """Make all interiors' trials equilibria at the frames' places, and apply their wrenches.

    Returns:
        (nv, nv) their stiffness, in the machine's coordinates.

    Raises:
        SceneError: one finds no balance, or its frames turn or part.
    """
    plan, t = scene.plan, float(work.time[-1, 0])
    motions = steady_motions(scene, interiors, work, x, v)
    answers = interiors.evaluate(
        lambda k, body: steady(body).equilibrate(t, motions[k]), doing="to find its balance where its frames are"
    )
    interiors.apply_wrenches(plan, np.concatenate([wrenches.reshape(-1, 6) for wrenches, _ in answers]))
    stiffness, twists = np.zeros((scene.nv, scene.nv)), interiors.twists(plan, work, x)
    first = 0
    for _, slopes in answers:
        part = twists[first : first + len(slopes)]
        stiffness -= part.T @ slopes @ part
        first += len(slopes)
    return stiffness


def steady_motions(
    scene: CompiledScene, interiors: Interiors, work: Work, x: FloatArray, v: FloatArray
) -> tuple[FrameMotion, ...]:
    """Motions of each body's frames, which stand or move straight on together.

    Raises:
        SceneError: some turn, or part; or an interior can only be stepped.
    """
    for body in interiors.bodies:
        steady(body)
    motions = interiors.motions(scene.plan, work, x, v, np.zeros(scene.nv))
    for body, motion in zip(interiors.bodies, motions, strict=True):
        apart = max(float(np.abs(motion.v - motion.v[0]).max()), scene.extent * float(np.abs(motion.w).max()))
        if apart > SAME_MOTION * float(np.abs(motion.v).max()):
            raise SceneError(
                f"body {body.name!r} turns, or is deformed at a rate: a body with history can be in equilibrium, and "
                "be linearised, at rest or moving straight on alone; take away the velocities, or where it stays "
                "elastic reduce it (craig_bampton)"
            )
    return motions


@dataclass(frozen=True, eq=False)
class InteriorEquations:
    """The interiors' part of a machine's linear equations.

    Attributes:
        parts: of each the equations, and how many rows of them are its frames'.
        twists: (6 k, nv) of all frames, T.
        coordinates: all that there are, the interiors' last.
    """

    parts: tuple[tuple[LinearInterior, int], ...]
    twists: FloatArray
    coordinates: Coordinates

    @property
    def added(self) -> int:
        """How many coordinates the interiors have."""
        return len(self.coordinates.names) - self.twists.shape[1]

    def derivatives(self, of: Derivatives) -> Derivatives:
        """The machine's, in which the interiors' wrenches act, with those of the interiors."""
        found = {name: np.pad(getattr(of, name), (0, self.added)) for name in ("mass", "damping", "stiffness")}
        row, column = 0, self.twists.shape[1]
        for part, frames in self.parts:
            own = len(part.lacking) - frames
            onto = np.zeros((frames + own, len(self.coordinates.names)))
            onto[:frames, : self.twists.shape[1]] = self.twists[row : row + frames]
            onto[frames:, column : column + own] = np.eye(own)
            for name, matrix in found.items():
                matrix += onto.T @ getattr(part, name) @ onto
            row, column = row + frames, column + own
        wide = {name: np.pad(getattr(of, name), ((0, 0), (0, self.added))) for name in ("jacobian", "rate_slope")}
        return replace(of, **found, **wide)

    def lacking(self) -> FloatArray:
        """(added,) forces on the interiors' own coordinates that are not balanced."""
        return np.concatenate([np.zeros(0), *(part.lacking[frames:] for part, frames in self.parts)])


def linearize_interiors(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, *, modes: InteriorModes
) -> InteriorEquations:
    """Linear equations of the interiors at their present states; applies their wrenches.

    Raises:
        SceneError: one has none, or its frames turn or part.
    """
    own = own_coordinates(scene)
    if scene.interiors is None:
        return InteriorEquations((), np.zeros((0, scene.nv)), own)
    interiors, plan = scene.interiors, scene.plan
    motions = steady_motions(scene, interiors, work, x, v)

    def ask(k: int, body: ContinuumBody) -> Sequence[FloatArray]:
        found = steady(body).linear(motions[k], modes)
        return found.mass, found.damping, found.stiffness, found.lacking

    found = [LinearInterior(*answer) for answer in interiors.evaluate(ask, doing="to be linearised")]
    parts = tuple((part, 6 * len(one.rows)) for part, one in zip(found, interiors.placed, strict=True))
    interiors.apply_wrenches(plan, np.concatenate([-part.lacking[:frames] for part, frames in parts]).reshape(-1, 6))
    names, sizes = list(own.names), [own.size]
    for body, (part, frames) in zip(interiors.bodies, parts, strict=True):
        count = len(part.lacking) - frames
        names += [f"{body.name}.q[{k}]" for k in range(count)]
        sizes.append(np.full(count, scene.extent * np.sqrt(body.mass)))
    free = np.concatenate([own.free, np.arange(scene.nv, len(names))])
    coordinates = Coordinates(tuple(names), free, np.concatenate(sizes), np.flatnonzero(scene.state_mask))
    return InteriorEquations(parts, interiors.twists(plan, work, x), coordinates)
