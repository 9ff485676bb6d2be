"""Nastran OUTPUT4 matrices (.op4): K, M and D of a superelement, all digits.

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
from flexmbd.export.superelements.matrix_choice import MatrixNames, chosen_matrices
from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.nastran_body import nastran_body
from flexmbd.export.superelements.nastran_rows import ROW_CARDS, matrix_rows
from flexmbd.export.superelements.node_binding import Interfaces, single_nodes
from flexmbd.export.superelements.op4_binary import binary_matrices, is_binary
from flexmbd.export.superelements.op4_matrix import Op4Matrix
from flexmbd.export.superelements.op4_text import text_matrices
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    FileComments,
    InterfaceNode,
    ReadMatrices,
    body_of,
    position,
    unit_quaternion,
)
from flexmbd.export.superelements.unit_system import SI
from flexmbd.files.bulk_cards import read_bulk
from flexmbd.files.nastran_grids import GRID_CARDS, Grids, read_grids
from flexmbd.files.whole_file import read_file, read_text, write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import from_quaternion, to_quaternion

CAPABILITIES = Capabilities(large_motion=False)

_RECTANGULAR, _SYMMETRIC = 2, 6
# A card that tells the rows of the matrices.
_ROWS = re.compile(r"^ *(EXTRN|SECONCT)\b", re.IGNORECASE | re.MULTILINE)


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
        The parts that are not in the file.

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


@checked("path", "interfaces", "frame", "mass", "deck", "matrices", error=ExportError)
def read_op4(
    path: str | Path,
    *,
    deck: str | Path | None = None,
    interfaces: Interfaces | None = None,
    frame: str | None = None,
    units: str | None = None,
    matrices: MatrixNames | None = None,
    w4: float | None = None,
) -> ReducedBody:
    """Read a body from real matrices, in text or binary form, names beginning with K, M, B and K4. Not collective.

    Args:
        path: the file that OUTPUT4 wrote, dense, sparse or BIGMAT; matrices that are not taken may be of any kind.
        deck: the .pch or .asm that EXTSEOUT wrote beside it, which says what the rows are (EXTRN, SECONCT) and where
            the GRIDs lie; default: the one of the same name, where it is there.
        interfaces: with a deck as of `read_dmig`; without: names and positions, in the order of the rows, six each,
            the rest are modes; default: as a file of ours says.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.
        units: of the file's numbers, positions included, as length-mass-time, "mm-t-s"; default: "m-kg-s", as files of
            ours are.
        matrices: which are taken where there are several, ``{"K": "KAA", "M": "MAA", "D": "BAA", "K4": "K4AA"}``;
            "KAA:2" is the second one of that name.
        w4: angular frequency (rad/s) at which structural damping K4 is taken as the viscous K4 / w4; infinity leaves
            it out.

    Raises:
        ExportError: the file or the deck is damaged, or holds something else; its units are others; it has structural
            damping and w4 is not given.
    """
    data = read_file(path)
    try:
        stored = binary_matrices(data) if is_binary(data) else text_matrices(read_text(path))
        ours, at, floating = _interfaces({one.name: one for one in stored})
    except (ValueError, IndexError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error

    def load(number: int) -> FloatArray:
        try:
            return stored[number].dense()
        except (ValueError, OverflowError) as error:
            raise ExportError(f"{path}: {error}") from error

    K, M, D = chosen_matrices(path, [one.name for one in stored], load, matrices=matrices, w4=w4)
    if deck is None and not ours and not any(_is_placed(one) for one in (interfaces or {}).values()):
        deck = _deck_beside(path)
    if deck is None:
        frames = single_nodes(interfaces)
        if len(frames) < len(interfaces or {}):
            raise ExportError(f"{path} does not say which nodes its rows are: give deck=, the .pch or .asm beside it")
        read = ReadMatrices(ours, K, M, D, frame=at, floating=floating, units=SI if ours else None)
        return body_of(read, path, interfaces=frames or None, frame=frame, units=units)
    grids, dofs = _boundary(Path(deck))
    if len(dofs) != len(K):
        raise ExportError(f"{deck} names {len(dofs)} rows, and the matrices of {path} have {len(K)}")
    nobody = FileComments({}, None, False, None)
    return nastran_body(
        path, grids, dofs, (K, M, D), ours=nobody, interfaces=interfaces, frame=frame, units=units
    )


def _is_placed(one: object) -> bool:
    return isinstance(one, InterfaceNode) and one.position is not None


def _deck_beside(path: str | Path) -> Path | None:
    """The .pch or .asm of the same name, where one tells the rows."""
    for suffix in (".pch", ".asm"):
        beside = Path(path).with_suffix(suffix)
        if beside.is_file() and _ROWS.search(read_text(beside)):
            return beside
    return None


def _boundary(deck: Path) -> tuple[Grids, list[Dof]]:
    """GRIDs of a deck, and node and component of each row of the matrices."""
    try:
        cards = read_bulk(deck, wanted=(*GRID_CARDS, *ROW_CARDS), punched=True).cards
        grids, dofs = read_grids(cards), matrix_rows(cards)
    except ValueError as error:
        raise ExportError(f"{deck}: {error}") from error
    if not dofs:
        raise ExportError(
            f"{deck} has neither EXTRN nor SECONCT, and so does not say the order of the rows: give the .pch or .asm "
            "that EXTSEOUT wrote with the .op4, or interfaces={name: InterfaceNode(position)} in the order of the rows"
        )
    return grids, dofs


def _interfaces(matrices: Mapping[str, Op4Matrix]) -> tuple[dict[str, InterfaceNode], str | None, bool]:
    """Interfaces, body frame's interface and whether it floats, of a file of ours."""
    if not {"PAAX", "QAAX", "NAAX"} <= set(matrices):
        return {}, None, False
    p, quaternions, letters = (matrices[name].dense() for name in ("PAAX", "QAAX", "NAAX"))
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
