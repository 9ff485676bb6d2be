"""From a scene to flat arrays, and the way back from numbers to names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.functions.callback import Callbacks
from flexmbd.multibody.functions.switched import Switch
from flexmbd.multibody.functions.time_function import TimeRow, as_row
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.joint.connection import Connection, motion_name
from flexmbd.multibody.joint.coordinate_coupling import CoordinateCoupling
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.row_blocks import RowBlock, blockwise_order
from flexmbd.multibody.kernels.reading.constraint_tables import coupling_terms
from flexmbd.multibody.kernels.reading.force_tables import undefined_forces, without_forces
from flexmbd.multibody.motion.machine import WrenchSource
from flexmbd.multibody.plan.force_places import ElementNames
from flexmbd.multibody.plan.forces import assemble_forces
from flexmbd.multibody.plan.numbering import Numbering, alike_rows
from flexmbd.multibody.plan.plan_arrays import fill_plan, time_table
from flexmbd.multibody.plan.plan_digest import plan_digest
from flexmbd.multibody.plan.point_reach import point_reach
from flexmbd.multibody.plan.row_structure import RowStructure
from flexmbd.multibody.plan.rows import assemble_penalties, assemble_rows
from flexmbd.multibody.plan.sources import Sources, beam_reach, reaches
from flexmbd.multibody.scene_index import IdentityMap, SceneIndex, StatePlaces
from flexmbd.multibody.team import Team
from flexmbd.multibody.topology import Topology

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SceneParts:
    """The parts that a scene is compiled of, in the order of the arguments of ``build``."""

    topology: Topology
    ground: Body
    forces: tuple[Force, ...]
    couplings: tuple[CoordinateCoupling, ...]
    gravity: FloatArray
    team: Team
    varied: tuple[object, ...] = ()


@dataclass(frozen=True, eq=False)
class CompiledScene:
    """A scene as the kernels see it, and the way back from numbers to names.

    It can be pickled and deep-copied, and then knows the copied bodies and joints: addresses are found anew by
    compiling the same parts.  Unpickled it is run by one process.

    Attributes:
        plan: the flat arrays.
        topology: tree and closures.
        index: where bodies, joints and forces stand in them.
        velocity_names: (nv,) name of each velocity.
        row_names: name of each row of ``plan.rows``.
        row_owners: the joint or coupling of each row.
        start: (nx,) configuration with every joint at its own zero.
        time_rows: functions of time, row by row of ``plan.times``.
        time_names: what each is for.
        callbacks: the Python callables among them.
        element_names: name of each row of ``plan.elements``.
        idle_elements: names of those that never exert anything, and have no rows.
        extent: the machine's size (m).
        group_of, group_kind, group_full, group_floor: error-norm groups (see integrate.state.Groups).
        wrench_sources: forces on frames that the plan knows as generalised forces alone.
        redundant: names of constraint rows left out as redundant.
        interiors: those of bodies with history; None where there are none.
        breaks: (k,) s, at which laws and forces of the state are declared not to be smooth.
        parts: the bodies, joints and forces that it is compiled from.
        addresses: of all functions that the whole scene calls, in the order of ``_addresses``.
        sources: where the plan's numbers come from.
        varied: whether its numbers are those of a variant, not those of ``parts``.
        switches: of laws that jump with the state.
        unset: where signals have the history of a run here, the scene with them at their initial values.
        known_structure: of the rows of this scene or of one that this was made of; ask for ``row_structure``.
    """

    plan: Plan
    parts: SceneParts
    addresses: tuple[int, ...]
    topology: Topology
    index: SceneIndex
    velocity_names: tuple[str, ...]
    row_names: tuple[str, ...]
    row_owners: tuple[Connection | CoordinateCoupling, ...]
    start: FloatArray
    time_rows: tuple[TimeRow, ...]
    time_names: tuple[str, ...]
    callbacks: Callbacks
    element_names: ElementNames
    idle_elements: tuple[str, ...]
    extent: float
    group_of: IntArray
    group_kind: IntArray
    group_full: FloatArray
    group_floor: FloatArray
    sources: Sources
    wrench_sources: tuple[WrenchSource, ...] = ()
    redundant: tuple[str, ...] = ()
    interiors: Interiors | None = None
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))
    varied: bool = False
    switches: tuple[Switch, ...] = ()
    unset: CompiledScene | None = None
    known_structure: RowStructure | None = None

    def __repr__(self) -> str:
        """Its sizes."""
        return f"<CompiledScene: {self.nv} velocities, {len(self.row_names)} rows>"

    @cached_property
    def row_structure(self) -> RowStructure:
        """The structure of the constraint rows, which does not depend on the scene's numbers."""
        known = self.known_structure
        return known if known is not None and known.rows is self.plan.rows else RowStructure(self.plan)

    @property
    def row_blocks(self) -> tuple[RowBlock, ...]:
        """Blocks of constraint rows that share no free coordinate."""
        return self.row_structure.blocks

    @cached_property
    def row_sizes(self) -> FloatArray:
        """(m,) full size of each row's residual, m or rad: the machine's extent, or 1 rad.  Not to be written to."""
        structure, full = self.row_structure, self.group_full[self.group_of]
        sizes = np.where(structure.in_rad, 1.0, self.extent)
        for k in structure.couplings:
            columns, factors = coupling_terms(self.plan, k)
            sizes[k] = np.abs(factors * full[columns]).max()
        sizes.flags.writeable = False
        return sizes

    @cached_property
    def inertia_plan(self) -> Plan:
        """The plan without force elements and gravity."""
        return without_forces(self.plan)

    @cached_property
    def state_mask(self) -> NDArray[np.bool_]:
        """(nv,) which velocities are states of users' equations."""
        mask = np.zeros(self.nv, bool)
        for places in self.index.states.values():
            mask[places.v] = True
        return mask

    @cached_property
    def bodies_alone(self) -> Plan:
        """The plan in which links of states have no inertia, for energies and momenta."""
        if not self.index.states:
            return self.plan
        rigid = self.plan.rigid.copy()
        rigid[self.state_mask[self.plan.tree[:, at.JOINT_V]] & (self.plan.tree[:, at.JOINT_SIZE] == 1)] = 0.0
        return self.plan.replace(rigid=rigid)

    @property
    def nx(self) -> int:
        """Size of the configuration."""
        return len(self.start)

    @property
    def nv(self) -> int:
        """Number of generalised velocities, prescribed ones included."""
        return len(self.velocity_names)

    def forget_failure(self) -> None:
        """Forget what a user's function did wrong before."""
        self.callbacks.reset()

    def refuse_failed(self, work: Work) -> None:
        """Raise the error of a user's function that failed in an evaluation, if one did.

        Raises:
            SceneError: names the function and the time; its cause is the user's own error.
        """
        failure = self.failure(work)
        if failure is not None:
            message, error = failure
            if not isinstance(error, Exception):
                raise error
            raise SceneError(message) from error

    def failure(self, work: Work) -> tuple[str, BaseException] | None:
        """The failure of a user's function in an evaluation, in words, and its error; None if there was none."""
        undefined, t = undefined_forces(self.plan), float(work.time[-1, 0])
        return self.callbacks.failure(t, self.element_names, self.time_names, undefined)

    def digest(self, *, functions: bool = True) -> str:
        """Tells compiled scenes of other numbers, other structure or other ``functions`` of the user apart.

        With bodies with history the numbers of frames and rigid bodies count to eight digits (``plan_digest``).
        """
        if self.unset is not None:
            return self.unset.digest(functions=functions)
        codes = [*(row.code for row in self.time_rows), *self.callbacks.codes] if functions else None
        return plan_digest(self.plan, codes, self.declared_breaks(), is_rounded=self.interiors is not None)

    @property
    def is_shared(self) -> bool:
        """Whether variants share what a run writes to: failures of Python callables, memories of interiors."""
        return bool(self.callbacks.addresses) or self.interiors is not None

    def declared_breaks(self) -> FloatArray:
        """(k,) s, of functions of time, of laws and of forces of the state."""
        parts = [part for part in (self.breaks, *(row.breaks for row in self.time_rows)) if len(part)]
        found: FloatArray = np.unique(np.concatenate(parts)) if parts else np.zeros(0)
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Its parts and numbers; functions' addresses are of this process."""
        if self.unset is not None:
            return with_signals, (self.unset, {k: row.data for k, row in enumerate(self.time_rows) if row.signal})
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        breaks = tuple(row.breaks for row in self.time_rows)
        kept = self.index.substitutes, self.index.states
        return _compiled_anew, (self.parts, self.addresses, numbers, kept, breaks)

    def refuse_other(self, scene: CompiledScene) -> None:
        """Raise SceneError unless ``scene`` has the coordinates of this one, so that a state of this is one of it."""
        if self.varied and not scene.varied:
            raise SceneError(
                "`about` is of a compiled machine with other values of its parameters; build a scene with these values"
            )
        if self.velocity_names != scene.velocity_names:
            raise SceneError(
                "`about` is of another scene, or the scene has changed since; where inputs change which joints have "
                "coordinates, add them to the scene before its equilibrium or simulation"
            )

    def keep_rows(self, kept: Sequence[int] | IntArray) -> CompiledScene:
        """Return the scene with only these constraint rows; the others are redundant."""
        chosen = sorted(kept)
        if len(chosen) == len(self.row_names):
            return self
        left = sorted(set(range(len(self.row_names))).difference(chosen))
        structure = self.row_structure.keeping(tuple(map(int, chosen)))
        return replace(
            self,
            plan=self.plan.replace(rows=structure.rows),
            known_structure=structure,
            row_names=tuple(self.row_names[k] for k in chosen),
            row_owners=tuple(self.row_owners[k] for k in chosen),
            redundant=tuple(self.row_names[k] for k in left),
        )


