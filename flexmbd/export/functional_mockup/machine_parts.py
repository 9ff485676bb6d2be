"""What the kernels of a machine work on, set up as an integrator would, but for inputs that jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit_runge_kutta import ExplicitRungeKutta, _new_scratch
from flexmbd.integrate.loop_dynamics import new_loops, survey
from flexmbd.integrate.tableau import Tableau
from flexmbd.multibody.body import Frame
from flexmbd.multibody.initial import Start
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.layout import Plan, new_work
from flexmbd.multibody.kernels.rotation_update import coordinate_slots
from flexmbd.multibody.kernels.round_bodies import round_axes
from flexmbd.multibody.plan import CompiledScene
from flexmbd.stepping import evaluate_inputs, new_snapshot


@dataclass(frozen=True)
class FrameCall:
    """Arguments of `frame_series` for one frame; ``out`` is the last of them."""

    frame: Frame
    arguments: tuple[Any, ...]


@dataclass(eq=False)
class Parts:
    """What the kernels work on: arguments of ``advance`` and of each frame's ``frame_series``."""

    advance: tuple[Any, ...]
    state: st.State
    plan: Plan
    frames: list[FrameCall]


def refuse_functions(scene: CompiledScene) -> None:
    """Refuse what no kernel computes: bodies with history, users' functions.

    Raises:
        ExportError: naming them.
    """
    plan = scene.plan
    if scene.interiors is not None:
        names = ", ".join(body.name for body in scene.interiors.bodies)
        raise ExportError(f"bodies with history cannot leave in an FMU ({names}): where they stay elastic, reduce them")
    kinds = plan.times[:, at.TIME_KIND]
    users = [scene.time_names[k] for k in np.flatnonzero((kinds == at.TIME_PYTHON) | (kinds == at.TIME_COMPILED))]
    users += [scene.element_names[k] for k in np.flatnonzero(plan.elements[:, at.EL_ADDRESS])]
    if users:
        raise ExportError(
            f"users' functions cannot leave in an FMU ({', '.join(users)}): give numbers, fm.Table or fm.Sine, or make "
            "the force an input and compute it outside"
        )


def parts_of(start: Start, method: ExplicitRungeKutta, h: float) -> Parts:
    """What ``ExplicitRungeKutta.stepper`` sets up, with formulas that evaluate each step's beginning anew.

    Inputs jump there, so that the accelerations of the step before are not those of this one.
    """
    scene = start.scene
    snapshot = new_snapshot(start, method, t_start=0.0, t_end=1.0, rtol=1e-6, h=h)
    state, groups, work = snapshot.state, snapshot.groups, new_work(scene.plan)
    tableau = _restarting(method.pair.tableau)
    plain, quaternions = coordinate_slots(scene.plan)
    scratch = _new_scratch(scene, tableau.a.shape[1], round_axes(scene.plan, quaternions))
    loops = new_loops(scene.plan, state)
    evaluate_inputs(scene, work, 0.0)
    survey(scene, state, work)
    # addresses in this process: SciPy's LAPACK, which explicit steps do without
    plan = scene.plan._replace(lapack=np.zeros_like(scene.plan.lapack))
    sizes = (scene.nx, scene.nv, scene.nv, len(plan.rows))
    record = st.Record(np.zeros(8), *(np.zeros((8, size)) for size in sizes))
    articulated = new_articulated_work(plan)
    way = int(method.rotations)
    arguments = (plan, work, articulated, loops, plain, quaternions, way, tableau, state, groups, scratch, record)
    return Parts(arguments, state, plan, [])


def _restarting(tableau: Tableau) -> Tableau:
    """The same formulas with one stage more, which evaluates the beginning."""
    stages = tableau.a.shape[1]
    a = np.zeros((stages + 2, stages + 1))
    a[1:, 1:] = tableau.a
    return Tableau(a, np.concatenate([[0.0], tableau.nodes]), np.zeros((2, stages + 2)))
