"""Rotational dofs in explicit runs: stepped with a lumped rotary inertia, or condensed out without any.

Beams and shells have rotations that carry next to no inertia, and an explicit step divides by it.  Two ways out:

`lumped_rotations`: the rotary inertia of the consistent mass is lumped as the displacement's is (Surana 1978,
doi:10.1002/nme.1620121104), and raised where rotations would rule the stable step.

`condensed_rotations`: rotations have no inertia and follow the displacements in equilibrium (Ambrosio & Nikravesh
1992, eq. 54-56), theta = K_tt^-1 (g_t - K_td d); K_tt is factorised once, so that a step costs a back substitution.

Displacements and rotations are small and in the mesh's axes, which a moving body takes along.  The nodes of the
model's rigid interfaces are bonded: they move as the interfaces' frames, rotations included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.cell_group import refuse_dissipation
from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.continuum.matrices.fastest_vibration import largest_eigenvalue
from flexmbd.errors import FormulationError, InterfaceError
from flexmbd.given import checked

Mask = NDArray[np.bool_]

# Largest error of rotations that a sound factor gives back.
_SOUND = 1e-5


@dataclass(frozen=True, eq=False)
class Bond:
    """The nodes of one rigid interface on this rank.

    Attributes:
        name: of the interface.
        dofs: (m,) owned dofs that it binds, of displacements and rotations.
        columns: (m, 6) their unit rigid motions: three translations, three small rotations about the
            interface's origin, along the mesh's axes.
    """

    name: str
    dofs: NDArray[np.int32]
    columns: FloatArray


@dataclass(frozen=True, eq=False)
class ExplicitOperator:
    """A linear elastic body as an explicit method wants it: diagonal masses, and forces at displacements.

    Vectors u, f are over the owned dofs: m, rad; N, N m.

    Attributes:
        model: the body.
        masses: (owned dofs,) kg, kg m^2, lumped, of all dofs, bonded ones too; zero where rotations are condensed.
        rotations: (n, 3) owned dofs of the rotations, node by node.
        moving: (owned dofs,) the dofs with an equation of motion: neither bonded nor condensed.
        bonds: of the model's interfaces, in their order.
    """

    model: LinearModel
    masses: FloatArray
    rotations: NDArray[np.int32]
    moving: Mask
    bonds: tuple[Bond, ...]
    _product: _StiffnessProduct
    _condensed: _Condensed | None

    @property
    def comm(self) -> MPI.Comm:
        """The model's."""
        return self.model.comm

    @property
    def condenses(self) -> bool:
        """Whether rotations have no inertia and follow the displacements."""
        return self._condensed is not None

    def complete(self, u: FloatArray, load: FloatArray | None = None) -> None:
        """Write the condensed rotations, in equilibrium with the rest (eq. 55), into u. Collective.

        Args:
            u: displacements, and rotations where they are bonded.
            load: forces and moments from outside, of which only the moments on condensed rotations matter.

        Raises:
            FormulationError: on all ranks: these are no vectors of this body.
        """
        given = {"u": u} if load is None else {"u": u, "load": load}
        parallel.refuse_vectors(self.comm, len(self.masses), kind=FormulationError, **given)
        if self._condensed is not None:
            self._condensed.solve(u, load)

    def force(self, u: FloatArray) -> FloatArray:
        """K u of a complete displacement: the nodal loads that hold it. Collective.

        Of the displacements with rotations condensed it is the condensed force of eq. 56. On bonded dofs it is
        minus the reactions C_delta and C_theta of eq. 52 and 53 on the rigid part.

        Raises:
            FormulationError: on all ranks: it is no vector of this body.
        """
        parallel.refuse_vectors(self.comm, len(self.masses), kind=FormulationError, u=u)
        return self._product.of(u)

    @checked(error=InterfaceError, agree=parallel.told_to_all)
    def stable_step(self, frames: Sequence[FloatArray] | None = None) -> float:
        """The longest stable step, s, of central differences: 2 over the largest angular frequency. Collective.

        Args:
            frames: of each bond the (6, 6) mass matrix of all that moves with the interface's frame, about its
                origin and in the mesh's axes; None: the frames are held.

        Raises:
            InterfaceError: on all ranks: such a matrix is not positive definite, or not one of each bond.
        """
        if frames is not None and [np.shape(mass) for mass in frames] != [(6, 6)] * len(self.bonds):
            raise InterfaceError(f"frames must be a (6, 6) mass matrix of each of the {len(self.bonds)} bonds")
        return float(2.0 / np.sqrt(_fastest(self, frames)))


