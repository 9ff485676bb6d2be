"""Explicit central differences (velocity Verlet): one forward dynamics a step, and nothing solved.

    x_n+1 = x_n moved by h v_n + h^2/2 a_n,    a_n+1 = a(x_n+1, v_n + h a_n),    v_n+1 = v_n + h/2 (a_n + a_n+1)

Stable while h is below 2 over the fastest vibration's angular frequency, the most that one evaluation a step can
reach; it damps nothing.  Sources: Verlet 1967; Newmark 1959 (beta = 0, gamma = 1/2); on rotations Krysl & Endres 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import refuse_no_truth
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Stepper, make_advance, no_factors
from flexmbd.integrate.data_loads import new_data_loads
from flexmbd.integrate.explicit.central_step import (
    RULE,
    CentralDifferenceMemory,
    CentralDifferenceMethod,
    CentralDifferenceWorkspace,
    advance,
)
from flexmbd.integrate.explicit.explicit_interiors import ExplicitInteriors
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine
from flexmbd.integrate.explicit.fastest_vibration import new_vibration_memory
from flexmbd.integrate.explicit.fixed_step import judge
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory, new_loops, set_row_scales
from flexmbd.integrate.explicit.step_growth import central_difference_growth
from flexmbd.integrate.interior_support import refuse_giving, refuse_implicit_only
from flexmbd.multibody.kernels.algebra.rotation_update import coordinate_slots
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.elements.table import behaviours
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene

ORDER = 2


@dataclass(frozen=True)
class CentralDifference:
    """Explicit central differences, order 2: the cheapest step there is.

    For impacts, waves and other motions whose fastest vibration is to be seen anyhow, and for soft bodies.  Where the
    scene holds bodies with history the machine steps with them: by a given h, or by a share of their stable step.

    Attributes:
        subcycle: let bodies with history take several steps within one of the machine's, where h is too long for them.
        corrected: in machines of rigid bodies, evaluate forces a second time with the velocity at the step's end.

    Raises:
        SceneError: one of them is neither True nor False.
    """

    subcycle: bool = False
    corrected: bool = True

    def __post_init__(self) -> None:
        refuse_no_truth(subcycle=self.subcycle, corrected=self.corrected)

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        ways = f"{', bodies subcycled' if self.subcycle else ''}{'' if self.corrected else ', one evaluation a step'}"
        return f"explicit central differences, order {ORDER}{ways}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return ORDER

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without contacts whose bodies with history step explicitly."""
        refuse_implicit_only(scene, self.name)
        if self.subcycle:
            refuse_giving(scene, self.name)
        if any(one.lets_go for one in behaviours(scene.plan)):
            raise SceneError(
                f"{self.name}: bodies of this scene touch, and what is stiff then is not seen at the start, by which "
                "stable steps are known; take fm.ExplicitRungeKutta() or an implicit method"
            )

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``."""
        plan, zeros, nv = scene.plan, np.zeros, scene.nv
        motion = (zeros(scene.nx), zeros(nv), zeros(nv), zeros(nv), zeros(len(plan.rows)))
        elastic = len(plan.flex) > 0
        errors = (zeros(nv), zeros(nv), zeros(nv), zeros(nv), zeros((1, nv)), np.array([float(elastic)]))
        missed = (zeros(len(plan.rows)), new_data_loads(plan, nv))
        memory = CentralDifferenceMemory(new_loop_memory(plan), new_vibration_memory(nv), *zeros((2, nv)))
        scratch = CentralDifferenceWorkspace(*motion, *errors, *missed, memory)
        loops = new_loops(plan, memory.loops, nv)
        parts = (plan, work, new_articulated_work(plan), loops, *coordinate_slots(plan))
        corrected = self.corrected and not elastic and scene.interiors is None
        method = CentralDifferenceMethod(*parts, corrected, scratch)
        drive = make_advance(advance, method, RULE, state, groups)
        interiors = None
        if scene.interiors is not None:
            interiors = ExplicitInteriors(scene.interiors, method, RULE, state, groups, subcycle=self.subcycle)

        def begin() -> None:
            set_row_scales(scene, method.loops, state, work)
            if interiors is not None:
                interiors.choose_step()

        m = method
        machine = partial(ExplicitMachine, m.plan, m.work, m.aw, m.loops, m.plain, m.quaternions)
        refuse_step = judge(scene, machine, state, groups, growth=central_difference_growth(corrected, self.name))
        forward = drive if interiors is None else interiors.advance
        return Stepper(forward, begin, no_factors, memory, refuse_step=refuse_step)
