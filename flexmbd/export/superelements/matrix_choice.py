"""Which matrices of a file of Nastran's are stiffness, mass and damping.

Names begin with K, M, B and, for structural damping, K4; what follows is the set of degrees of freedom, as in KAA and
MAA, and says which belong together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray

#: What a matrix is for: stiffness, mass, viscous damping, structural damping.
_PREFIXES = {"K": "K", "M": "M", "D": "B", "K4": "K4"}
# What EXTSEOUT's names end in: MSC's and NX's, of DMIG and of OP4.
_OF_EXTSEOUT = ("AA", "AAX", "XX", "XX1")
_LISTED = 24
#: Roles to names of matrices, as ``{"K": "KAA", "M": "MAA", "D": "BAA", "K4": "K4AA"}``.
MatrixNames = Mapping[str, str]


def chosen_matrices(
    path: str | Path,
    names: Iterable[str],
    load: Callable[[int], FloatArray],
    *,
    matrices: MatrixNames | None,
    w4: float | None,
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """K, M and D, the damping, of a file.

    Args:
        path: of the file.
        names: of its matrices in order, upper case.
        load: the matrix by its place among them.
        matrices: roles to names where the file has several, "KAA:2" the second one of a name; default: by their names.
        w4: rad/s, at which structural damping K4 does the work of the viscous D = K4 / w4, Nastran's parameter W4;
            infinity leaves it out.

    Raises:
        ExportError: there is none, or several; they are of unlike sizes; structural damping is there and nothing says
            at which frequency.
    """
    there = list(names)
    labels = [
        name if there.count(name) == 1 else f"{name}:{there[: i + 1].count(name)}" for i, name in enumerate(there)
    ]
    if w4 is not None and not (isinstance(w4, int | float) and not isinstance(w4, bool) and w4 > 0.0):
        raise ExportError(f"{path}: w4 is an angular frequency in rad/s, or infinity, not {w4!r}")
    given = _given(path, labels, matrices)
    found: dict[str, str] = {}
    loaded: dict[str, FloatArray] = {}
    for role in _PREFIXES:
        name = given.get(role) or _by_name(path, role, labels, found.get("K"))
        if name is None:
            continue
        matrix = load(labels.index(name))
        # OUTPUT4 of EXTSEOUT writes one zero where there is no damping
        if role in ("D", "K4") and role not in given and not np.any(matrix):
            continue
        found[role], loaded[role] = name, matrix
        if matrix.shape != loaded["K"].shape or matrix.shape[0] != matrix.shape[1]:
            raise ExportError(
                f"{path}: {found['K']} is of size {loaded['K'].shape}, {name} of {matrix.shape}; they are not the "
                "square matrices of one body: say which by matrices={'K': ..., 'M': ...}"
            )
    K4, D = loaded.get("K4"), loaded.get("D")
    if K4 is not None and np.any(K4):
        if w4 is None:
            raise ExportError(
                f"{path}: {found['K4']} is structural damping, in the units of a stiffness, and a machine takes "
                "viscous damping: give w4, the angular frequency in rad/s at which the two shall be the same, "
                "D = K4 / w4 (Nastran's PARAM,W4), or w4=math.inf to leave it out"
            )
        if math.isfinite(w4):
            viscous: FloatArray = np.asarray(K4 / w4, dtype=np.float64)
            D = viscous if D is None else np.asarray(D + viscous)
    return loaded["K"], loaded["M"], D


def _given(path: str | Path, there: list[str], matrices: MatrixNames | None) -> dict[str, str]:
    given = {role: str(name).upper() for role, name in (matrices or {}).items()}
    for role, name in given.items():
        if role not in _PREFIXES:
            raise ExportError(f"{path}: matrices has no role {role!r}; roles are {', '.join(_PREFIXES)}")
        if name not in there:
            raise ExportError(
                f"{path} has no one matrix {name}; it holds {', '.join(there[:_LISTED]) or 'none'}"
                f"{', ...' if len(there) > _LISTED else ''}"
            )
        if role == "D" and name.startswith("K4"):
            raise ExportError(
                f"{path}: {name} is structural damping, in the units of a stiffness: give it as "
                "matrices={..., 'K4': " + repr(name) + "} and w4, rad/s"
            )
    return given


def _by_name(path: str | Path, role: str, there: list[str], stiffness: str | None) -> str | None:
    """The matrix that EXTSEOUT calls so; else that of the stiffness's set; else the only one that begins so."""
    prefix = _PREFIXES[role]
    names = [name for name in there if name.startswith(prefix) and not (role == "K" and name.startswith("K4"))]
    usual = [prefix + ending for ending in _OF_EXTSEOUT if prefix + ending in names]
    of_set = [] if stiffness is None else [name for name in names if name == prefix + stiffness[1:]]
    chosen = of_set or usual or names
    if role in ("D", "K4") and not names:
        return None
    if not chosen or (len(chosen) > 1 and not (of_set or usual)):
        raise ExportError(
            f"{path} should hold one matrix whose name begins with {prefix}; it holds "
            f"{', '.join(there[:_LISTED]) or 'none'}{', ...' if len(there) > _LISTED else ''}: say which by "
            f"matrices={{{role!r}: ...}}"
        )
    return chosen[0]
