"""Which integrators run scenes that hold bodies with history."""

from __future__ import annotations

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import ExplicitInterior, ImplicitInterior
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def refuse_interiors(scene: CompiledScene, method: str, *, why: str) -> None:
    """Raise SceneError where a scene has bodies with history, which take one trial of a step after another."""
    if scene.interiors is not None:
        names = ", ".join(repr(body.name) for body in scene.interiors.bodies)
        raise SceneError(
            f"{method} cannot run bodies with history ({names}): {why}, and what yields in a trial must be undone "
            "before the next; take fm.GeneralizedAlpha() or fm.CentralDifference()"
        )


def refuse_explicit_only(scene: CompiledScene, method: str) -> None:
    """Raise SceneError where an interior cannot be solved implicitly."""
    bodies = () if scene.interiors is None else scene.interiors.bodies
    names = ", ".join(repr(body.name) for body in bodies if not isinstance(body.interior, ImplicitInterior))
    if names:
        raise SceneError(f"{method} needs interiors that solve for a step's end; {names}: take fm.CentralDifference()")


def refuse_implicit_only(scene: CompiledScene, method: str) -> None:
    """Raise SceneError where an interior cannot be stepped explicitly."""
    bodies = () if scene.interiors is None else scene.interiors.bodies
    names = ", ".join(repr(body.name) for body in bodies if not isinstance(body.interior, ExplicitInterior))
    if names:
        raise SceneError(f"{method} needs interiors that step explicitly; {names}: take fm.GeneralizedAlpha()")


def refuse_passes(scene: CompiledScene, method: str) -> None:
    """Raise SceneError where bodies with history meet an augmented Lagrangian, which repeats a step."""
    held = [scene.row_names[k] for k in np.flatnonzero(constraint_rows(scene.plan).augmented)]
    if scene.interiors is not None and held:
        raise SceneError(
            f"{method} does not repeat steps of bodies with history, as an augmented Lagrangian asks ({held[0]}); "
            "take fm.Multipliers() or fm.Penalty(...)"
        )


def refuse_giving(scene: CompiledScene, method: str) -> None:
    """Raise SceneError where bodies that take several steps within one of the machine's touch shapes that give way."""
    placed = () if scene.interiors is None else scene.interiors.placed
    for one in placed:
        if one.giving:
            raise SceneError(
                f"{method}: body {one.body.name!r} touches a shape or a body that gives way ({one.giving[0]!r}) and "
                "must step with it; take fm.CentralDifference() without subcycle"
            )
