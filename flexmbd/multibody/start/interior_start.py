"""The start of bodies with history: undeformed or as they were left, in balance with the machine's accelerations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, FrameMotion
from flexmbd.multibody.interiors.scene_interiors import Interiors, InteriorSnapshot
from flexmbd.multibody.interiors.steady import SteadyInterior, steady
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
#: Accelerations (nv,) and multipliers (m,) at a state, with the wrenches that act.
Accelerations = Callable[[CompiledScene, Work, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_IN_PLACE = 1e-7  # of the machine's extent, or rad: how far from the undeformed body a frame may start


def begin_interiors(
    scene: CompiledScene,
    interiors: Interiors,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    accelerations: Accelerations,
    *,
    kept: InteriorSnapshot | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Place the interiors and solve for accelerations (nv,) and multipliers (m,) in balance with them.

    They begin undeformed, or as they were ``kept`` where their frames are now.  Where wrenches hang on the frames'
    accelerations they do so linearly; then the balance is solved by slopes.

    Raises:
        SceneError: the frames do not stand to each other as in the undeformed body, or an interior failed.
    """
    plan, t = scene.plan, float(work.time[-1, 0])
    if kept is not None:
        interiors.restore(plan, kept)
    for body, motion in zip(interiors.bodies, interiors.motions(plan, work, x, v, np.zeros(scene.nv)), strict=True):
        if kept is None:
            _refuse_deformed(body, motion, scene.extent)

    def begin(a: FloatArray) -> FloatArray:
        motions = interiors.motions(plan, work, x, v, a)

        def first(k: int, body: ContinuumBody) -> tuple[FloatArray]:
            if kept is None:
                return (body.interior.begin(t, motions[k], plan.gravity.copy()),)
            return (steady(body).resume(t, motions[k]),)

        answers = interiors.evaluate(first, doing=f"to begin at t = {t:g} s")
        return np.concatenate([wrenches.reshape(-1, 6) for (wrenches,) in answers])

    def answer(wrenches: FloatArray) -> FloatArray:
        """The wrenches that accelerations under given ones lead to."""
        interiors.apply_wrenches(plan, wrenches)
        return begin(accelerations(scene, work, x, v)[0])

    acting = begin(np.zeros(scene.nv))
    found = answer(acting)
    if np.abs(found - acting).max() > EQUAL * np.abs(acting).max():
        rest = answer(np.zeros_like(found))
        slopes = [(answer(unit.reshape(-1, 6)) - rest).ravel() for unit in np.eye(rest.size)]
        balance = np.eye(rest.size) - np.array(slopes).T
        found = np.asarray(np.linalg.solve(balance, rest.ravel()), dtype=np.float64).reshape(-1, 6)
    interiors.apply_wrenches(plan, found)
    a, multipliers = accelerations(scene, work, x, v)
    interiors.apply_wrenches(plan, begin(a))
    return a, multipliers


def resume_interiors(
    scene: CompiledScene, interiors: Interiors, work: Work, x: FloatArray, v: FloatArray, accelerations: Accelerations
) -> tuple[FloatArray, FloatArray]:
    """Accelerations (nv,) and multipliers (m,) just after a jump of what acts, in balance with interiors as they are.

    Those that cannot resume push as they did, which is what they do where no wrench hangs on the frames' accelerations.

    Raises:
        SceneError: an interior failed.
    """
    if not all(isinstance(body.interior, SteadyInterior) for body in interiors.bodies):
        return accelerations(scene, work, x, v)
    kept = interiors.snapshot(scene.plan)
    return begin_interiors(scene, interiors, work, x, v, accelerations, kept=kept)


def _refuse_deformed(body: ContinuumBody, motion: FrameMotion, extent: float) -> None:
    """Raise SceneError where the joints put a frame elsewhere than the body has it as it was given."""
    first, *others = body.interior.frames
    R_WB = motion.R[0] @ first.R_BI.T
    for k, frame in enumerate(others, start=1):
        gap = motion.p[k] - motion.p[0] - R_WB @ (frame.p_BI_B - first.p_BI_B)
        turn = motion.R[k] @ (R_WB @ frame.R_BI).T
        distance, angle = float(np.linalg.norm(gap)), float(np.linalg.norm(turn - np.eye(3))) / np.sqrt(2.0)
        if distance > _IN_PLACE * extent or angle > _IN_PLACE:
            raise SceneError(
                f"body {body.name!r} must start in the shape that it has, but the joints put its frame {frame.name!r} "
                f"{distance:.3g} m and {angle:.3g} rad from where the body has it against {first.name!r}; set the "
                "positions of the joints accordingly"
            )
