"""A record against the model that it was reduced from: mass, free modes, responses at its interfaces, on one process.

The full model keeps its rigid interfaces rigid, for that is coupling and no reduction; all else is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.record.held_modes import held_modes
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction.static_shapes.factor import Factor
from flexmbd.reduction.static_shapes.interface_motions import average_columns, rigid_columns, rigidly_bound

_SHIFT = 1e-2  # below zero, of the first elastic eigenvalue: rigid motions are found with the others


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a record and its full model say.

    Attributes:
        mass: (6, 6) of the full model, of the body frame's rigid motions, in its axes.
        frequencies: (m,) Hz of the free full model, elastic.
        of_record: (m,) Hz of the free record.
        mac: (m, m) of the record's free modes (rows) and the full ones, by the full mass; None where the record does
            not keep its modes.
        responses: of the full model, at each interface.
    """

    mass: FloatArray
    frequencies: FloatArray
    of_record: FloatArray
    mac: FloatArray | None
    responses: Sequence[InterfaceResponse]

    @property
    def errors(self) -> FloatArray:
        """(m,) of the record's frequencies, relative; positive where they are too high."""
        return np.asarray(self.of_record[: len(self.frequencies)] / self.frequencies - 1.0)


@dataclass(frozen=True, eq=False)
class InterfaceResponse:
    """Displacements of an interface of the free undamped body along its axes, per force there.

    Attributes:
        interface: its name.
        full: (k, 3) m/N of the full model, along x, y and z of the interface by a force along the same.
    """

    interface: str
    full: FloatArray


def compare(
    body: ReducedBody, model: LinearModel, *, frequencies: FloatArray, tell: Callable[[str], None] = lambda text: None
) -> Comparison:
    """Compare a record with its model; on one process.

    Args:
        body: reduced from this model.
        model: at rest, of one rank, without supports and springs on facets.
        frequencies: (k,) Hz, of responses.
        tell: is told what begins.

    Raises:
        RecordError: the record is of another mesh, or of another stiffness or mass.
        ReductionError: the model has supports, springs on facets or a loaded state, of which the free body is not.
    """
    if model.supports or model.has_surface_energy or model.state is not None or model.comm.size > 1:
        raise ReductionError("a body with supports, springs on facets or a loaded state has no free modes to compare")
    tell("free modes of the full model")
    basis = _FullBasis(model)
    K, M = basis.reduced(model.K), basis.reduced(model.M)
    of_record = body.frequencies()
    found, shapes = _free_modes(K, M, count=len(of_record), first=2.0 * np.pi * of_record[0])
    rigid = model.rigid_motions(body.p_MB_M, body.R_MB)
    mass = _scipy(model.M)
    mac = None
    if body.modes is not None:
        mac = _mac(_record_shapes(body, model, rigid, mass), basis.matrix @ shapes, mass)
    responses = []
    for interface in model.interfaces:
        tell(f"response of the full model at {interface.name}")
        responses.append(InterfaceResponse(interface.name, _full_response(K, M, basis.loads(interface), frequencies)))
    return Comparison(rigid.T @ (mass @ rigid), found, of_record, mac, responses)


class _FullBasis:
    """From the motions of rigid interfaces and all other dofs to all dofs."""

    def __init__(self, model: LinearModel) -> None:
        self._model = model
        bound = np.zeros(model.n_owned, bool)
        for one in rigidly_bound(model.interfaces):
            bound[one.dofs] = True
        moved = rigid_columns(model, rigidly_bound(model.interfaces), axes=np.eye(3))
        free = scipy.sparse.eye_array(model.n_owned, format="csc")[:, ~bound]
        self.matrix = scipy.sparse.hstack([scipy.sparse.csc_array(moved), free]).tocsr()

    def reduced(self, matrix: PETSc.Mat) -> scipy.sparse.csr_array:
        """Of these coordinates."""
        full = self.matrix.T @ _scipy(matrix) @ self.matrix
        return scipy.sparse.csr_array((full + full.T) / 2)

    def loads(self, interface: FoundInterface) -> FloatArray:
        """(coordinates, 3) unit forces along the axes of an interface."""
        if isinstance(interface, AveragedInterface):
            columns = average_columns(self._model, [interface], axes=interface.R)[:, :3]
            return np.asarray(self.matrix.T @ columns)
        place = [one.name for one in rigidly_bound(self._model.interfaces)].index(interface.name)
        loads = np.zeros((self.matrix.shape[1], 3))
        loads[6 * place : 6 * place + 3] = interface.R
        return loads


def _scipy(matrix: PETSc.Mat) -> scipy.sparse.csr_array:
    begins, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_array((values, columns, begins), matrix.getSize())


def _free_modes(
    K: scipy.sparse.csr_array, M: scipy.sparse.csr_array, *, count: int, first: float
) -> tuple[FloatArray, FloatArray]:
    """The lowest elastic frequencies (Hz) and shapes (coordinates, count), by another solver than reductions have."""
    shift = -_SHIFT * first**2
    count = min(count, K.shape[0] - 8)
    factor = _factor(K - shift * M)
    inverse = scipy.sparse.linalg.LinearOperator(
        K.shape, matvec=lambda b: factor.solve(np.asfortranarray(b.reshape(-1, 1)))[:, 0], dtype=float
    )
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    values, shapes = scipy.sparse.linalg.eigsh(K, k=count + 6, M=M, sigma=shift, OPinv=inverse, v0=start)
    factor.destroy()
    order = np.argsort(values)[6:]
    return np.sqrt(np.maximum(values[order], 0.0)) / (2.0 * np.pi), shapes[:, order]


def _full_response(
    K: scipy.sparse.csr_array, M: scipy.sparse.csr_array, loads: FloatArray, frequencies: FloatArray
) -> FloatArray:
    """(k, 3) of each load along itself, each frequency solved for directly."""
    found = np.empty((len(frequencies), 3))
    for k, omega in enumerate(2.0 * np.pi * frequencies):
        factor = _factor(K - omega**2 * M)
        found[k] = np.einsum("ij,ij->j", loads, factor.solve(np.asfortranarray(loads)))
        factor.destroy()
    return found


def _factor(matrix: scipy.sparse.csr_array) -> Factor:
    matrix = scipy.sparse.csr_array(matrix)
    matrix.sort_indices()
    csr = matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data
    return Factor(PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF), definite=False)


def _record_shapes(
    body: ReducedBody, model: LinearModel, rigid: FloatArray, mass: scipy.sparse.csr_array
) -> FloatArray:
    """(dofs, m) free modes of the record as fields: its deformations, without momentum."""
    shapes = nodal_modes(body, model)[: model.n_owned] @ held_modes(body.gram, body.stiffness).shape
    momentum = rigid.T @ (mass @ shapes)
    # about the axis of a line there is no inertia
    return np.asarray(shapes - rigid @ (np.linalg.pinv(rigid.T @ (mass @ rigid), rcond=1e-12) @ momentum))


def _mac(one: FloatArray, other: FloatArray, mass: scipy.sparse.csr_array) -> FloatArray:
    """Modal assurance criterion: squares of the cosines between fields, by the mass."""
    products = one.T @ (mass @ other)
    sizes = [np.einsum("ij,ij->j", part, mass @ part) for part in (one, other)]
    return np.asarray(products**2 / np.outer(*sizes))
