"""The impulses of hard contacts over a run's rows: its steps are taken once more, each from the row where it began."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import set_row_scales
from flexmbd.integrate.moreau.moreau_jean import new_workspace
from flexmbd.integrate.moreau.step import N_TOLD, repeat
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.series.departure import Departure
from flexmbd.run.snapshot import bound_by_span, new_groups

FloatArray = NDArray[np.float64]


def repeated_impulses(
    scene: CompiledScene, t: FloatArray, x: FloatArray, v: FloatArray, departures: Sequence[Departure]
) -> FloatArray:
    """(nt, n, N_TOLD) of each hard contact in the step that ends at each row (``moreau.step``); zero of the first.

    ``scene`` with the rows that were kept; t (nt,) s, x (nt, nx), v (nt, nv).  Functions of time are evaluated anew.

    Raises:
        SceneError: a function of the user failed, or a step that a run took cannot be repeated.
    """
    work = new_work(scene.plan)
    workspace = new_workspace(scene, work)
    told = np.zeros((len(t), len(workspace.watched.gap), N_TOLD))
    if len(t) < 2:
        return told
    number, count = np.zeros(st.N_NUMBER), np.zeros(st.N_COUNT, np.int64)
    bound_by_span(number, t_start=float(t[0]), t_end=float(t[-1]), h=float(np.diff(t).max()))
    number[st.TOLERANCE], number[st.LATEST], count[st.FIXED_STEP] = 1e-6, np.inf, 1
    state = st.State(x[0].copy(), v[0].copy(), *np.zeros((1, scene.nv)), np.zeros(len(scene.plan.rows)), number, count)
    departing = v.copy()
    for one in departures:
        departing[one.row] = one.v
    scene.forget_failure()
    evaluate_inputs(scene, work, float(t[0]))
    set_row_scales(scene, workspace.machine.loops, state, work)
    taken = repeat(workspace, state, new_groups(scene), t, np.ascontiguousarray(x), departing, told)
    scene.refuse_failed(work)
    if taken < len(t) - 1:
        raise SceneError(f"the step from t = {t[taken]:.6g} s cannot be repeated, so that no impulses are known")
    return told
