"""Every difference between DOLFINx 0.9, 0.10 and 0.11 that flexmbd meets, and nothing else.

Tested with 0.9 and 0.11; the branches for 0.10 alone follow its published sources.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, jit, mesh

from flexmbd.errors import MissingLibraryError, VersionError
from flexmbd.files.form_cache import mend_form_cache
from flexmbd.files.form_compiler import choose_compiler, lacking_for_forms


def check_version(version: str) -> None:
    """Refuse a DOLFINx that flexmbd was not tested with; called as this module is loaded, not collective.

    Raises:
        VersionError: it is older than 0.9 or newer than 0.11.
    """
    if not (0, 9) <= tuple(int(n) for n in re.findall(r"\d+", version)[:2]) <= (0, 11):
        raise VersionError(
            f"flexmbd runs with DOLFINx 0.9 to 0.11, and this is {version}: see environment.yml, or use ./run"
        )


check_version(dolfinx.__version__)

# Seconds for which a form is waited for that another process compiles; an involved one takes more than DOLFINx's 10.
_waits, _text = jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"]
jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (max(_waits, 300), _text)

if MPI.COMM_WORLD.rank == 0:  # which compiles for all
    mend_form_cache(Path(jit.get_options()["cache_dir"]))


def says_what_is_lacking(compile_form: Callable[..., Any]) -> Callable[..., Any]:
    """DOLFINx's compilation of a form, which names a compiler or headers that are not there.

    Forms that were compiled before need neither. Collective as that compilation is; all ranks look for themselves, so
    that they raise alike.
    """

    @functools.wraps(compile_form)
    def compiled(*arguments: Any, **options: Any) -> Any:
        try:
            return compile_form(*arguments, **options)
        except Exception as error:
            lacking = lacking_for_forms()
            if lacking:
                raise MissingLibraryError(lacking) from error
            raise

    return compiled


choose_compiler()
jit.ffcx_jit = says_what_is_lacking(jit.ffcx_jit)


def cell_nodes(domain: mesh.Mesh) -> npt.NDArray[np.int32]:
    """Local nodes of each cell, owned cells first, (n_cells, nodes of a cell); not collective.

    Up to 0.10 there is one `dofmap`; later ones deprecate it for `dofmaps`, one by cell type.
    """
    geometry = domain.geometry
    if not hasattr(geometry, "dofmaps"):
        return geometry.dofmap
    return geometry.dofmaps(0) if callable(geometry.dofmaps) else geometry.dofmaps[0]


def cell_kernel(comm: MPI.Comm, form: ufl.Form) -> tuple[int, list[int], Any]:
    """The code FFCx makes of a form of one integral over cells: its address; collective, compiles.

    From 0.10 on it takes one more argument at the end, which may be null.

    Returns:
        The address of `tabulate_tensor`; which of the form's coefficients it takes, in order; the module
        to be kept while the address is used.
    """
    made, module, _ = jit.ffcx_jit(comm, form, form_compiler_options={"scalar_type": np.float64})
    (integral,) = (made.form_integrals[k] for k in range(made.form_integral_offsets[1]))
    address = int(module.ffi.cast("intptr_t", integral.tabulate_tensor_float64))
    return address, [made.original_coefficient_positions[k] for k in range(made.num_coefficients)], module


def collapse(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, npt.NDArray[np.int32]]:
    """A part of a mixed space as a space of its own, and the dof of the whole for each of its dofs, (n,); collective.

    Up to 0.10 the dofs are one list; later ones have a list of arrays, one by cell type.
    """
    own, dofs = space.collapse()
    return own, np.asarray(dofs, dtype=np.int32).reshape(-1)


def coordinate_map(domain: mesh.Mesh) -> Any:
    """The map from the reference cell, which has `pull_back`; not collective.

    Up to 0.10 there is one `cmap`; later ones deprecate it for `cmaps`, one by cell type.
    """
    maps = getattr(domain.geometry, "cmaps", None)
    if maps is None:
        return domain.geometry.cmap
    return maps(0) if callable(maps) else maps[0]


def geometry_degree(domain: mesh.Mesh) -> int:
    """Degree of the map from the reference cell; not collective.

    Up to 0.10 there is one `cmap`; later ones deprecate it for `cmaps`, one by cell type.
    """
    return int(coordinate_map(domain).degree)


def interpolation_points(space: fem.FunctionSpace) -> npt.NDArray[np.float64]:
    """Interpolation points of a space's element, (n, 3); not collective.

    Up to 0.9 a method, from 0.10 on a property.
    """
    points = space.element.interpolation_points
    return points() if callable(points) else points


def topological_dimension(domain: ufl.Mesh) -> int:
    """Dimension of the cells of a UFL domain.

    With DOLFINx 0.9 a method, later a property.
    """
    dim = domain.topological_dimension
    return dim() if callable(dim) else dim
