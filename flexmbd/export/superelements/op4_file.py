"""Nastran OUTPUT4 matrices as text (.op4): K, M and D of a superelement, all digits.

The file holds no names and no geometry; ours holds besides the matrices PAAX of positions, QAAX of quaternions and
NAAX of the names' characters, which other programs need not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.superelements.op4_binary import binary_matrices, is_binary
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    MOST_ROWS,
    InterfaceNode,
    ReadMatrices,
    body_of,
    position,
    unit_quaternion,
)
from flexmbd.export.superelements.unit_system import SI
from flexmbd.files.whole_file import read_file, read_text, write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import from_quaternion, to_quaternion

CAPABILITIES = Capabilities(large_motion=False)

_RECTANGULAR, _SYMMETRIC = 2, 6
_HEADER = re.compile(r"([ \d-]{8})([ \d-]{8})([ \d]{8})([ \d]{8})(.{8})\s*(?:\d+P,?)?(\d+)[ED](\d+)\.\d+\s*", re.ASCII)


@checked_writer
def op4(body: ReducedBody, path: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write K, M and D of a body as the matrices KAAX, MAAX and, where it is damped, BAAX. Not collective.

    Rows: of each interface in the record's order three translations and three rotations along B's axes, then the
    fixed-interface modes. PAAX (b, 3) are the positions in B.

    Args:
        body: with an interface.
        path: destination, by habit .op4.
        lossy: as of all formats.

    Returns:
        What is not in the file.

    Raises:
        ExportError: the body has no superelement, or the destination cannot be written.
    """
    left = check_losses(body, CAPABILITIES, kind="OP4", lossy=lossy)
    element = superelement(body)
    # a row a frame: whether it carries B (1), B floats (2) or neither (0), then the name's characters
    letters = np.zeros((len(element.names), 1 + max(len(name) for name in element.names)))
    for row, name in zip(letters, element.names, strict=True):
        row[0] = 2.0 if element.frame is None else float(element.frame == name)
        row[1 : 1 + len(name)] = [ord(letter) for letter in name]
    matrices = {
        "KAAX": element.K,
        "MAAX": element.M,
        **({"BAAX": element.D} if np.any(element.D) else {}),
        "PAAX": element.p,
        "QAAX": np.array([to_quaternion(R) for R in element.R]),
        "NAAX": letters,
    }
    lines = [line for name, matrix in matrices.items() for line in _matrix_lines(name, matrix)]
    write_file(path, "\n".join(lines) + "\n")
    return left


def _matrix_lines(name: str, matrix: FloatArray) -> Iterator[str]:
    rows, columns = matrix.shape
    form = _SYMMETRIC if name in ("KAAX", "MAAX", "BAAX") else _RECTANGULAR
    yield f"{columns:8d}{rows:8d}{form:8d}{2:8d}{name:<8s}1P,3E23.16"
    for number, column in enumerate(matrix.T, start=1):
        yield f"{number:8d}{1:8d}{rows:8d}"
        # an exponent of three digits would not fit
        words = [f"{value if abs(value) > 1e-99 else 0.0:23.16E}" for value in column.tolist()]
        for at in range(0, rows, 3):
            yield "".join(words[at : at + 3])
    yield f"{columns + 1:8d}{1:8d}{1:8d}"
    yield f"{1.0:23.16E}"