@checked(error=FormulationError, agree=parallel.told_to_all)
def lumped_rotations(model: LinearModel, *, raised: bool = True) -> ExplicitOperator:
    """Every rotation with an inertia of its own. Collective, may compile.

    Lumped by `lumped_mass`, which treats rotations as displacements. Raised, a node has the same inertia about all
    axes: the largest of the three, and no less than the sum of |K_tt| along its rows over W, the largest such sum of
    |K_dd| over a node's mass. By Gershgorin's theorem W is a bound of the squared angular frequencies of the
    displacements alone, the rotations held, and then of those of the rotations alone as well. On thin beams what is
    added is a node's mass times the square of the cell's edge over 12, so its effect on low frequencies falls with
    the edge's square.

    Raises:
        FormulationError: on all ranks: the mass cannot be lumped; there are unknowns that are neither displacements
            nor rotations; not raised, and a rotation has no inertia, as the drilling of shells.
        InterfaceError: on all ranks: an interface is not rigid.
    """
    refuse_dissipation(model.groups, by="an explicit run")
    rotations, turning = _rotations(model)
    bonds, bound = _bonds(model)
    masses, product = lumped_mass(model), _StiffnessProduct(model.K)
    if raised:
        of_displacements = _row_sums(model.K, ~turning) / masses[~turning]
        fastest = model.comm.allreduce(of_displacements.max(initial=0.0), op=MPI.MAX)
        sums = np.zeros(model.n_owned)
        sums[turning] = _row_sums(model.K, turning)
        least = (sums[rotations] / fastest).max(axis=1, initial=0.0)
        masses[rotations] = np.maximum(masses[rotations].max(axis=1, initial=0.0), least)[:, None]
    bare = bool((masses[turning & ~bound] <= 0.0).any())
    if model.comm.allreduce(bare, op=MPI.LOR):
        raise FormulationError(
            f"{model.form_name}: a rotation has no inertia to be lumped, as the drilling of a shell; raise that "
            "inertia, or condense rotations"
        )
    return ExplicitOperator(model, masses, rotations, ~bound, bonds, product, None)


@checked(error=FormulationError, agree=parallel.told_to_all)
def condensed_rotations(model: LinearModel) -> ExplicitOperator:
    """Rotations without inertia, condensed (eq. 54-56). Collective, may compile.

    Raises:
        FormulationError: on all ranks: the mass cannot be lumped; there are unknowns that are neither displacements
            nor rotations; a rotation has no stiffness once all displacements are held, as that of a straight beam
            about itself that no interface binds.
        InterfaceError: on all ranks: an interface is not rigid.
    """
    refuse_dissipation(model.groups, by="an explicit run")
    rotations, turning = _rotations(model)
    bonds, bound = _bonds(model)
    masses = np.where(turning, 0.0, lumped_mass(model))
    condensed = _Condensed(model, turning & ~bound)
    return ExplicitOperator(model, masses, rotations, ~turning & ~bound, bonds, _StiffnessProduct(model.K), condensed)


def _fastest(operator: ExplicitOperator, frames: Sequence[FloatArray] | None) -> float:
    """Largest eigenvalue, 1/s^2, of the moving dofs and of the frames unless held. Collective."""
    moving, comm = operator.moving, operator.model.comm
    scale = 1.0 / np.sqrt(operator.masses[moving])
    bonds = () if frames is None else operator.bonds
    roots = [_inverse_root(mass) for mass in frames or ()]
    n = len(scale)

    def apply(y: FloatArray) -> FloatArray:
        u = np.zeros(len(moving))
        u[moving] = scale * y[:n]
        for bond, root, q in zip(bonds, roots, y[n:].reshape(-1, 6), strict=True):
            u[bond.dofs] = bond.columns @ (root @ q)
        operator.complete(u)
        f = operator.force(u)
        pulls = np.array([bond.columns.T @ f[bond.dofs] for bond in bonds]).reshape(-1, 6)
        comm.Allreduce(MPI.IN_PLACE, pulls, op=MPI.SUM)
        turned = [root.T @ pull for root, pull in zip(roots, pulls, strict=True)]
        return np.concatenate([scale * f[moving], *turned])

    return largest_eigenvalue(comm, apply, n, shared=6 * len(bonds))


