"""MAT files (version 5) for Simscape Multibody's block "Reduced Order Flexible Solid", Matlab and Octave.

Variables: P (b, 3) positions and quaternions (b, 4) of the interface frames in B's axes, K, M, D, n_modes, and texts:
names (a row an interface), frame and units.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.superelements.mat_file import read_mat
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    InterfaceNode,
    ReadMatrices,
    body_of,
    position,
    unit_quaternion,
)
from flexmbd.files.whole_file import write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import from_quaternion, to_quaternion

CAPABILITIES = Capabilities(large_motion=False)

_FLOATING = "(floating)"
_NUMBERS = ("P", "K", "M", "D", "quaternions")


@checked_writer
def simscape(body: ReducedBody, path: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write a body as variables of a MAT file. Not collective.

    Rows of K, M and D: of each interface in the order of P Tx Ty Tz Rx Ry Rz along B's axes, then the fixed-interface
    modes.

    Args:
        body: with an interface.
        path: destination, by habit .mat.
        lossy: as of all formats.

    Returns:
        The parts that are not in the file.

    Raises:
        ExportError: the body has no superelement, or the destination cannot be written.
    """
    import scipy.io

    left = check_losses(body, CAPABILITIES, kind="Simscape", lossy=lossy)
    element = superelement(body)
    buffer = io.BytesIO()
    variables = {
        "P": element.p,
        "K": element.K,
        "M": element.M,
        "D": element.D,
        "quaternions": np.array([to_quaternion(R) for R in element.R]),
        "n_modes": float(element.n_modes),
        "names": np.array(element.names),
        "frame": _FLOATING if element.frame is None else element.frame,
        "units": "SI: m, kg, s, N, rad",
    }
    scipy.io.savemat(buffer, variables)
    # the first 116 bytes are text, into which scipy writes the date
    text = b"MATLAB 5.0 MAT-file, reduced body in SI units".ljust(116)
    write_file(path, text + buffer.getvalue()[116:])
    return left


@checked(error=ExportError)
def read_simscape(
    path: str | Path, *, interfaces: Mapping[str, InterfaceNode] | None = None, frame: str | None = None
) -> ReducedBody:
    """Read a body from the variables P, K, M and, where they are there, D and quaternions. Not collective.

    Args:
        path: a MAT file of version 5 to 7.
        interfaces: names, in the order of P; positions and axes where the file has none; default: as a file of ours
            says, else "interface 1" and so on.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.

    Raises:
        ExportError: the file is damaged, or holds something else.
    """
    variables = read_mat(path, requested=(*_NUMBERS, "names", "frame"))
    texts = {name: value for name, value in variables.items() if isinstance(value, list)}
    arrays = {name: value for name, value in variables.items() if not isinstance(value, list)}
    try:
        ours = _interfaces(arrays, texts.get("names", []))
    except ValueError as error:
        raise ExportError(f"{path}: {error}") from error
    if not {"K", "M"} <= set(arrays):
        raise ExportError(f"{path} holds {', '.join(variables) or 'no variables'}; K and M are needed")
    named: dict[str, InterfaceNode] | None = None
    if interfaces is not None:
        known = list(ours.values()) + [None] * len(interfaces)
        named = {
            name: one if one.position is not None or of_file is None else of_file
            for (name, one), of_file in zip(interfaces.items(), known, strict=False)
        }
    at = next(iter(texts.get("frame", [])), None)
    read = ReadMatrices(
        ours, arrays["K"], arrays["M"], arrays.get("D"), frame=at if at in ours else None, floating=at == _FLOATING
    )
    return body_of(read, path, interfaces=named, frame=frame)


def _interfaces(arrays: Mapping[str, FloatArray], names: list[str]) -> dict[str, InterfaceNode]:
    """The interfaces by name, as far as the file says."""
    if "P" not in arrays:
        return {}
    P = arrays["P"]
    quaternions = arrays.get("quaternions", np.tile([1.0, 0.0, 0.0, 0.0], (len(P), 1)))
    if len(names) != len(P):
        names = [f"interface {i + 1}" for i in range(len(P))]
    if len(quaternions) != len(P) or len(set(names)) < len(names):
        raise ValueError("P, quaternions and names do not fit together")
    return {
        name: InterfaceNode(position(p), None, from_quaternion(unit_quaternion(q)))
        for name, p, q in zip(names, P, quaternions, strict=True)
    }