@checked("path", "interfaces", "frame", "mass", error=ExportError)
def read_op4(
    path: str | Path,
    *,
    interfaces: Mapping[str, InterfaceNode] | None = None,
    frame: str | None = None,
    units: str | None = None,
) -> ReducedBody:
    """Read a body from dense real matrices, in text or binary form, names beginning with K, M and B. Not collective.

    Args:
        path: what OUTPUT4 wrote, not sparse.
        interfaces: names and positions, in the order of the rows, six each; the rest are modes; default: as a file of
            ours says.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.
        units: of the file's numbers, positions included, as length-mass-time, "mm-t-s"; default: "m-kg-s", as files of
            ours are.

    Raises:
        ExportError: the file is damaged, or holds something else; its units are others.
    """
    data = read_file(path)
    text = "" if is_binary(data) else read_text(path)
    try:
        matrices = _parsed(text) if text else binary_matrices(data)
        ours, at, floating = _interfaces(matrices)
    except (ValueError, IndexError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error
    found: dict[str, FloatArray] = {}
    for letter in "KMB":
        names = [name for name in matrices if name.startswith(letter)]
        if len(names) > 1 or (not names and letter != "B"):
            there = ", ".join(matrices) or "none"
            raise ExportError(f"{path} should hold one matrix whose name begins with {letter}; it holds {there}")
        if names:
            found[letter] = matrices[names[0]]
    K, M, D, said = found["K"], found["M"], found.get("B"), SI if ours else None
    read = ReadMatrices(ours, K, M, D, frame=at, floating=floating, units=said)
    return body_of(read, path, interfaces=interfaces, frame=frame, units=units)


def _parsed(text: str) -> dict[str, FloatArray]:
    lines = text.splitlines()
    matrices: dict[str, FloatArray] = {}
    at = 0
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        header = _HEADER.match(lines[at].ljust(64))
        if header is None:
            raise ValueError(f"line {at + 1} is not a header of a matrix in text form: {lines[at][:60]!r}")
        columns, rows, form, kind = (int(header[i]) for i in range(1, 5))
        name = header[5].strip().upper()
        if rows < 0 or kind not in (1, 2) or not 0 < columns <= MOST_ROWS or not 0 < rows <= MOST_ROWS:
            raise ValueError(
                f"matrix {name} has {rows} rows, {columns} columns, form {form} and type {kind}; read are dense real "
                f"ones of at most {MOST_ROWS} rows"
            )
        if name in matrices:
            raise ValueError(f"matrix {name} is there twice")
        per_line, width = int(header[6]), int(header[7])
        if not (0 < per_line <= 20 and 8 <= width <= 40):
            raise ValueError(f"matrix {name} has {per_line} numbers of {width} characters a line")
        matrices[name], at = _dense(lines, at + 1, (rows, columns), layout=(per_line, width), name=name)
    return matrices


def _dense(
    lines: list[str], at: int, shape: tuple[int, int], *, layout: tuple[int, int], name: str
) -> tuple[FloatArray, int]:
    """A matrix from its columns, and the line after it."""
    rows, columns = shape
    # zeros are not written, so the file's length says little; a superelement's matrices are dense
    if rows * columns > 64 * sum(map(len, lines[at:])):
        raise ValueError(f"matrix {name} claims {rows} x {columns} entries, and the file is too short to hold them")
    matrix = np.zeros(shape)
    per_line, width = layout
    while True:
        number, first, words = (int(lines[at][i : i + 8]) for i in (0, 8, 16))
        count = -(-words // per_line)
        block = lines[at + 1 : at + 1 + count]
        if words < 1 or len(block) < count:
            raise ValueError(f"matrix {name}: column {number} is cut short")
        at += 1 + count
        if number == columns + 1:
            return matrix, at
        if first == 0:
            raise ValueError(f"matrix {name} is written as a sparse one; write it dense")
        if not (0 < number <= columns and 0 < first and first - 1 + words <= rows):
            last = first - 1 + words
            raise ValueError(f"matrix {name} of {rows} x {columns}: column {number} has rows {first} to {last}")
        text = [line.ljust(per_line * width)[i * width : (i + 1) * width] for line in block for i in range(per_line)]
        matrix[first - 1 : first - 1 + words, number - 1] = [float(word.replace("D", "E")) for word in text[:words]]


def _interfaces(matrices: Mapping[str, FloatArray]) -> tuple[dict[str, InterfaceNode], str | None, bool]:
    """Interfaces, body frame's interface and whether it floats, of a file of ours."""
    if not {"PAAX", "QAAX", "NAAX"} <= set(matrices):
        return {}, None, False
    p, quaternions, letters = (matrices[name] for name in ("PAAX", "QAAX", "NAAX"))
    if not len(p) == len(quaternions) == len(letters):
        raise ValueError("PAAX, QAAX and NAAX are of different numbers of interfaces")
    interfaces: dict[str, InterfaceNode] = {}
    frame = None
    for place, quaternion, row in zip(p, quaternions, letters, strict=True):
        if not (np.isfinite(row).all() and (row >= 0.0).all() and (row < 0x110000).all()):
            raise ValueError("NAAX holds no characters")
        name = "".join(chr(int(letter)) for letter in row[1:] if letter > 0.0)
        if name in interfaces:
            raise ValueError(f"two interfaces are called {name!r}")
        interfaces[name] = InterfaceNode(position(place), None, from_quaternion(unit_quaternion(quaternion)))
        frame = name if row[0] == 1.0 else frame
    return interfaces, frame, bool((letters[:, 0] == 2.0).any())
