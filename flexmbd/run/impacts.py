"""Hard contacts as events of methods with error control: a gap that closes, and the impulse that opens it again.

Between impacts nothing acts.  What comes to rest, or meets ever faster, has no next event and is refused by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import set_row_scales
from flexmbd.integrate.moreau.impact import BLOCKED, N_STRUCK, strike, touching_gaps
from flexmbd.integrate.moreau.moreau_jean import new_workspace
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.event import Direction, Event, Moment
from flexmbd.run.input_values import evaluate_inputs

FloatArray = NDArray[np.float64]

_REMEDY = (
    "impacts as events are for what meets and parts; take integrator=fm.MoreauJean() with a step h=..., by which hard "
    "contacts rest, or a smooth law as fm.contact.PowerLaw"
)


class Impacts:
    """The hard contacts of pairs of a scene, at instants."""

    def __init__(self, scene: CompiledScene) -> None:
        """Take a scene with the rows that are kept."""
        self.scene = scene
        self._work = new_work(scene.plan)
        self._scratch = new_workspace(scene, self._work)
        self.names = [scene.element_names[k] for k in self._scratch.watched.number]

    def gaps(self, t: float, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Gaps (n,) m, normal velocities (n,) m/s, and a gap (m) that is none, at t (s), x (nx,), v (nv,)."""
        gaps, speeds = np.zeros((2, len(self.names)))
        return gaps, speeds, float(touching_gaps(self._scratch, t, x, v, gaps, speeds))

    def after(self, t: float, x: FloatArray, v: FloatArray, *, struck: int) -> tuple[FloatArray, FloatArray]:
        """Velocities (nv,) after the impact of what touches at t (s), x (nx,), v (nv,); (n, N_STRUCK) of each.

        ``struck``: a contact that touches whatever its gap; -1: none.

        Raises:
            SceneError: a user's function failed, or the impulses are not found.
        """
        scene, scratch = self.scene, self._scratch
        number, count = np.zeros(st.N_NUMBER), np.zeros(st.N_COUNT, np.int64)
        number[st.TIME], number[st.LATEST] = t, np.inf
        state = st.State(x.copy(), v.copy(), np.zeros(scene.nv), np.zeros(len(scene.plan.rows)), number, count)
        evaluate_inputs(scene, self._work, t)
        set_row_scales(scene, scratch.machine.loops, state, self._work)
        told = np.zeros((len(self.names), N_STRUCK))
        found = strike(scratch, state, struck, told)
        scene.refuse_failed(self._work)
        if found < 0:
            name = self.names[struck] if struck >= 0 else "hard contacts"
            if found == BLOCKED:
                raise SceneError(
                    f"{name} is closed at t = {t:.6g} s by prescribed motions, and nothing gives way to an impulse; "
                    "let a force or a spring drive what meets there, or end its motion before"
                )
            raise SceneError(f"the impulses of the impact at t = {t:.6g} s, of {name}, are not found")
        return scratch.last.copy(), told


class _Latest:
    """The impacts of the scene that a run is at, whose kept rows may change; copies and pickles begin without any.

    Attributes:
        times: s, of the last impact of each contact.
    """

    def __init__(self) -> None:
        self._impacts: Impacts | None = None
        self.times: dict[int, float] = {}

    def __reduce__(self) -> tuple[type[_Latest], tuple[()]]:
        return _Latest, ()

    def of(self, scene: CompiledScene) -> Impacts:
        """Those of a scene."""
        if self._impacts is None or scene is not self._impacts.scene:
            self._impacts = Impacts(scene)
        return self._impacts


@dataclass(frozen=True, eq=False)
class Impact(Event):
    """A gap that closes."""

    @property
    def remedy(self) -> str:
        """What to do where impacts have no end."""
        return _REMEDY

    @property
    def may_go_on(self) -> bool:
        """Nothing enters."""
        return False


def impact_events(scene: CompiledScene, t: float, x: FloatArray, v: FloatArray) -> Sequence[Event]:
    """An event for each hard contact of a scene that is at x (nx,), v (nv,) at t (s).

    Raises:
        SceneError: a contact rests, is pressed or overlaps there; bodies with history take no impulse.
    """
    if scene.interiors is not None:
        names = ", ".join(repr(body.name) for body in scene.interiors.bodies)
        raise SceneError(f"bodies with history ({names}) take no impulse of a hard contact; take a smooth law")
    latest = _Latest()
    impacts = latest.of(scene)
    gaps, speeds, nothing = impacts.gaps(t, x, v)
    remedy = "take integrator=fm.MoreauJean() with a step h=..., or a smooth law as fm.contact.PowerLaw"
    for name, gap, speed in zip(impacts.names, gaps, speeds, strict=True):
        if gap < -nothing:
            raise SceneError(f"{name}: it overlaps by {-gap:.3g} m at t = {t:.6g} s; move it apart")
        if gap <= nothing and not speed > 0.0:
            raise SceneError(
                f"{name}: it touches at t = {t:.6g} s and does not part; impacts as events begin apart: move it, or "
                f"{remedy}"
            )
    return [
        Impact(partial(_gap, latest, k), Direction.FALLING, action=partial(_strike, latest, k), name=name)
        for k, name in enumerate(impacts.names)
    ]


def _gap(latest: _Latest, k: int, moment: Moment) -> float:
    return float(latest.of(moment.scene).gaps(moment.t, moment.x, moment.v)[0][k])


def _strike(latest: _Latest, k: int, moment: Moment) -> None:
    """Give the machine the velocities after the impact of contact k.

    Raises:
        SceneError: since its last one it went a way that is none; or as ``Impacts.after``.
    """
    _, speeds, nothing = latest.of(moment.scene).gaps(moment.t, moment.x, moment.v)
    if (moment.t - latest.times.get(k, -np.inf)) * abs(speeds[k]) <= nothing:
        raise SceneError(f"its impacts follow each other ever faster, so that it comes to rest; {_REMEDY}")
    latest.times[k] = moment.t
    moment.new_rates, _ = latest.of(moment.scene).after(moment.t, moment.x, moment.v, struck=k)
    moment.changed[:] = True


def struck(scene: CompiledScene, t: FloatArray, x: FloatArray, v: FloatArray) -> FloatArray:
    """(nt, n, N_STRUCK) what impacts did between rows t (nt,) s, x (nt, nx), v (nt, nv) of one time, at the second."""
    impacts = Impacts(scene)
    told = np.zeros((len(t), len(impacts.names), N_STRUCK))
    for k in np.flatnonzero((np.diff(t) == 0.0) & (v[1:] != v[:-1]).any(axis=1)):
        told[k + 1] = impacts.after(float(t[k]), x[k], v[k], struck=-1)[1]
    return told
