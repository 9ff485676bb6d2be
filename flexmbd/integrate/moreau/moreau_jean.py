"""Moreau's and Jean's time stepping for hard contacts: fixed steps, impulses, friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Stepper
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine, new_explicit_machine
from flexmbd.integrate.explicit.fixed_step import judge
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory, set_row_scales
from flexmbd.integrate.explicit.step_growth import central_difference_growth
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.integrate.moreau.late_stiffness import LateStiffness
from flexmbd.integrate.moreau.shape_groups import new_groups
from flexmbd.integrate.moreau.start_overlap import tell_overlap
from flexmbd.integrate.moreau.step import N_TOLD, RULE, MoreauMemory, MoreauWorkspace, advance
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.contact.finding.find_contacts import make_room
from flexmbd.multibody.kernels.elements.table import behaviours
from flexmbd.multibody.kernels.impulses.contact_rows import new_contacts
from flexmbd.multibody.kernels.impulses.free_spins import new_free_spins
from flexmbd.multibody.kernels.impulses.kept_impulses import forget, grown, new_kept
from flexmbd.multibody.kernels.impulses.parts import new_parts
from flexmbd.multibody.kernels.impulses.touching import new_watched, reached_bodies
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_OTHERWISE = ", or smooth laws of contact in place of hard ones and no step (then rtol rules it)"


@dataclass(frozen=True)
class MoreauJean:
    """Time stepping by Moreau and Jean, for scenes with hard contacts (``fm.contact.Hard``), at fixed steps h.

    Order 2 in smooth motion and 1 across impacts.  Impulses of all contacts follow from Newton's law of impact and
    Coulomb's of friction, contact by contact (projected Gauss-Seidel); what rests rests.  Smooth forces are explicit:
    h must be below 2 over the fastest vibration's angular frequency, those that begin as bodies touch included; a run
    that is beyond is refused at its start, and told of later.
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
        m = scratch.machine
        machine = partial(ExplicitMachine, m.plan, m.work, m.aw, m.loops, m.plain, m.quaternions)
        growth = replace(central_difference_growth(True, self.name), otherwise=_OTHERWISE)
        steps = _Steps(scene, scratch, state, groups, LateStiffness(scene, machine, state, groups, growth=growth))

        def begin() -> None:
            set_row_scales(scene, scratch.machine.loops, state, work)

        refuse_step = judge(scene, machine, state, groups, growth=growth)
        return Stepper(steps.advance, begin, steps.forget_impulses, scratch.memory, refuse_step=refuse_step)


class _Steps:
    """Steps in arrays that grow with the points of contact."""

    def __init__(
        self, scene: CompiledScene, scratch: MoreauWorkspace, state: st.State, groups: st.Groups, late: LateStiffness
    ) -> None:
        self._scene, self._scratch, self._state, self._groups, self._late = scene, scratch, state, groups, late

    def advance(self, record: st.Record, knots: FloatArray) -> int:
        """See ``controller.Stepper``."""
        if len(self._scratch.smooth) < len(record.t):
            self._scratch = self._scratch.replace(smooth=np.zeros(len(record.t)))
        while True:
            code = int(advance(self._scratch, RULE, knots, self._state, self._groups, record))
            if code != st.NO_ROOM:
                tell_overlap(self._scene, self._scratch.begun)
                self._late.look(self._state, record, self._scratch.smooth)
                return code
            self._scratch = with_room(self._scratch)
            self._state.counts[st.REJECTED] -= 1

    def forget_impulses(self) -> None:
        """Let the next step begin without those of the last."""
        forget(self._scratch.kept)


def new_workspace(scene: CompiledScene, work: Work) -> MoreauWorkspace:
    """Allocate for a scene."""
    plan, nv, zeros = scene.plan, scene.nv, np.zeros
    groups = new_groups(scene)
    watched = new_watched(plan, len(groups.out.gap))
    parts = new_parts(plan, reached_bodies(plan, np.append(watched.frames[: len(watched.element)], groups.frame)))
    n, memory, spins = len(watched.gap), MoreauMemory(new_loop_memory(plan)), new_free_spins(plan)
    alone = len(spins.first) == len(plan.tree) and all(one.hard for one in behaviours(plan)) and not len(plan.rows)
    moves = zeros(nv, np.int64)
    moves[plan.free] = 1
    return MoreauWorkspace(
        new_explicit_machine(scene, memory.loops, work), watched, groups, new_kept(n),
        spins, parts,
        new_contacts(n, int(parts.widest[0]), nv), memory, moves, np.array([not alone, True], np.int64),
        np.array([scene.extent]), zeros(4), zeros((n, N_TOLD)),
        zeros(0), zeros(len(plan.rows)), zeros(scene.nx), zeros(scene.nx), *(zeros(nv) for _ in range(6)),
    )  # fmt: skip


def with_room(s: MoreauWorkspace) -> MoreauWorkspace:
    """With more room for the points of groups, as the last attempt found that they need."""
    work, out = make_room(s.groups.table, s.groups.work, s.groups.out)
    watched = new_watched(s.machine.plan, len(out.gap))
    n, kept = len(watched.gap), s.kept
    if 2 * n > len(kept.key):
        kept = grown(kept, n)
    return s.replace(
        groups=s.groups.replace(work=work, out=out), watched=watched, kept=kept, told=np.zeros((n, N_TOLD)),
        contacts=new_contacts(n, int(s.parts.widest[0]), len(s.moves)),
    )  # fmt: skip