def _inverse_root(mass: FloatArray) -> FloatArray:
    """L^-T of a mass matrix L L^T."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(mass)).T)
    except np.linalg.LinAlgError:
        raise InterfaceError(
            "an interface's frame has no inertia about an axis: give it a rigid part, or lump the rotations"
        ) from None


def _rotations(model: LinearModel) -> tuple[NDArray[np.int32], Mask]:
    """Owned rotations, node by node, and which owned dofs they are. Collective."""
    layout, found = model.layout, []
    turning = layout.kinematic[: layout.n_owned].copy()
    turning[layout.displacement_dofs[: layout.n_owned_nodes]] = False
    for field in layout.fields:
        size = field.space.dofmap.index_map_bs
        own = field.dofs.reshape(-1, size)[: field.space.dofmap.index_map.size_local]
        found.append(own[:, -3:][turning[own[:, -1]]] if size in (3, 6) else np.empty((0, 3), np.int32))
    rotations = np.concatenate(found)
    others = not layout.kinematic.all() or rotations.size != np.count_nonzero(turning)
    if model.comm.allreduce(others, op=MPI.LOR):
        raise FormulationError(
            f"{model.form_name}: an explicit run takes displacements, and three rotations a node, and no other unknowns"
        )
    return rotations, turning


def _bonds(model: LinearModel) -> tuple[tuple[Bond, ...], Mask]:
    """The rigid interfaces' nodes, and which owned dofs they bind. Collective."""
    bonds, bound = [], np.zeros(model.n_owned, dtype=bool)
    for found in model.interfaces:
        if isinstance(found, AveragedInterface):
            raise InterfaceError(
                f"interface {found.name!r} is averaged, and an explicit run bonds nodes to rigid parts: "
                "make it Coupling.RIGID"
            )
        dofs = found.dofs[found.dofs < model.n_owned]
        bonds.append(Bond(found.name, dofs, model.layout.rigid_columns(found.p, np.eye(3))[dofs]))
        bound[dofs] = True
    return tuple(bonds), bound


def _row_sums(matrix: PETSc.Mat, chosen: Mask) -> FloatArray:
    """Sums of the absolute entries among chosen dofs, of their rows on this rank. Collective."""
    rows = _indices(matrix, chosen)
    part = matrix.createSubMatrix(rows, rows)
    indptr, _, values = part.getValuesCSR()
    total = np.concatenate([[0.0], np.cumsum(abs(values))])
    part.destroy()
    return np.diff(total[indptr])


def _indices(matrix: PETSc.Mat, chosen: Mask) -> PETSc.IS:
    first = matrix.getOwnershipRange()[0]
    return PETSc.IS().createGeneral((first + np.flatnonzero(chosen)).astype(PETSc.IntType), comm=matrix.comm)


class _StiffnessProduct:
    """A matrix times plain arrays."""

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._matrix = matrix
        self._right, self._left = matrix.createVecs()

    def of(self, u: FloatArray) -> FloatArray:
        """Collective."""
        self._right.setArray(u)
        self._matrix.mult(self._right, self._left)
        return np.array(self._left.array_r)


class _Condensed:
    """The factor of K_tt and the rows K_td of the free rotations. Constructing one is collective."""

    def __init__(self, model: LinearModel, free: Mask) -> None:
        self._free = free
        rows = _indices(model.K, free)
        self._rows = _StiffnessProduct(model.K.createSubMatrix(rows))
        stiffness = model.K.createSubMatrix(rows, rows)
        self._empty = stiffness.getSize()[0] == 0
        self._right, self._left = stiffness.createVecs()
        self._solver = PETSc.KSP().create(model.comm)
        if self._empty:
            return
        stiffness.setOption(PETSc.Mat.Option.SPD, True)
        stiffness.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._solver.setOperators(stiffness)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        pc = self._solver.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        if model.comm.size > 1:
            pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        else:
            # one right side at a time goes twice as fast through PETSc's own factor
            pc.setFactorSolverType(PETSc.Mat.SolverType.PETSC)
            pc.setFactorOrdering(PETSc.Mat.OrderingType.ND)
        self._solver.setUp()
        sound = pc.getFailedReason() == PETSc.PC.FailedReason.NOERROR and self._gives_back(stiffness)
        if not sound:
            raise FormulationError(
                f"{model.form_name}: a rotation has no stiffness when all displacements are held, as that of a "
                "straight beam about itself: bind it by an interface, or lump the rotations"
            )

    def solve(self, u: FloatArray, load: FloatArray | None) -> None:
        """See `ExplicitOperator.complete`."""
        if self._empty:
            return
        u[self._free] = 0.0
        lacking = -self._rows.of(u)
        if load is not None:
            lacking += load[self._free]
        self._right.setArray(lacking)
        self._solver.solve(self._right, self._left)
        u[self._free] = self._left.array_r

    def _gives_back(self, stiffness: PETSc.Mat) -> bool:
        """Whether rotations come out again from the moments they need. Collective."""
        expected = self._left.duplicate()
        expected.setRandom()
        stiffness.mult(expected, self._right)
        self._solver.solve(self._right, self._left)
        self._left.axpy(-1.0, expected)
        off = self._left.norm(PETSc.NormType.INFINITY) / expected.norm(PETSc.NormType.INFINITY)
        return bool(off < _SOUND)