#: The attributes that a scene keeps when it is pickled; the others follow from its parts.
_NUMBERS = (
    "plan", "velocity_names", "row_names", "row_owners", "start", "time_names", "element_names", "extent", "group_of",
    "group_kind", "group_full", "group_floor", "redundant", "breaks",
    "varied",
)  # fmt: skip


def _addresses(plan: Plan) -> tuple[int, ...]:
    """Addresses of functions of time, then of force elements; 0 where there are none."""
    of_elements = plan.elements[:, at.EL_ADDRESS : at.EL_NUMBER]
    found = np.concatenate([plan.times[:, at.TIME_ADDRESS :].ravel(), of_elements.ravel()])
    return tuple(found.tolist())


def _compiled_anew(
    parts: SceneParts,
    addresses: tuple[int, ...],
    numbers: dict[str, Any],
    kept: tuple[IdentityMap[object, Any], IdentityMap[object, StatePlaces]],
    breaks: tuple[FloatArray, ...],
) -> CompiledScene:
    """A scene of these parts with its numbers, its index' substitutes and states, and its functions' addresses now."""
    substitutes, states = kept
    whole = build(parts.topology, parts.ground, parts.forces, parts.couplings, parts.gravity, parts.team, parts.varied)
    if whole.velocity_names != numbers["velocity_names"] or len(whole.addresses) != len(addresses):
        raise SceneError(
            "the scene has changed since it was compiled; copy or pickle the compiled scene before it is changed"
        )
    now = {0: 0, **dict(zip(addresses, whole.addresses, strict=True))}
    plan = numbers.pop("plan")
    times, elements = plan.times.copy(), plan.elements.copy()
    for column in (*times.T[at.TIME_ADDRESS :], *elements.T[at.EL_ADDRESS : at.EL_NUMBER]):
        column[:] = [now[int(address)] for address in column]
    plan = plan.replace(times=times, elements=elements, lapack=whole.plan.lapack, flag=whole.plan.flag)
    data = np.split(plan.time_data, times[1:, at.TIME_OFFSET]) if len(times) else []
    rows = tuple(
        replace(row, data=part[: row.data.size], breaks=known)
        for row, part, known in zip(whole.time_rows, data, breaks, strict=True)
    )
    index = replace(whole.index, substitutes=substitutes, states=states)
    return replace(whole, plan=plan, index=index, time_rows=rows, **numbers)


