"""A formulation on a mesh: stiffness and mass as PETSc matrices, and the rigid interfaces.

Each term of an energy is assembled as a form of its own with its own quadrature rule, and the
matrices are the second derivatives of the energies at rest, made by `ufl.derivative`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem, la
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.formulation import Formulation, Term, load, symbols
from flexmbd.continuum.interface import FoundInterface, Interface, find_interfaces
from flexmbd.continuum.stress import StressRecovery
from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import FormulationError, InterfaceError, MeshError
from flexmbd.reduced import ReducedBody
from flexmbd.visual import StressPicture

FloatArray = NDArray[np.float64]


class ContinuumModel:
    """A linear elastic body on a mesh, with named interfaces. Constructing one is collective.

    Nothing is changed after construction but `bases`.

    Attributes:
        mesh: the mesh and its groups.
        formulation: the checked form file.
        parameters: the material, an instance of the formulation's `Parameters`.
        degree: of the displacement.
        space: the displacement's function space; one block of three dofs a node.
        interfaces: the rigid frames found on the mesh.
        K: stiffness at rest (N/m), PETSc AIJ matrix spread by rows, block size 3.
        M: consistent mass (kg), the same layout.
        bases: for `flexmbd.continuum.recovery`: by the fingerprint of each body reduced from this
            model, its modes (local dofs including ghosts, n), in the mesh's axes.
    """

    def __init__(
        self,
        mesh: TaggedMesh,
        formulation: str | Path | ModuleType,
        parameters: Any,
        *,
        degree: int,
        interfaces: Sequence[Interface] = (),
    ) -> None:
        """Check everything, then assemble. Collective over the mesh's communicator.

        Args:
            mesh: lengths in m.
            formulation: a module, the name of one in `flexmbd.forms`, or a form file's path.
            parameters: an instance of the formulation's `Parameters`, SI units.
            degree: of the displacement, at least that of the mesh's geometry.
            interfaces: facet groups that move as rigid frames.

        Raises:
            FormulationError: the form file breaks its contract, or does not fit the parameters, the
                cell or the degree.
            InterfaceError: an interface cannot carry a frame; see `find_interfaces`.
            MeshError: `mesh` is not a `TaggedMesh`.
        """
        if not isinstance(mesh, TaggedMesh):
            raise MeshError(f"mesh must be a TaggedMesh, from flexmbd.meshes; got {mesh!r}")
        self.mesh = mesh
        self.formulation = load(formulation)
        self.parameters = parameters
        self.degree = degree
        _check(self.formulation, parameters, mesh, degree)
        # on several ranks the matrices of a model that is gone wait for a collective call
        PETSc.garbage_cleanup(mesh.comm)
        element = self.formulation.element(mesh.mesh.topology.cell_name(), 3, degree)
        self.space: fem.FunctionSpace = fem.functionspace(mesh.mesh, element)
        if self.space.dofmap.bs != 3:
            raise FormulationError(
                f"the element of {self.form_name} must have three displacement "
                f"components a node, got {element}"
            )
        self.interfaces = find_interfaces(interfaces, mesh=mesh, space=self.space)
        self.K, self.M = self._matrices()
        self.bases: dict[str, FloatArray] = {}

    @property
    def comm(self) -> MPI.Comm:
        """The communicator the model is spread over."""
        return self.mesh.comm

    @property
    def form_name(self) -> str:
        """Name of the formulation's module."""
        return _name(self.formulation)

    @property
    def n_owned(self) -> int:
        """Number of dofs this rank owns, which stand before its ghosts."""
        return int(3 * self.space.dofmap.index_map.size_local)

    @property
    def n_owned_nodes(self) -> int:
        """Number of displacement nodes this rank owns, which stand before its ghosts."""
        return int(self.space.dofmap.index_map.size_local)

    @cached_property
    def displacement_dofs(self) -> NDArray[np.int32]:
        """(local nodes including ghosts, 3) local dofs of the displacement's components at each node."""
        blocks = self.space.dofmap.index_map
        count = blocks.size_local + blocks.num_ghosts
        return np.arange(3 * count, dtype=np.int32).reshape(count, 3)

    @cached_property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement nodes in the mesh's axes."""
        x: FloatArray = self.space.tabulate_dof_coordinates()
        return x

    @cached_property
    def mesh_fingerprint(self) -> str:
        """`TaggedMesh.fingerprint` of the mesh. Collective at the first call."""
        return self.mesh.fingerprint()

    def interface(self, name: str) -> FoundInterface:
        """The interface of that name.

        Raises:
            InterfaceError: there is none; the message lists those there are.
        """
        for found in self.interfaces:
            if found.name == name:
                return found
        known = ", ".join(repr(found.name) for found in self.interfaces) or "none"
        raise InterfaceError(f"the model has no interface {name!r}; it has: {known}")

    def rigid_motions(self, origin: ArrayLike, axes: ArrayLike) -> FloatArray:
        """The six unit rigid motions of the body, by the formulation's `rigid_motion`.

        Collective at the first call of a process, which may compile.

        Args:
            origin: (3,) m, the point that rotations leave at rest, in the mesh's axes.
            axes: (3, 3) rotation; motions are along and about its columns.

        Returns:
            (owned dofs, 6): three translations by 1 m, three small rotations by 1 rad.
        """
        motion = fem.Function(self.space)
        field = self._rigid_motion
        field.origin.value[:] = np.asarray(origin, dtype=float)
        columns = np.empty((self.n_owned, 6), order="F")
        for i in range(6):
            unit = np.zeros((2, 3))
            unit[i // 3] = np.asarray(axes, dtype=float)[:, i % 3]
            field.translation.value[:], field.rotation.value[:] = unit
            motion.interpolate(field.expression)
            columns[:, i] = motion.x.array[: self.n_owned]
        return columns

    def stress_picture(self, body: ReducedBody, q: ArrayLike) -> StressPicture:
        """Displacement and stress of a body reduced from this model. Collective.

        Args:
            body: as `flexmbd.continuum.recovery.nodal_modes` wants it.
            q: (n,) modal coordinates, the same on every rank.

        Raises:
            RecordError: on all ranks: the modes are not there, or `q` does not fit.
        """
        return self._stress.picture(body, q)

    @cached_property
    def _stress(self) -> StressRecovery:
        return StressRecovery(self)

    @cached_property
    def _rigid_motion(self) -> _RigidMotion:
        return _RigidMotion(self)

    def _matrices(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Stiffness and mass; they share one pattern and one block matrix to assemble in."""
        u = fem.Function(self.space)
        p = symbols(self.parameters, mesh=self.mesh.mesh)
        stiffness = [_hessian(term, u) for term in self.formulation.strain_energy(u, p)]
        mass = [_hessian(term, u) for term in self.formulation.kinetic_energy(u, p)]
        # half the time of assembling into a PETSc matrix, which looks up every entry's place
        blocks = fem.create_matrix(stiffness[0])
        matrices = []
        for terms in (stiffness, mass):
            blocks.set_value(0.0)
            for term in terms:
                fem.assemble_matrix(blocks, term)
            blocks.scatter_reverse()
            matrices.append(_to_petsc(self.comm, blocks))
        return matrices[0], matrices[1]


class _RigidMotion:
    """The formulation's rigid motion as an expression whose constants can be set."""

    def __init__(self, model: ContinuumModel) -> None:
        mesh = model.mesh.mesh
        self.origin, self.translation, self.rotation = (
            fem.Constant(mesh, np.zeros(3)) for _ in range(3)
        )
        arm = ufl.SpatialCoordinate(mesh) - self.origin
        self.expression = fem.Expression(
            model.formulation.rigid_motion(arm, self.translation, self.rotation),
            compat.interpolation_points(model.space),
        )


def _name(form: Formulation) -> str:
    # a formulation is a module, which the Protocol cannot say
    return cast(ModuleType, form).__name__


def _check(form: Formulation, parameters: Any, mesh: TaggedMesh, degree: int) -> None:
    """Refuse what does not fit the formulation; the same on every rank, not collective."""
    name = _name(form)
    if not isinstance(parameters, form.Parameters):
        raise FormulationError(
            f"{name} takes its own Parameters, got {parameters!r}; write {name}.Parameters(...)"
        )
    cell = mesh.mesh.topology.cell_name()
    if cell not in form.CELLS:
        raise FormulationError(
            f"{name} has no {cell}; mesh the part with {' or '.join(form.CELLS)}"
        )
    if isinstance(degree, bool) or degree not in form.ORDER:
        raise FormulationError(
            f"{name} has displacements of degree {sorted(form.ORDER)}, got degree={degree!r}"
        )
    geometry = mesh.mesh.geometry.cmap.degree
    if degree < geometry:
        raise FormulationError(
            f"degree={degree} is below the degree {geometry} of the mesh's geometry, and could not "
            f"carry its rigid motions; use degree={geometry} or a mesh of degree {degree}"
        )


def _hessian(term: Term, u: fem.Function) -> fem.Form:
    """Second derivative at rest of one term of an energy. Collective."""
    density, rule = term
    metadata = {"quadrature_degree": rule.degree, "quadrature_rule": rule.scheme}
    energy = density * ufl.dx(domain=u.function_space.mesh, metadata=metadata)
    v, w = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    form = ufl.algorithms.expand_derivatives(ufl.derivative(ufl.derivative(energy, u, v), u, w))
    # u = 0 as a symbol, so that what vanishes at rest is not computed
    return fem.form(ufl.replace(form, {u: ufl.zero(u.ufl_shape)}))


def _to_petsc(comm: MPI.Comm, blocks: la.MatrixCSR) -> PETSc.Mat:
    """A finished block matrix as a PETSc AIJ matrix. Collective.

    On one rank PETSc takes the arrays over without a copy.
    """
    rows, columns = blocks.index_map(0), blocks.index_map(1)
    bs = blocks.block_size[0]
    n = rows.size_local
    start = blocks.indptr[: n + 1]
    local = blocks.indices[: start[-1]]
    numbers = columns.local_to_global(
        np.arange(columns.size_local + columns.num_ghosts, dtype=np.int32)
    )
    data = blocks.data[: start[-1] * bs * bs].reshape(-1, bs, bs)
    shape = (bs * n, bs * columns.size_global)
    csr = scipy.sparse.bsr_array((data, numbers[local], start), shape=shape).tocsr()
    csr.sort_indices()
    kind = PETSc.IntType
    matrix = PETSc.Mat().createAIJWithArrays(
        ((bs * n, None), (bs * columns.size_local, None)),
        (csr.indptr.astype(kind), csr.indices.astype(kind), csr.data),
        bsize=bs,
        comm=comm,
    )
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix
