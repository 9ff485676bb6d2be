"""The static state of a body under loads, for a reduction about it.

Newton's method on the formulation's own internal forces, with finite rotations: the loads are dead in the axes of
the body frame, which is held, and rigid interfaces turn as rigid frames.  Where a load cannot be carried at once it is
brought up in steps; a state that is not stable counts as not found, so that the load at which a body buckles
is enclosed and not jumped over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.continuation.newton import Correction, NewtonEnd, newton
from flexmbd.continuation.strides import stride_along
from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.field_conditions import find_conditions
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel, StaticState
from flexmbd.continuum.finite_elements.prestressed import PrestressedModel, followed_average, turn_less_one
from flexmbd.continuum.finite_elements.temperature import heated_groups
from flexmbd.continuum.matrices.blocks import FloatArray, inner
from flexmbd.errors import ConvergenceError, FormulationError, ReductionError
from flexmbd.given import checked
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.stiffening.geometric_stiffness import interface_loads
from flexmbd.reduction.stiffening.loaded_forms import LoadedForms, assembled_vector, loaded_forms
from flexmbd.reduction.stiffening.prestress_check import check_loading, check_rotations, finite_numbers
from flexmbd.reduction.stiffening.stability import is_stable
from flexmbd.reduction.unit_loads import Load, TemperatureRise, load_vectors, whole_rise
from flexmbd.round_off import EQUAL

# Size of the last Newton step, by the energy norm, relative to the largest: its square is what is left after it.
_STEP = 1e-6
_STEPS = 20
# A step that is that much larger than the one before is not converging.
_GROWTH = 10.0
# Smallest part of the load in which it is brought up.
_PART = 1.0 / 128.0


@checked("model", "loads", "forces", error=ReductionError, agree=parallel.told_to_all)
def prestressed(
    model: LinearModel,
    *,
    frame: str,
    loads: Sequence[tuple[Load, float]] = (),
    forces: Mapping[str, ArrayLike] | None = None,
    angular_velocity: ArrayLike = (0.0, 0.0, 0.0),
) -> PrestressedModel:
    """Load a body that is held at one interface, and linearise it about the state it takes. Collective.

    The result is reduced like any model, `craig_bampton(prestressed(...), frame=frame, ...)`: modal coordinates are
    then zero in the state, and the loads are in balance with the internal forces there.  They keep size and direction
    in the body frame, and are not to be applied to the reduced body again; their resultant, where they come from
    outside, is carried by whatever holds the frame.  The same goes for the angular velocity: its record is that of
    a body spinning at that speed, without the softening by the centrifugal forces on displaced points and without
    Coriolis forces, for spins that the machine does not know of.  What further loads add to the stiffness (the
    record's geometric stiffness) is that of their stress in the body at rest.

    Args:
        model: at rest, with the interface `frame`; at least one of its interfaces is rigid.
        frame: the interface that is held and carries the body frame.
        loads: distributed loads, each with its size in Pa, N/m^2, ... ; a pressure keeps the normal of the
            undeformed surface. A temperature (`TemperatureRise`) with its dimensionless size heats the body, also in
            the stiffness and the stress of the model that is made. Electrodes are in short circuit, and those that
            float without charge.
        forces: of other rigid interfaces by their names: (6,) force (N) on the frame's origin and moment (N m),
            along the mesh's axes.
        angular_velocity: (3,) rad/s of the body about the frame's origin, along the mesh's axes; the centrifugal
            forces are those at the displaced points, of beams and shells without their sections' rotary inertia.

    Returns:
        The model about that state; `state.displacement` is the displacement.

    Raises:
        ConvergenceError: on all ranks: no stable state was found; says up to what part of the loads there is one, and
            where the body moves most.
        ReductionError: on all ranks: arguments that differ between them; loads, forces or angular velocity that are
            not well formed; no interface is rigid; a formulation with rotations does not stay straight.
        InterfaceError: on all ranks: no such interface.
        MeshError: on all ranks: a load's facet group.
    """
    given = {"frame": frame, "loads": tuple(loads), "forces": dict(forces or {}), "angular_velocity": angular_velocity}
    parallel.check_same(model.comm, ReductionError, **given)
    if model.has_surface_energy:
        raise ReductionError(
            "springs on facets (surface_energy) are possible in bodies reduced about rest alone, not about a loaded "
            "state; load the reduced body in the machine instead"
        )
    if model.nodal:
        raise ReductionError(
            f"nodal interfaces, as {model.nodal[0].name!r}, are those of a part at rest: leave them out before "
            "prestressed(...), or reduce the part at rest"
        )
    if model.ties is not None:
        raise ReductionError(
            "welds are those of a part at rest: leave them out before prestressed(...), mesh the part in one, or load "
            "the reduced body in the machine"
        )
    spin = finite_numbers("angular_velocity", angular_velocity, 3)
    wrenches = {name: finite_numbers(f"force on {name!r}", value, 6) for name, value in (forces or {}).items()}
    model = model.coupled()  # fields of one cell are in no linear relation to a loaded state
    sizes = check_loading(model, frame=frame, loads=loads, forces=wrenches)
    named = [load for load, _ in loads]
    texts = (
        *(f"{load}: {size:g}" for load, size in zip(named, sizes, strict=True)),
        *(f"force and moment on {name!r}: {_listed(wrench)} N, N m" for name, wrench in wrenches.items()),
        *((f"angular velocity: {_listed(spin)} rad/s",) if spin.any() else ()),
    )
    outer = [(load, size) for load, size in zip(named, sizes, strict=True) if not isinstance(load, TemperatureRise)]
    dead = load_vectors(model, [load for load, _ in outer]) @ np.array([size for _, size in outer])
    with body_statics(model, frame=frame) as statics:
        rigid_error = statics.static.rigid_error
    at_rest = StaticState(
        frame=frame,
        displacement=np.zeros(model.layout.n_local),
        interfaces=model.interfaces,
        balance=np.zeros(model.n_owned),
        rigid_error=rigid_error,
        loads=texts or ("no loads",),
        note="at rest",
        spin=spin,
        rise=whole_rise(model, named, sizes),
    )
    search = _Equilibrium(model, at_rest, dead=dead, wrenches=wrenches, spin=spin)
    found = search.state()
    check_rotations(model, found)
    loaded = search.about(found, 1.0, softened=False)
    change = loaded.K - model.K
    if change.norm() <= EQUAL * model.K.norm():
        found = replace(found, note=f"{found.note}; no change of the stiffness, as of a quadratic strain energy")
    change.destroy()
    return PrestressedModel(model, found, loaded.K, conditions=loaded.conditions)


def _listed(numbers: FloatArray) -> str:
    return f"({', '.join(f'{number:g}' for number in numbers)})"


_BUCKLES = "the body buckles, its stiffness is not positive there"


class _NotFoundError(Exception):
    """There is no stable state, the same on every rank.

    Attributes:
        displacement: (owned dofs,) where the search ended.
    """

    def __init__(self, message: str, displacement: FloatArray) -> None:
        super().__init__(message)
        self.displacement = displacement


@dataclass(frozen=True, eq=False)
class _NewtonStep:
    """A step (owned dofs,), the model that it was found of, and twice its energy, J."""

    tangent: PrestressedModel
    step: FloatArray
    energy: float


class _PartOfLoads:
    """The state under a part of the loads as a problem for Newton's method, in the norm of the energy.

    Attributes:
        last: the state that was reached.
    """

    def __init__(self, search: _Equilibrium, part: float, begin: StaticState) -> None:
        self._search, self._part, self.last = search, part, begin
        self._largest, self._count = 0.0, 0

    def is_solved(self, here: StaticState, *, close: bool) -> bool:
        return close

    def correction(self, here: StaticState) -> Correction[_NewtonStep]:
        """Newton's step. Collective."""
        # the softening by a spin is left out until the tension that goes with it is there
        found = self._search.newton_step(here, self._part, softened=self._count > 0)
        self._count += 1
        size = float(np.sqrt(abs(found.energy)))
        self._largest = max(self._largest, size)
        return Correction(found, size, scale=self._largest)

    def moved(self, here: StaticState, correction: Correction[_NewtonStep], *, close: bool) -> StaticState:
        found = correction.change
        moved = self._search.moved(found.tangent, here, found.step)
        self.last = self._search.with_balance(moved, self._part)
        return self.last


class _Equilibrium:
    """The search for the static state. Constructing one is collective, and compiles.

    Args:
        model: at rest.
        rest: its state.
        dead: (owned dofs,) N, the distributed loads.
        wrenches: (6,) by interface.
        spin: (3,) rad/s.
    """

    def __init__(
        self,
        model: LinearModel,
        rest: StaticState,
        *,
        dead: FloatArray,
        wrenches: Mapping[str, FloatArray],
        spin: FloatArray,
    ) -> None:
        self._model, self._rest = model, rest
        self._dead, self._wrenches, self._spin = dead, wrenches, spin
        groups = model.groups
        self._rise: FloatArray | None = None  # K, of the whole load; the state's own is that of the part at hand
        if rest.rise is not None:
            self._rise, groups = rest.rise.x.array.copy(), heated_groups(groups, rest.rise)
        origin = model.interface(rest.frame).p
        self._forms = loaded_forms(model, groups, origin=origin, spinning=bool(spin.any()))

    def state(self) -> StaticState:
        """The state under the whole load. Collective.

        Raises:
            ConvergenceError: on all ranks.
        """
        state, failure = self._rest, _NotFoundError("", self._rest.displacement)
        successes, steps, missed = 0, 0, 1.0

        def attempt(part: float, ahead: float) -> float | None:
            nonlocal state, failure, successes, steps, missed
            try:
                state = self._solve(state, ahead)
            except _NotFoundError as reason:
                failure, successes, missed = reason, 0, ahead
                return None
            successes, steps = successes + 1, steps + 1
            # twice in a row: the step has not just been found to be the largest
            return 2.0 if successes > 1 else 1.0

        part = stride_along(attempt, 0.0, 1.0, first=1.0, least=_PART)
        if part < 1.0:
            raise ConvergenceError(self._failure(failure, part=part, missed=missed))
        if self._model.comm.allreduce(float(abs(state.displacement).max(initial=0.0)), op=MPI.MAX) == 0.0:
            return state
        text = f"largest displacement {self._largest(state.displacement)[0]:.4g} m"
        return replace(state, note=text if steps == 1 else f"{text}; brought up in {steps} steps")

    def _solve(self, start: StaticState, part: float) -> StaticState:
        """The state under a part of the loads, by Newton's method from another state. Collective."""
        problem = _PartOfLoads(self, part, self.with_balance(start, part))
        try:
            found = newton(problem, problem.last, most=_STEPS, close=_STEP, grows=_GROWTH)
        except np.linalg.LinAlgError:
            raise _NotFoundError(_BUCKLES, problem.last.displacement) from None
        except ConvergenceError as error:
            raise _NotFoundError(str(error), problem.last.displacement) from error
        except (ReductionError, FormulationError) as error:
            raise _NotFoundError(f"the tangent stiffness fails, {error}", problem.last.displacement) from error
        if found.is_solution:
            self._check_stability(found.place, part)
            return found.place
        if found.end is NewtonEnd.GROWN:
            raise _NotFoundError("Newton's method diverges", found.place.displacement)
        raise _NotFoundError(f"Newton's method has not converged in {_STEPS} steps", found.place.displacement)

    def newton_step(self, state: StaticState, part: float, *, softened: bool) -> _NewtonStep:
        """From a state under a part of the loads. Collective."""
        model = self._model
        tangent = self.about(state, part, softened=softened)
        lacking = -state.balance[:, None]
        for name, wrench in self._wrenches.items():
            unit = interface_loads(tangent, [tangent.interface(name)], R=np.eye(3))
            lacking = lacking + part * unit.forces @ wrench[:, None]
        try:
            with body_statics(tangent, frame=state.frame) as statics:
                step = statics.static_response(np.asfortranarray(lacking))
        finally:
            tangent.K.destroy()
        return _NewtonStep(tangent, step[:, 0], inner(model.comm, step, lacking).item())

    def moved(self, tangent: PrestressedModel, state: StaticState, step: FloatArray) -> StaticState:
        """The state after a step, in which rigid interfaces turn by finite rotations. Collective."""
        model = self._model
        u = state.displacement[: model.n_owned] + step
        frames: list[FoundInterface] = []
        for interface in state.interfaces:
            if not isinstance(interface, RigidInterface) or interface.name == state.frame:
                frames.append(interface)
                continue
            dofs = interface.dofs[interface.dofs < model.n_owned]
            motions = tangent.rigid_motions(interface.p, np.eye(3))[dofs]
            right = inner(model.comm, motions, step[dofs, None])
            motion = np.asarray(np.linalg.solve(inner(model.comm, motions, motions), right)[:, 0], dtype=float)
            turned = turn_less_one(motion[3:])
            nodes = interface.nodes[interface.nodes < model.n_owned_nodes]
            before = state.displacement[model.displacement_dofs[nodes]]
            arm = tangent.node_x[nodes] - interface.p
            u[model.displacement_dofs[nodes]] = before + motion[:3] + arm @ turned.T
            frames.append(replace(interface, p=interface.p + motion[:3], R=interface.R + turned @ interface.R))
        whole = with_ghosts(model, u[:, None])[:, 0]
        for i, rest in enumerate(model.interfaces):
            if isinstance(rest, AveragedInterface):
                frames[i] = followed_average(model, rest, frames[i], whole)
        return replace(state, displacement=whole, interfaces=tuple(frames))

    def with_balance(self, state: StaticState, part: float) -> StaticState:
        """The state with the forces of its displacement, under a part of the loads. Collective."""
        forms = self._set(state, part)
        outside = part * self._dead + assembled_vector(forms.centrifugal, self._model)
        balance, model = assembled_vector(forms.internal, self._model) - outside, self._model
        if model.conditions is not None:
            model.conditions.condense(model.comm, balance, first=int(model.K.getOwnershipRange()[0]))
        return replace(state, balance=balance)

    def about(self, state: StaticState, part: float, *, softened: bool) -> PrestressedModel:
        """The model in a state under a part of the loads; softened: also by the centrifugal forces. Collective."""
        forms, model = self._set(state, part), self._model
        wanted = [*forms.stiffness, *(forms.softening if softened else [])]
        (tangent,) = assembly.assemble({"tangent stiffness": wanted}, model.groups, model.space)
        if model.conditions is None:
            return PrestressedModel(model, state, tangent)
        given = (*model.conditions.ports, *model.conditions.others)
        tangent, found = find_conditions(given, tangent, model.forms)
        return PrestressedModel(model, state, tangent, conditions=found)

    def _set(self, state: StaticState, part: float) -> LoadedForms:
        self._forms.at.x.array[:] = state.displacement
        if state.rise is not None and self._rise is not None:
            state.rise.x.array[:] = part * self._rise
        # centrifugal forces go with the square
        self._forms.spin.value[:] = np.sqrt(part) * self._spin
        return self._forms

    def _check_stability(self, state: StaticState, part: float) -> None:
        """Refuse a state in which some small displacement needs no force. Collective."""
        tangent = self.about(state, part, softened=True)
        try:
            with body_statics(tangent, frame=state.frame) as statics:
                stable = is_stable(statics)
        finally:
            tangent.K.destroy()
        if not stable:
            raise _NotFoundError(_BUCKLES, state.displacement)

    def _largest(self, displacement: FloatArray) -> tuple[float, list[float]]:
        """The largest displacement, and the place at rest of its node. Collective."""
        model = self._model
        size = np.linalg.norm(displacement[model.displacement_dofs[: model.n_owned_nodes]], axis=1)
        # a comparison with NaN would make the ranks differ
        size = np.where(np.isfinite(size), size, np.inf)
        k = int(size.argmax()) if len(size) else -1
        mine = (float(size[k]), model.node_x[k].tolist()) if len(size) else (-1.0, [0.0] * 3)
        return max(model.comm.allgather(mine))

    def _failure(self, failure: _NotFoundError, *, part: float, missed: float) -> str:
        size, place = self._largest(failure.displacement)
        return (
            f"no static state under {'; '.join(self._rest.loads)}: there is one up to {part:g} of the loads and "
            f"none was found at {missed:g}: {failure}. The largest displacement there is {size:.3g} m, of the "
            f"point {[round(x, 6) for x in place]} m of the undeformed body; reduce the loads, or hold the body at more"
        )