def build(
    topology: Topology,
    ground: Body,
    forces: Sequence[Force],
    couplings: Sequence[CoordinateCoupling],
    gravity: FloatArray,
    team: Team,
    varied: Sequence[object] = (),
) -> CompiledScene:
    """Number the coordinates and fill the plan.

    Args:
        topology: tree and closures.
        ground: the inertial frame's body.
        forces: all force elements.
        couplings: of joint coordinates.
        gravity: (3,) m/s^2.
        team: the processes that run the machine.
        varied: what other values are to be given to: force elements among it keep their rows when they exert nothing.

    Raises:
        SceneError: a force on a joint that has no coordinate in the tree, or a prescribed joint
            that closes a loop.
    """
    parts = SceneParts(topology, ground, tuple(forces), tuple(couplings), gravity, team, tuple(varied))
    masses = alike_rows(branch.outer.body for branch in topology.branches)
    reach, beams = reaches(topology, masses), max(beam_reach(forces), point_reach(topology, forces, gravity))
    extent = max([beams, *(one.size for one in reach)]) or 1.0
    b = Numbering(ground, extent, Callbacks(team), topology.joints)
    for branch, mass in zip(topology.branches, masses, strict=True):
        b.add_branch(branch, mass)
    rows = assemble_rows(b, topology, couplings)
    driven = _driven(b, topology)
    table = assemble_forces(b, ground, forces, varied)
    assemble_penalties(b, rows, table)
    plan = fill_plan(b, rows, table, driven, gravity)
    order = blockwise_order(plan)
    if len(order) > 0:
        plan = plan.replace(rows=plan.rows[order])
    scene = CompiledScene(
        plan=plan,
        known_structure=RowStructure(plan),
        parts=parts,
        addresses=_addresses(plan),
        topology=topology,
        index=b.index,
        velocity_names=tuple(b.names),
        row_names=tuple(rows.names[k] for k in order),
        row_owners=tuple(rows.owners[k] for k in order),
        start=np.array(b.start, float),
        time_rows=tuple(b.times),
        time_names=tuple(b.time_names),
        callbacks=b.callbacks,
        element_names=ElementNames(table.names),
        idle_elements=tuple(table.idle),
        extent=b.extent,
        group_of=np.array(b.group_of, np.int64),
        group_kind=np.array([kind for kind, _, _ in b.groups], np.int64),
        group_full=np.array([full for _, full, _ in b.groups], float),
        group_floor=np.array([floor for _, _, floor in b.groups], float),
        wrench_sources=tuple(table.wrench_sources),
        interiors=Interiors(tuple(table.interiors), team) if table.interiors else None,
        breaks=np.concatenate([np.zeros(0), *b.breaks]),
        switches=tuple(table.switches),
        sources=Sources(tuple(b.markers), reach, beams, tuple(rows.scaled), table.spans, table.is_awaited),
    )
    table.call_hooks(scene)
    return scene


def _driven(b: Numbering, topology: Topology) -> list[list[int]]:
    rows: list[list[int]] = []
    for branch in topology.branches:
        connection = branch.connection
        if connection is not None and connection.motion is not None:
            what = motion_name(connection)
            slots = b.index.joints[connection]
            time = b.add_time(as_row(connection.motion, what, motion=True), what, motion=True)
            rows.append([slots.v.start, slots.x.start, time])
    return rows


def with_signals(scene: CompiledScene, steps: Mapping[int, FloatArray]) -> CompiledScene:
    """The scene with signals as steps over time: by rows of ``Plan.times`` their data, of polynomials of order 0.

    ``unset`` of what is returned is ``scene``.
    """
    known = enumerate(scene.time_rows)
    rows = [row if k not in steps else replace(row, data=steps[k], count=(steps[k].size - 2) // 2) for k, row in known]
    times, time_data = time_table(rows)
    plan = scene.plan.replace(times=times, time_data=time_data)
    return replace(scene, plan=plan, time_rows=tuple(rows), unset=scene)


def add_probe(scene: CompiledScene, frame: Frame) -> Plan:
    """Return the plan with one more frame, its last, for asking where ``frame`` is."""
    return scene.index.with_probe(scene.plan, frame)
