"""The matrices of single cells, by the code that FFCx makes of a bilinear form, and their sum as one sparse matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.base.tabulate import call_tabulate

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]

#: Cells whose matrices are worked on together: what is computed of them stays in the cache.
CHUNK = 256


class CellMatrices:
    """A sum of bilinear forms of one group of cells, cell by cell. Constructing one is collective, and compiles."""

    def __init__(self, forms: Sequence[ufl.Form], space: fem.FunctionSpace, columns: Any = None) -> None:
        """Compile.

        Args:
            forms: of one integral over cells each; those that vanish are left out.
            space: of test functions, n dofs a cell.
            columns: element of trial functions, m dofs a cell; None: they are on ``space`` too.
        """
        self._mesh, dofmap = space.mesh, space.dofmap
        rows = int(dofmap.bs * dofmap.list.shape[1])
        self._shape = rows, rows if columns is None else int(columns.dim)
        expanded = [ufl.algorithms.expand_derivatives(form) for form in forms]
        self._codes = [_BilinearCode(form, self._mesh) for form in expanded if not form.empty()]

    def of_cells(
        self, cells: Indices, values: Callable[[fem.Function, Indices], FloatArray] | None = None
    ) -> FloatArray:
        """(k, n, m) of some cells, with the values that constants and functions have now; not collective.

        Args:
            cells: (k,) of this rank.
            values: of a function on some cells (k, dofs), where it is not its own array.
        """
        found = np.zeros((len(cells), *self._shape))
        geometry = self._mesh.geometry.x, compat.cell_nodes(self._mesh)
        for code in self._codes:
            given = [np.zeros((len(cells), 0)), *((values or cell_values)(field, cells) for field in code.reads)]
            taken, constants = np.hstack(given), code.constants()
            tensor = np.zeros(self._shape).reshape(-1)
            room = np.zeros((geometry[1].shape[1], 3)), np.zeros(taken.shape[1] + 1), tensor
            flat = found.reshape(len(cells), len(tensor))
            add_cell_tensors(cells, geometry[1], geometry[0], code.address, constants, taken, flat, *room)
        return found


class _BilinearCode:
    """A compiled form: its address, and what it reads, in order."""

    def __init__(self, form: ufl.Form, mesh: Any) -> None:
        self.address, positions, self._module = compat.cell_kernel(mesh.comm, form)
        coefficients = form.coefficients()
        self.reads: list[fem.Function] = [coefficients[position] for position in positions]
        self._symbols: list[fem.Constant] = list(form.constants())

    def constants(self) -> FloatArray:
        return np.concatenate(
            [*(np.asarray(symbol.value, dtype=float).ravel() for symbol in self._symbols), np.zeros(1)]
        )


def cell_values(field: fem.Function, cells: Indices) -> FloatArray:
    """(k, m) the dofs of a function on some cells, as compiled forms take them."""
    return np.asarray(field.x.array[cell_dofs(field.function_space, cells)])


def cell_dofs(space: fem.FunctionSpace, cells: Indices | None = None) -> NDArray[np.int64]:
    """(cells of this rank, m) local dofs of each cell, or of some of them."""
    dofs = space.dofmap.list if cells is None else space.dofmap.list[cells]
    blocks, size = dofs.astype(np.int64), space.dofmap.bs
    return (size * blocks[:, :, None] + np.arange(size)).reshape(len(blocks), -1)


def chunks(cells: Indices) -> Iterator[Indices]:
    """Cells in parts that are worked on together."""
    for begin in range(0, len(cells), CHUNK):
        yield cells[begin : begin + CHUNK]


def add_to(blocks: la.MatrixCSR, space: fem.FunctionSpace, cells: Indices, matrices: FloatArray) -> None:
    """Add the matrices (k, n, n) of some cells of a space to a matrix over its dofs; not collective."""
    add_cell_matrices(blocks.data, blocks.indptr, blocks.indices, space.dofmap.list[cells], space.dofmap.bs, matrices)


@entry_kernel
def add_cell_tensors(cells, nodes, x, address, constants, given, found, coordinates, row, tensor):  # type: ignore[no-untyped-def]
    """Add what compiled code makes of each cell.

    Args:
        cells: (k,).
        nodes: (all cells, m) of the geometry.
        x: (nodes, 3) m.
        address: of the code.
        constants: what it takes.
        given: (k, w) values of the functions that it reads.
        found: (k, entries) to which it is added.
        coordinates: (m, 3) room for the nodes of a cell.
        row: (w + 1,) room for its values.
        tensor: (entries,) room for what the code makes of them.
    """
    for c in range(cells.shape[0]):
        for i in range(nodes.shape[1]):
            for d in range(3):
                coordinates[i, d] = x[nodes[cells[c], i], d]
        for i in range(given.shape[1]):
            row[i] = given[c, i]
        for i in range(found.shape[1]):
            tensor[i] = 0.0
        pointers = tensor.ctypes.data, row.ctypes.data, constants.ctypes.data, coordinates.ctypes.data
        call_tabulate(address, pointers)
        for i in range(found.shape[1]):
            found[c, i] += tensor[i]


@entry_kernel
def add_cell_matrices(data, indptr, indices, nodes, size, matrices):  # type: ignore[no-untyped-def]
    """Add the matrices of cells to one of size x size blocks.

    Args:
        data: of the matrix, blocks row by row.
        indptr: of the matrix.
        indices: of the matrix, ascending in a row.
        nodes: (k, n) block rows and columns of each cell.
        size: of a block.
        matrices: (k, size n, size n).
    """
    for c in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            begin, end = indptr[nodes[c, i]], indptr[nodes[c, i] + 1]
            for j in range(nodes.shape[1]):
                low, high, column = begin, end, nodes[c, j]
                while high - low > 1:
                    middle = (low + high) // 2
                    if indices[middle] <= column:
                        low = middle
                    else:
                        high = middle
                for a in range(size):
                    for b in range(size):
                        data[size * size * low + size * a + b] += matrices[c, size * i + a, size * j + b]
