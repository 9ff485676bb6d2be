"""Linear buckling: the factors of a load at which a body's stiffness, with the stress of that load, becomes singular.

K + factor K_g is singular, K_g being the stiffness of the stress that the load raises in linear statics (Bathe,
Finite Element Procedures, section 6.8.2; Zienkiewicz & Taylor). Written K_g x = -(1 / factor) K x it is an eigenproblem
with a positive definite matrix on the right, and SLEPc's Krylov-Schur method finds the lowest factors in the inner
product of K. Its inverse is that of the static shapes, so interfaces move as frames.
By Sylvester's law of inertia K + s K_g has as many negative pivots as there are factors between 0 and s, by which the
factors are counted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import scipy.linalg
from dolfinx import fem
from numpy.typing import ArrayLike

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.interface import RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.prestressed import turning_stiffness
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.saddle_point import fill_empty_rows, principal_part
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.given import checked, numbers, refuse_no_truth
from flexmbd.record.carrying_dofs import AT_REST
from flexmbd.record.groups import FRAME_DOFS, Surface
from flexmbd.reduction.modes.krylov_schur import ShellInverse, ShellProduct, shift_after
from flexmbd.reduction.modes.signs import asymmetric_fields, determined_rotation
from flexmbd.reduction.modes.truncation import whole_number
from flexmbd.reduction.optional_groups import surface_group
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.factor import Factor, TooLargeError
from flexmbd.reduction.static_shapes.frame_motions import frame_motions
from flexmbd.reduction.static_shapes.interface_motions import rigid_coordinates
from flexmbd.reduction.static_shapes.memory import memory_limit
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import interface_loads
from flexmbd.reduction.stiffening.stress_stiffness import stress_stiffness_matrix
from flexmbd.reduction.stiffening.thermal_stiffness import thermal_stiffness_matrix
from flexmbd.reduction.unit_loads import Load, check_loads, load_vectors, whole_rise

# Residual of 1 / factor, relative to the largest of either sign; a factor's error is of its square.
_TOLERANCE = 1e-10
# 1 / factor that is round-off beside the largest of either sign.
_NOISE = 1e-9
# Factors beside those asked for, which show where a group of equal ones ends; how often the basis is doubled.
_GUARD, _TIMES, _RESTARTS = 2, 4, 500


@dataclass(frozen=True, eq=False)
class BucklingModes:
    """The results of `linear_buckling`.

    Attributes:
        factors: (k,) of the loads, of the least size first; below zero where the reversed loads buckle the body.
        shape: the modes on the body's surface, in the mesh's axes, their largest displacement 1 m.
        note: how the factors were counted.
    """

    factors: FloatArray
    shape: Surface
    note: str

    def __repr__(self) -> str:
        """The factors; the shape is asked for by name."""
        return f"<BucklingModes: factors {', '.join(f'{one:.6g}' for one in self.factors) or 'none'}; {self.note}>"


@checked("model", "clamped", "forces", "loads", error=ReductionError, agree=parallel.told_to_all)
def linear_buckling(
    model: LinearModel,
    *,
    clamped: Mapping[str, Sequence[str]] | Sequence[str],
    forces: Mapping[str, ArrayLike] | None = None,
    loads: Sequence[tuple[Load, float]] = (),
    acceleration: ArrayLike = (0.0, 0.0, 0.0),
    count: int = 1,
    reversed_too: bool = False,
) -> BucklingModes:
    """The lowest factors by which loads must be multiplied for a body to buckle. Collective.

    The stress is that of linear statics, the loads keep their directions, and the body is at rest up to buckling: for
    parts that hardly deform before it, as columns and flat plates. `prestressed` finds the limit load of the others.

    Args:
        model: at rest, of a formulation with finite strain energy, as `solid_linear`.
        clamped: the components held of each interface's frame, of `x y z rx ry rz` in its own axes, as
            `{"foot": ("x", "y", "z"), "head": ("y", "z")}`; or names of interfaces that are held in all six.
        forces: on interface frames by their names: (6,) force (N) on the origin and moment (N m), along the mesh's
            axes.
        loads: distributed loads, each with its size in Pa, N/m^2, ..., and temperatures (`TemperatureRise`).
        acceleration: (3,) m/s^2, of gravity along the mesh's axes, or minus that of the body.
        count: how many factors.
        reversed_too: also those of the reversed loads, which are negative; the least in size of both are taken.

    Returns:
        Factors and modes; fewer than `count` where there are no more. Equal factors are counted one by one.

    Raises:
        ReductionError: on all ranks: arguments that are not well formed or differ between them, no loads, clamps that
            leave the body free to move, or a formulation whose stress changes no stiffness.
        InterfaceError: on all ranks: no such interface.
        ConvergenceError: on all ranks: the eigensolver did not find all of them.
        MeshError: on all ranks: a load's facet group.
    """
    held = dict(clamped) if isinstance(clamped, Mapping) else dict.fromkeys(clamped, FRAME_DOFS)
    wrenches = {name: numbers(value) for name, value in (forces or {}).items()}
    weight = numbers(acceleration)
    given = {"clamped": held, "forces": wrenches, "loads": tuple(loads), "acceleration": weight, "count": count}
    parallel.check_same(model.comm, ReductionError, reversed_too=reversed_too, **given)
    refuse_no_truth(ReductionError, reversed_too=reversed_too)
    count = whole_number("count", count, least=1)
    _check(model, held=held, wrenches=wrenches, loads=loads, weight=weight)
    named, sizes = [load for load, _ in loads], np.array([float(size) for _, size in loads])
    dead, rise = load_vectors(model, named) @ sizes, whole_rise(model, named, sizes)
    if weight.any():
        dead = dead + multiply(model.M, model.rigid_motions(np.zeros(3), np.eye(3))[:, :3] @ weight[:, None])[:, 0]
    load = dead.copy()
    for name, wrench in wrenches.items():
        load += interface_loads(model, [model.interface(name)], R=np.eye(3)).forces @ wrench
    first = next(iter(held), None)
    with (
        body_statics(model, frame=first, grounded=True) as statics,
        _loaded_body(statics, held, load, dead, rise) as body,
    ):
        found, note = _counted(body, count, both=reversed_too)
    factors, fields = found.factors[:count], found.fields
    images = multiply(model.M, asymmetric_fields(model))
    turn = model.comm.bcast(determined_rotation(found.factors, inner(model.comm, fields, images)))
    shape = surface_group(model, with_ghosts(model, (fields @ turn)[:, :count]), p=np.zeros(3), R=np.eye(3)).whole()
    sizes = np.linalg.norm(shape.phi, axis=1).max(axis=0, initial=0.0)
    return BucklingModes(factors, Surface(shape.x, shape.triangle, shape.phi / sizes), note)


def _check(
    model: LinearModel,
    *,
    held: Mapping[str, Sequence[str]],
    wrenches: Mapping[str, FloatArray],
    loads: Sequence[tuple[Load, float]],
    weight: FloatArray,
) -> None:
    """Refuse what is not well formed. Collective."""
    if model.state is not None:
        raise ReductionError("the model is prestressed already: give all loads at once, to the model at rest")
    if not model.is_definite:
        raise ReductionError(
            f"the stiffness of {model.form_name} is not positive definite, as it has unknowns like pressures; take a "
            "formulation of displacements alone"
        )
    if model.nodal:
        raise ReductionError(f"buckling takes no nodal interfaces; leave {model.nodal[0].name!r} out of the model")
    if not held and not model.supports:
        raise ReductionError("nothing is clamped; name an interface and its components, as clamped=['foot']")
    for name, components in held.items():
        model.interface(name)
        unknown = [one for one in components if one not in FRAME_DOFS]
        if isinstance(components, str) or unknown or len(set(components)) < len(components):
            raise ReductionError(
                f"the clamped components of {name!r} must be among {' '.join(FRAME_DOFS)}, each once, as ('x', 'rz'); "
                f"got {components!r}"
            )
    for name, wrench in wrenches.items():
        model.interface(name)
        if wrench.shape != (6,) or not np.isfinite(wrench).all():
            raise ReductionError(f"force on {name!r} must be six finite numbers, three N and three N m")
    if weight.shape != (3,) or not np.isfinite(weight).all():
        raise ReductionError("acceleration must be three finite numbers in m/s^2")
    check_loads(model, [load for load, _ in loads])
    if not (loads or weight.any() or any(wrench.any() for wrench in wrenches.values())):
        raise ReductionError("there are no loads: give forces, loads or acceleration")


@dataclass(frozen=True, eq=False)
class _LoadedBody:
    """A supported body, its stress stiffness under the load, and what the interfaces' frames add to that.

    Attributes:
        statics: of the body.
        shapes: (owned dofs, s) static shapes of the frames' free components.
        forces: (owned dofs, s) K times them.
        stress: K_g.
        frames: (owned dofs, 6 r) unit forces on the frames of rigid interfaces; their transpose takes displacements
            to motions of the frames.
        turning: (6 r, 6 r) stiffness of the frames against turning.
    """

    statics: Statics
    shapes: FloatArray
    forces: FloatArray
    stress: PETSc.Mat
    frames: FloatArray
    turning: FloatArray

    def flexibility(self, block: FloatArray) -> FloatArray:
        """Displacements under loads. Collective."""
        return self.statics.response_of(block, shapes=self.shapes, forces=self.forces)

    def stress_forces(self, block: FloatArray) -> FloatArray:
        """K_g times displacements of the body. Collective."""
        comm = self.statics.model.comm
        forces: FloatArray = multiply(self.stress, block)
        return forces + self.frames @ (self.turning @ inner(comm, self.frames, block))

    def count(self, factor: float) -> int:
        """Number of factors between 0 and one. Collective."""
        model, mask, comm = self.statics.model, self.statics.mask, self.statics.model.comm
        shifted = model.K.copy()
        shifted.axpy(factor, self.stress, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        part = principal_part(shifted, mask)
        if model.ties is not None:
            fill_empty_rows(part, model.tied_dofs[mask])
        try:
            inside = Factor(part, definite=False, limit=memory_limit(comm))
        finally:
            part.destroy()
            shifted.destroy()
        coupling = self.forces + factor * self.stress_forces(self.shapes)
        condensed = inner(comm, self.shapes, coupling)
        rows = np.asfortranarray(coupling[mask])
        condensed = symmetric(condensed - inner(comm, rows, inside.solve(rows)))
        pivots = inside.negative_pivots
        inside.destroy()
        size = np.sqrt(abs(np.diag(condensed)))
        own = np.linalg.eigvalsh(condensed / np.outer(size, size)) < 0.0
        return int(comm.bcast(pivots + int(own.sum())))


@contextmanager
def _loaded_body(
    statics: Statics, held: Mapping[str, Sequence[str]], load: FloatArray, dead: FloatArray, rise: fem.Function | None
) -> Iterator[_LoadedBody]:
    """Work out the stress of the load, whose temperature is a rise (K), for a `with` block. Collective."""
    model = statics.model
    free = _free_motions(statics, held)
    shapes, forces = (np.asfortranarray(block @ free) for block in (statics.static.shapes, statics.static.forces))
    u = statics.response_of(load[:, None], shapes=shapes, forces=forces)
    largest = model.comm.allreduce(float(np.abs(u).max(initial=0.0)), op=MPI.MAX)
    if not largest < np.sqrt(sys.float_info.max):
        raise ReductionError(
            f"the loads move the body by {largest:g} m, beyond the range of floating-point numbers: give smaller loads"
        )
    matrix = stress_stiffness_matrix(model, with_ghosts(model, u)[:, 0])
    if matrix is None:
        raise ReductionError(
            f"the strain energy of {model.form_name} is quadratic, or does not mark the strains of its sections, so "
            "that no stress changes its stiffness; take a formulation of finite strain, as solid_linear"
        )
    held_expansion = None if rise is None else thermal_stiffness_matrix(model, rise)
    if held_expansion is not None:
        matrix.axpy(1.0, held_expansion, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        held_expansion.destroy()
    balance = multiply(model.K, u)[:, 0] - dead
    rigid = [one for one in statics.interfaces if isinstance(one, RigidInterface)]
    turning = np.zeros((6 * len(rigid), 6 * len(rigid)))
    for i, one in enumerate(rigid):
        block = slice(6 * i, 6 * i + 6)
        turning[block, block] = turning_stiffness(model, one, balance=balance, axes=statics.R)
    frames = interface_loads(model, rigid, R=statics.R).forces
    try:
        yield _LoadedBody(statics, shapes, forces, matrix, frames, turning)
    finally:
        matrix.destroy()


def _free_motions(statics: Statics, held: Mapping[str, Sequence[str]]) -> FloatArray:
    """(6 b, s) unit motions of the frames that neither clamps nor supports hold, once the body is held. Collective."""
    model, interfaces = statics.model, statics.interfaces
    fixed: list[FloatArray] = []
    free: list[FloatArray] = []
    for i, one in enumerate(interfaces):
        axes = np.kron(np.eye(2), one.R.T @ statics.R)
        for component, row in zip(FRAME_DOFS, axes, strict=True):
            motion = np.zeros(6 * len(interfaces))
            motion[6 * i : 6 * i + 6] = row
            (fixed if component in held.get(one.name, ()) else free).append(motion)
    rows, others = (np.reshape(block, (len(block), 6 * len(interfaces))) for block in (fixed, free))
    arms = model.node_x[: model.n_owned_nodes] - statics.p
    reach = np.sqrt(model.comm.allreduce(float((arms**2).sum())) / model.comm.allreduce(len(arms)))
    scale = np.repeat([1.0, reach], 3)
    on_clamps = rows @ rigid_coordinates(interfaces, origin=statics.p, axes=statics.R) / scale
    supported = held_dofs(model.supports, layout=model.layout)
    on_supports = model.rigid_motions(statics.p, statics.R)[supported] / scale
    gram = on_clamps.T @ on_clamps + inner(model.comm, on_supports, on_supports)
    if not np.linalg.eigvalsh(gram)[0] > AT_REST**2 * max(float(np.trace(gram)), 1e-300):
        named = ", ".join(f"{name}: {' '.join(parts)}" for name, parts in held.items())
        raise ReductionError(
            f"the clamped components leave the body free to move as a rigid one, {named or 'nothing'}: clamp six "
            "components or more that together hold it"
        )
    if not model.supports:
        return others.T
    left = frame_motions(model, interfaces, axes=statics.R).motions
    return np.asarray(left @ scipy.linalg.null_space(rows @ left)) if rows.size > 0 else left


@dataclass(frozen=True, eq=False)
class _Found:
    """Factors (k,), of the least size first, and fields (owned dofs, k) of unit strain energy."""

    factors: FloatArray
    fields: FloatArray


def _counted(body: _LoadedBody, count: int, *, both: bool) -> tuple[_Found, str]:
    """The lowest factors and how they were counted; looked for again where some are missing. Collective."""
    statics = body.statics
    scale = float(abs(_search(body, 1, both=True, basis=None, round_off=0.0).factors[0]))
    basis = None
    for time in range(_TIMES):
        found = _search(body, count + _GUARD, both=both, basis=basis, round_off=_NOISE / scale)
        if len(found.factors) <= count:
            return found, "not counted: no further factors are known"
        shift, below = shift_after(abs(found.factors), count)
        if statics.held_averages is not None or not statics.has_factor:
            return found, "not counted"
        try:
            there = body.count(shift) + (body.count(-shift) if both else 0)
        except TooLargeError:
            return found, "not counted, for a second factor would not fit in memory"
        if there == below:
            return found, f"counted, {there} {'of either sign ' if both else ''}up to a factor of {shift:.6g}"
        basis = (2 * (count + _GUARD) + 16) * 2 ** (time + 1)
    raise ConvergenceError(
        f"{there} buckling factors are counted up to {shift:.6g}, and SLEPc's Krylov-Schur method found {below} with "
        f"{basis} basis vectors; ask for another count"
    )


def _search(body: _LoadedBody, count: int, *, both: bool, basis: int | None, round_off: float) -> _Found:
    """The lowest factors by Krylov-Schur in the inner product of K. Collective.

    Args:
        body: the loaded body.
        count: how many at most.
        both: of either sign.
        basis: its size; None: SLEPc's choice.
        round_off: 1 / factor that is nothing but round-off; zero: not known yet, when one digit is enough.
    """
    model = body.statics.model
    size = body.statics.size + body.shapes.shape[1]
    operator = PETSc.Mat().createPython(
        model.K.getSizes(), ShellProduct(lambda block: -body.stress_forces(block)), comm=model.comm
    )
    operator.setUp()
    solver, vector = SLEPc.EPS().create(model.comm), model.K.createVecRight()
    try:
        solver.setOperators(operator, model.K)
        solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        solver.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
        solver.setDimensions(min(count, size), PETSc.DECIDE if basis is None else min(basis, size))
        which = SLEPc.EPS.Which.LARGEST_MAGNITUDE if both else SLEPc.EPS.Which.LARGEST_REAL
        solver.setWhichEigenpairs(which)
        if round_off > 0.0:
            solver.setConvergenceTest(SLEPc.EPS.Conv.ABS)
            solver.setTolerances(_TOLERANCE / _NOISE * round_off, _RESTARTS)
        else:
            solver.setTolerances(0.1, _RESTARTS)
        start = body.flexibility(multiply(model.M, asymmetric_fields(model)) @ np.ones((8, 1)))
        vector.setArray(start[:, 0])
        solver.setInitialSpace(vector)
        solver.setOptionsPrefix("flexmbd_buckling_")
        solver.setFromOptions()
        inverse = solver.getST().getKSP()
        inverse.setType(PETSc.KSP.Type.PREONLY)
        inverse.getPC().setType(PETSc.PC.Type.PYTHON)
        inverse.getPC().setPythonContext(ShellInverse(body.flexibility))
        solver.solve()
        values, fields = [], []
        for i in range(solver.getConverged()):
            value = solver.getEigenpair(i, vector).real
            if abs(value) > round_off and (both or value > 0.0):
                values.append(1.0 / value)
                fields.append(vector.array_r.copy())
    finally:
        for item in (solver, operator, vector):
            item.destroy()
    order = np.argsort(np.abs(values), kind="stable")
    block = np.array(fields).reshape(len(values), model.n_owned).T
    return _Found(np.array(values)[order], np.asfortranarray(block[:, order]))
