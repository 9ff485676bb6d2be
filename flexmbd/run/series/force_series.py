"""Forces in a machine over its rows: reactions, drives, energies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, refuse_other, shown
from flexmbd.integrate.moreau.moreau_jean import MoreauJean
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.hard_contact import HardContact
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.contact.touch import AnyContact
from flexmbd.multibody.exact_beam import ExactBeam
from flexmbd.multibody.force.beam_strain import BeamStrain
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.force_tables import (
    contact_frames,
    force_elements,
    group_frames,
    has_hard_contacts,
    keep_forces,
    refuse_hard_contacts,
)
from flexmbd.multibody.kernels.sampling.contacts import add_point_loads
from flexmbd.multibody.kernels.sampling.series import energy_series, force_series
from flexmbd.multibody.motion.memory_series import memory_series
from flexmbd.multibody.motion.reaction import PointForces, coordinate_force, outboard_load, reactions
from flexmbd.multibody.results.contact_series import (
    ContactSeries,
    HardGroupSeries,
    contact_rows,
    hard_contact_rows,
)
from flexmbd.multibody.results.energy import Energy
from flexmbd.multibody.results.given_strains import energy_of_given, given_strains, power_of_given
from flexmbd.multibody.results.port_series import PortSeries, energy_of_ports, port_series
from flexmbd.multibody.results.surface_series import AnySeries, SurfaceSeries, surface_rows
from flexmbd.multibody.start.redundancy import balancing_multipliers, minimum_norm_multipliers
from flexmbd.overflow import finite_answer, looked_at
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.series.interior_series import InteriorSeries
from flexmbd.run.series.motion_series import single
from flexmbd.run.series.repeated_impulses import (
    RepeatedImpulses,
    group_series,
    impulses_at,
    impulses_of_impacts,
    repeated_impulses,
)
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]

_RTOL_OF_IMPULSES = 1e-6  # to which impulses are found again



class ForceSeries(InteriorSeries):
    """Questions to the rows of a `Trajectory` that its forces answer; as those of `MotionSeries` beyond numbers.

    Attributes:
        row_multipliers, kept_rows, stats: as there.
    """

    row_multipliers: FloatArray
    kept_rows: tuple[int, ...] | None
    stats: Stats

    @cached_property
    def multipliers(self) -> FloatArray:
        """(nt, m) reactions of the loops (N or N m), of redundant rows the smallest that act alike.

        Beside hard contacts they are means over the steps that end at the rows, impulses included.
        """
        if self.row_multipliers.shape[1] and has_hard_contacts(self.scene.plan) and not self._located:
            return self._balancing_multipliers()
        if self.kept_rows is None:
            return self.row_multipliers
        work = new_work(self.scene.plan)
        return minimum_norm_multipliers(self.scene, work, self.x, self.row_multipliers, kept=self.kept_rows)

    @checked("t")
    def resultants(self, beam: ExactBeam, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, elements, 6) N and N m, in the middle of each element of a beam, or at times ``t`` (k,).

        Normal force, shear forces along y and z, twisting moment and bending moments about y and z, in the section's
        axes: those of the elastic strains, without what viscosity adds.  Strains that are functions of time are
        evaluated anew, as all forces are.

        Raises:
            SceneError: the beam is of another scene.
        """
        self._refuse_stranger(beam)
        motion = self.body_motion(t=t)[:, [self.scene.index.bodies[part] for part in beam.parts]]
        given = given_strains(self.scene, self._instants(t))
        slack = np.zeros((len(motion), len(beam.elements), 6))
        for k, element in enumerate(beam.bonds):
            if element in given:
                slack[:, k] = given[element].value
        with looked_at():
            found = beam.resultants(motion[..., :3], motion[..., 3:12].reshape(*motion.shape[:2], 3, 3), slack)
        return finite_answer(f"the section loads of beam {beam.name!r}", self._instants(t), found)

    @checked("t")
    def strain_power(self, beam: ExactBeam, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt,) W that strains of a beam that are functions of time do on it, or at times ``t`` (k,).

        With that of other loads it is what the machine's energy grows by, and what dampers take.  The work of a strain
        that jumps is done at once, and not in it.

        Raises:
            SceneError: the beam is of another scene.
        """
        self._refuse_stranger(beam)
        return power_of_given(self.scene, self._instants(t), self.body_motion(t=t), beam.bonds)

    def _refuse_stranger(self, beam: ExactBeam) -> None:
        refuse_other(beam, ExactBeam, "what is asked for section loads", wanted="an ExactBeam of the scene")
        if beam.parts[0] not in self.scene.index.bodies:
            raise SceneError(f"beam {beam.name!r} is not in this trajectory's scene")

    def reaction(self, connection: Connection) -> FloatArray:
        """(nt, 6) force (N) and moment (N m) that a joint's parent exerts on its child through the joint.

        The moment is about the origin of the child's frame; both are in that frame's axes.  All that
        the joint passes on counts: what it holds, and along its free axes the forces of motors,
        springs and friction on its coordinates and of its prescribed motion.  Beside hard contacts it is the mean over
        the step that ends at a row, impulses included, at the first row without them.

        Raises:
            SceneError: the joint is of another scene.
        """
        beside = self._hard_forces
        series = (self.t, self.x, self.v, self.a, self.multipliers)
        with looked_at():
            found = [
                reactions(self.scene, connection, *(part[rows] for part in series), beside=beside)
                for rows in self._stretches()
            ]
        return finite_answer(f"the reaction of joint {connection.name!r}", self.t, np.vstack(found))

    def drive(self, connection: Connection) -> FloatArray:
        """(nt,) N m or N: the drive of a joint by prescribed motion, joint torques and forces, users' functions.

        Springs, dampers, stops, friction and forces on frames are no drive.  Given forces are evaluated anew, which
        is collective over the team where they are Python callables.  Of a joint held by constraints it is what
        its reaction does along its only coordinate.
        """
        if connection in self.scene.index.closures and len(connection.joint.angular) == 1:
            return coordinate_force(connection.joint, self.reaction(connection))
        slots = self._slots(connection)
        plan = self.scene.plan
        hard = self._hard_forces
        if hard and len(connection.joint.angular) != 1:
            refuse_hard_contacts(plan, "the drive of a joint of several coordinates")
        elements = force_elements(plan)
        plan = keep_forces(plan, [], np.array([not one.drives for one in elements.behaviour], bool))
        if not (force_elements(plan).time >= 0).any():
            plan = plan.replace(times=plan.times[:0])
        work, out = new_work(plan), np.zeros_like(self.v)
        self.scene.callbacks.reset()
        for rows in self._stretches():
            series = (self.t, self.x, self.v, self.a, self.multipliers, out)
            force_series(plan, work, *(part[rows] for part in series))
        self.scene.refuse_failed(work)
        found = single(finite_answer(f"the drive of joint {connection.name!r}", self.t, out[:, slots.v]))
        if hard:
            found = found - coordinate_force(connection.joint, outboard_load(self.scene, connection, self.x, hard))
        return found

    @cached_property
    def _hard_forces(self) -> list[PointForces]:
        """Impulses of hard contacts over the steps that end at the rows, on each of the bodies that touch."""
        plan, forces = self.scene.plan, self.scene.index.forces
        if self._located or not has_hard_contacts(plan):
            return []
        found = []
        for one in forces:
            if isinstance(one, HardContact):
                met = self._contact(one, None, _RTOL_OF_IMPULSES)
                at = np.flatnonzero(met.force.any(axis=1))
                f, g = contact_frames(plan, forces[one].elements.start)
                for frame, row, sign in ((one.frame_G, g, 1.0), (one.frame_F, f, -1.0)):
                    found.append(PointForces(frame.body, row, at, met.point[at], sign * met.force[at]))
            elif isinstance(one, HardGroup):
                among = group_series(self.scene, one, self._impulses(_RTOL_OF_IMPULSES).groups, rows=len(self.t))
                rows = group_frames(plan, forces[one].elements.start)
                for side, sign in ((0, 1.0), (1, -1.0)):
                    for k, (shape, row) in enumerate(zip(among.shapes, rows, strict=True)):
                        own = among.pair[:, side] == k
                        acts = among.row[own], among.point[own], sign * among.force[own]
                        found.append(PointForces(shape.frame.body, int(row), *acts))
        return [one for one in found if len(one.row)]

    def _balancing_multipliers(self) -> FloatArray:
        """(nt, m) those that balance the rows' motions with the impulses of hard contacts over their steps."""
        scene = self.scene
        plan, work = scene.plan, new_work(scene.plan)
        loads, scratch, rest = np.zeros_like(self.v), np.zeros(scene.nv), np.zeros(scene.nv)
        for one in self._hard_forces:
            frames = np.full(len(one.row), one.frame)
            add_point_loads(plan, work, self.x, one.row, frames, one.point, one.force, scratch, rest, loads)
        rank = len(plan.rows) if self.kept_rows is None else len(self.kept_rows)
        scene.forget_failure()
        found = self.row_multipliers.copy()
        for k in range(1, len(self.t)):
            evaluate_inputs(scene, work, float(self.t[k]))
            moves = self.x[k], self.v[k], self.a[k]
            found[k] = balancing_multipliers(scene, work, *moves, rank=rank, load=loads[k])
        return found

    @checked("t")
    def port(self, port: Port, *, t: ArrayLike | None = None) -> PortSeries:
        """Effort, flow and work of a body's port, as voltage and charge of an electrode, at the rows or at times ``t``.

        Efforts are evaluated anew, as all given forces are.

        Raises:
            SceneError: the port is of another scene, or a function of time fails.
        """
        refuse_other(port, Port, "what is asked for effort and flow", wanted='a port, as body.port("top")')
        x, v, _ = (self.x, self.v, self.a) if t is None else self.motion(t)
        return port_series(self.scene, port, self._instants(t), x, v)

    def energy(self, *, t: ArrayLike | None = None) -> Energy:
        """Kinetic, elastic, gravitational energy and that of springs and stops at each instant, or at times ``t``.

        Elastic is with the electric energy that bodies with ports store by their voltages.
        """
        return self._energy if t is None else self._energy_of(t)

    @checked("t")
    def remembered(self, force: Force, *, t: ArrayLike | None = None) -> dict[str, FloatArray]:
        """The memory of a force element, by name, each (nt,); or of the step's beginning at times ``t``.

        Of elasto-plastic springs ``deformation`` (m or rad), ``plastic_deformation``, ``plastic_way``, the sum of its
        changes, and ``dissipated`` (J); of a law of one's own what it has named.

        Raises:
            SceneError: the force remembers nothing, or is not in the scene.
        """
        return memory_series(self.scene.index, force, self.x if t is None else self.motion(t)[0])

    @overload
    def contacts(
        self, touching: Contact | Sequence[Contact], *, t: ArrayLike | None = None
    ) -> tuple[ContactSeries, ...]: ...

    @overload
    def contacts(
        self,
        touching: AnyContact | Sequence[AnyContact],
        *,
        t: ArrayLike | None = None,
        rtol: float = 1e-6,
    ) -> tuple[AnySeries, ...]: ...

    @checked("t")
    def contacts(
        self,
        touching: AnyContact | Sequence[AnyContact],
        *,
        t: ArrayLike | None = None,
        rtol: float = 1e-6,
    ) -> tuple[AnySeries, ...]:
        """What each contact does over the rows, or at times ``t`` (k,); ``touching`` as ``System.touch`` returns it.

        Of elastic surfaces they are ``SurfaceSeries``, patch by patch; of hard contacts ``HardContactSeries``, of
        groups ``HardGroupSeries``: then the run's steps are taken once more, for the rows hold no impulses, by ``rtol``
        as of ``simulate``.  Each acts as a force over its step; of impacts that were located as events there is an
        ``impulse`` and no force.

        Raises:
            SceneError: it is no contact, or of another scene.
        """
        if not (is_number(rtol) and 0.0 < rtol < 1.0):
            raise SceneError(f"rtol = {shown(rtol)} of a contact's series must lie between 0 and 1")
        kinds = (Contact, HardContact, HardGroup, SurfaceContact)
        some = [*touching] if isinstance(touching, Sequence) else [touching]
        for one in some:
            refuse_other(one, kinds, "what run.contacts is asked for", wanted="a contact, or all, as scene.touch gave")
        return tuple(self._contact(one, t, rtol) for one in some)

    @checked("t")
    def contact_forces(
        self,
        touching: AnyContact | Sequence[AnyContact],
        *,
        t: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Where contacts push, (nt, n, 3) m, and their forces there, (nt, n, 3) N; or at times ``t`` (k,).

        On the sphere, or on the first shape of a group's points; the other gets the opposite.  In inertial axes, zeros
        where none touches.  Of groups n is the largest number of points, at times those of the step.

        Raises:
            SceneError: as ``contacts``.
        """
        times = self._instants(t)
        rows = np.clip(np.searchsorted(self.t, times), 0, len(self.t) - 1)
        nothing: FloatArray = np.zeros((len(times), 0, 3))
        found: list[tuple[FloatArray, FloatArray]] = [(nothing, nothing)]
        for one in touching if isinstance(touching, Sequence) else [touching]:
            (series,) = self.contacts(one, t=None if isinstance(one, HardGroup) else times)
            if isinstance(series, HardGroupSeries):
                found.append(series.at_rows(rows))
            elif isinstance(series, SurfaceSeries):
                found.append((series.point, series.force))
            else:
                found.append((series.point[:, None], series.force[:, None]))
        places, forces = zip(*found, strict=True)
        return np.concatenate(places, axis=1), np.concatenate(forces, axis=1)

    def _forces_of(self, contacts: Sequence[AnyContact]) -> Callable[[FloatArray], Any] | None:
        """``contact_forces`` of these by times (k,) s, for pictures; None of none."""
        return (lambda t: self.contact_forces(contacts, t=t)) if len(contacts) else None

    def _contact(self, one: AnyContact, t: ArrayLike | None, rtol: float) -> AnySeries:
        if isinstance(one, HardGroup):
            if t is not None:
                raise SceneError(f"{one.what}: its points are told at the ends of steps alone; leave `t` out")
            return group_series(self.scene, one, self._impulses(rtol).groups, rows=len(self.t))
        series = (self.x, self.v, self.a) if t is None else self.motion(t)
        if isinstance(one, SurfaceContact):
            return surface_rows(self.scene, one, *series)
        if isinstance(one, HardContact):
            return hard_contact_rows(self.scene, one, *series, impulses_at(self._impulses(rtol).pairs, self.t, t))
        times = self.t if t is None else np.atleast_1d(np.asarray(t, dtype=np.float64))
        return contact_rows(self.scene, one, times, *series)

    @property
    def _located(self) -> bool:
        """Whether hard contacts acted by impacts at instants, and not by impulses over steps."""
        return self.stats.integrator != MoreauJean().name

    @cached_property
    def _repeated(self) -> dict[float, RepeatedImpulses]:
        return {}

    def _impulses(self, rtol: float) -> RepeatedImpulses:
        if rtol not in self._repeated:
            scene = self.scene if self.kept_rows is None else self.scene.keep_rows(self.kept_rows)
            if self._located:
                found = impulses_of_impacts(scene, self.t, self.x, self.v)
            else:
                found = repeated_impulses(scene, self.t, self.x, self.v, self.departures, rtol=rtol)
            self._repeated[rtol] = found
        return self._repeated[rtol]

    def _stretches(self) -> Iterator[slice]:
        """Blocks of rows with the plan of their forces: all at once, or row by row with the interiors' wrenches."""
        if self.scene.interiors is None:
            yield slice(None)
            return
        for k, row in enumerate(self.interior_rows):
            self.scene.interiors.apply_wrenches(self.scene.plan, row.wrenches)
            yield slice(k, k + 1)

    @cached_property
    def _energy(self) -> Energy:
        return self._energy_of(None)

    def _energy_of(self, t: ArrayLike | None) -> Energy:
        plan = self.scene.bodies_alone
        x, v, _ = (self.x, self.v, self.a) if t is None else self.motion(t)
        out = np.zeros((len(x), 4))
        none, scratch = np.zeros((2, self.scene.nv))
        energy_series(plan, new_work(plan), x, v, none, scratch, out)
        if len(self.scene.index.efforts):
            out[:, 1] += energy_of_ports(self.scene, self._instants(t), x, v)
        if any(isinstance(force, BeamStrain) for force in self.scene.index.forces):
            out[:, 3] += energy_of_given(self.scene, self._instants(t), self.body_motion(t=t))
        with looked_at():
            sums = out.sum(axis=1, keepdims=True)
        finite_answer("the energy", self._instants(t), np.hstack([out, sums]))
        return Energy(*out.T)
