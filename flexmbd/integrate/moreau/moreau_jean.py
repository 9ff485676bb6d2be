"""Moreau's and Jean's time stepping for hard contacts: fixed steps, impulses, friction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Stepper, make_advance, no_factors
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine, new_explicit_machine
from flexmbd.integrate.explicit.fixed_step import judge
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory, set_row_scales
from flexmbd.integrate.explicit.step_growth import central_difference_growth
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.integrate.moreau.step import N_TOLD, RULE, MoreauMemory, MoreauWorkspace, advance
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.impulses.contact_rows import new_contacts
from flexmbd.multibody.kernels.impulses.parts import new_parts
from flexmbd.multibody.kernels.impulses.touching import new_watched, reached_bodies
from flexmbd.multibody.plan.compiled_scene import CompiledScene


@dataclass(frozen=True)
class MoreauJean:
    """Time stepping by Moreau and Jean, for scenes with hard contacts (``fm.contact.Hard``), at fixed steps h.

    Order 2 in smooth motion and 1 across impacts.  Impulses of all contacts follow from Newton's law of impact and
    Coulomb's of friction, contact by contact (projected Gauss-Seidel); what rests rests.  Smooth forces are explicit:
    h must be below 2 over the fastest vibration's angular frequency.
    """

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        return "Moreau-Jean, hard contacts by impulses, fixed steps"

    @property
    def order(self) -> int:
        """Order of positions and velocities without impacts."""
        return 2

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies with history."""
        refuse_interiors(scene, self.name, why="it evaluates forces several times in a step")

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: there is no fixed step.
        """
        if state.counts[st.FIXED_STEP] == 0:
            raise SceneError(f"{self.name}: give the step, simulate(..., h=1e-3); no error rules it, rtol its impulses")
        scratch = new_workspace(scene, work)

        def begin() -> None:
            set_row_scales(scene, scratch.machine.loops, state, work)

        m = scratch.machine
        machine = partial(ExplicitMachine, m.plan, m.work, m.aw, m.loops, m.plain, m.quaternions)
        refuse_step = judge(scene, machine, state, groups, growth=central_difference_growth(True, self.name))
        forward = make_advance(advance, scratch, RULE, state, groups)
        return Stepper(forward, begin, no_factors, scratch.memory, refuse_step=refuse_step)


def new_workspace(scene: CompiledScene, work: Work) -> MoreauWorkspace:
    """Allocate for a scene."""
    plan, nv, zeros = scene.plan, scene.nv, np.zeros
    watched = new_watched(plan)
    n = len(watched.gap)
    bodies = reached_bodies(plan, watched)
    parts = new_parts(plan, bodies)
    sizes = np.append(np.diff(parts.first), 0)  # the last of the ground
    of = np.array([parts.of[b] if b >= 0 else -1 for b in bodies], np.int64)
    memory = MoreauMemory(new_loop_memory(plan), zeros((n, 3)))
    moves = zeros(nv, np.int64)
    moves[plan.free] = 1
    return MoreauWorkspace(
        new_explicit_machine(scene, memory.loops, work), watched, parts,
        new_contacts(n, 3 * int(sizes[of].sum()), nv), memory, moves, np.array([scene.extent]), zeros((n, N_TOLD)),
        zeros(scene.nx), zeros(scene.nx), *zeros((5, nv)), zeros(len(plan.rows)),
    )  # fmt: skip
