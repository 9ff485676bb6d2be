"""Nastran punch files of reduced matrices (.pch): DMIG, with the GRIDs and SPOINTs that they name.

Six components of a GRID are an interface frame, three are a node of a nodal interface, an SPOINT is a fixed-interface
mode.  Numbers stand in fields of 16 characters, which is 11 to 14 digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.superelements.matrix_choice import MatrixNames, chosen_matrices
from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.nastran_body import nastran_body
from flexmbd.export.superelements.node_binding import Interfaces, node_sets
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    checked_size,
    comment,
    commented_interfaces,
    node_comment,
)
from flexmbd.export.superelements.unit_system import SI, from_si, unit_system
from flexmbd.files.bulk_cards import Card, read_bulk
from flexmbd.files.mesh_text import read_lines
from flexmbd.files.nastran_grids import GRID_CARDS, Grids, read_grids
from flexmbd.files.whole_file import write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(nodal_interfaces=True, large_motion=False)

_LARGEST_ID = 99_999_999


@checked_writer
def dmig(
    body: ReducedBody, path: str | Path, *, first: int = 1, units: str = SI, lossy: bool = False
) -> tuple[str, ...]:
    """Write K, M and D of a body as DMIG KAAX, MAAX and BAAX, with GRIDs and SPOINTs. Not collective.

    GRIDs `first` and on are the interfaces in the record's order, with B's axes, then the nodes of nodal interfaces,
    components 1 to 3, the others held; the numbers after them are SPOINTs.
    BAAX is there where the body is damped. Names and axes of the interfaces stand in comments.

    Args:
        body: with an interface.
        path: destination, by habit .pch.
        first: number of the first GRID, for decks whose low numbers are taken.
        units: of the file's numbers, as length-mass-time, "mm-t-s".
        lossy: as of all formats.

    Returns:
        The parts that are not in the file.

    Raises:
        ExportError: the body has no superelement, the numbers would have more than eight digits, or the destination
            cannot be written.
    """
    left = check_losses(body, CAPABILITIES, kind="DMIG", lossy=lossy)
    element = from_si(superelement(body, nodes=True), unit_system(units))
    b, k, m = len(element.names), len(element.node), element.n_modes
    if first < 1 or first + b + k + m - 1 > _LARGEST_ID:
        raise ExportError(f"DMIG: numbers from {first} on do not fit; choose first=1 to {_LARGEST_ID - b - k - m + 1}")
    dofs = [(first + i, c + 1) for i in range(b) for c in range(6)]
    dofs += [(first + b + i, c + 1) for i in range(k) for c in range(3)] + [(first + b + k + i, 0) for i in range(m)]
    lines = [f"$ reduced body, units {units}; matrices by K2GG=KAAX, M2GG=MAAX, B2GG=BAAX"]
    for i, p in enumerate(element.p):
        lines.append("$ " + comment(element, i, node=first + i, units=units))
        x, y, z = map(wide, p.tolist())
        lines += [f"GRID*   {first + i:<16d}{'0':<16s}{x:<16s}{y:<16s}*", f"*       {z:<16s}{'0':<16s}"]
    for i, place in enumerate(element.x):
        node = first + b + i
        x, y, z = map(wide, place.tolist())
        lines.append("$ " + node_comment(element, i, node=node))
        lines += [f"GRID*   {node:<16d}{'0':<16s}{x:<16s}{y:<16s}*", f"*       {z:<16s}{'0':<16s}{'456':<16s}"]
    lines += [f"SPOINT  {number:<8d}" for number, component in dofs if component == 0]
    matrices = {"KAAX": element.K, "MAAX": element.M}
    if np.any(element.D):
        matrices["BAAX"] = element.D
    for name, matrix in matrices.items():
        lines += _cards(name, matrix, dofs)
    write_file(path, "\n".join(lines) + "\n")
    return left


def _cards(name: str, matrix: FloatArray, dofs: list[Dof]) -> Iterator[str]:
    """The lower triangle, column by column."""
    yield f"DMIG    {name:<8s}{0:<8d}{6:<8d}{2:<8d}{0:<8d}"
    for j, (node, component) in enumerate(dofs):
        rows = [j + int(i) for i in np.flatnonzero(matrix[j:, j])]
        if not rows:
            continue
        yield f"DMIG*   {name:<16s}{node:<16d}{component:<16d}{'':<16s}*"
        for i in rows:
            yield f"*       {dofs[i][0]:<16d}{dofs[i][1]:<16d}{wide(float(matrix[i, j])):<16s}"


def wide(value: float) -> str:
    """A number in at most 16 characters, as Nastran reads it, with as many digits as fit."""
    if value == 0.0:
        return "0.0"
    best, error = "0.0", abs(value)
    for digits in range(14, 8, -1):
        mantissa, exponent = f"{value:.{digits}E}".split("E")
        text = f"{mantissa}{int(exponent):+d}"
        if len(text) <= 16:
            best, error = text, abs(float(f"{mantissa}E{exponent}") - value)
            break
    for digits in range(14, -1, -1):
        text = f"{value:.{digits}f}"
        if len(text) <= 16:
            text = text if "." in text else f"{text}."
            return text if len(text) <= 16 and abs(float(text) - value) < error else best
    return best


@checked("path", "interfaces", "frame", "mass", "matrices", error=ExportError)
def read_dmig(
    path: str | Path,
    *,
    interfaces: Interfaces | None = None,
    frame: str | None = None,
    units: str | None = None,
    matrices: MatrixNames | None = None,
    w4: float | None = None,
) -> ReducedBody:
    """Read a body from DMIG matrices whose names begin with K, M and, where it is damped, B or K4. Not collective.

    Args:
        path: punch file or part of a deck, in small, large or comma-separated fields; other cards are passed over.
            GRIDs may stand and move in coordinate systems of their own.
        interfaces: names of the GRIDs with six components, `InterfaceNode.node` their numbers; or sets of GRIDs, as
            the three components of solids, each bound to a rigid frame (`NodeSet`); default: as a file of ours says,
            else all GRIDs of the file, called "grid 7" and so on.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.
        units: of the file's numbers, positions included, as length-mass-time, "mm-t-s"; default: as a file of ours
            says, else "m-kg-s".
        matrices: which are taken where there are several, ``{"K": "KAAX", "M": "MAAX", "D": "BAAX", "K4": "K4AAX"}``.
        w4: angular frequency (rad/s) at which structural damping K4 is taken as the viscous K4 / w4; infinity leaves
            it out.

    Raises:
        ExportError: the file is damaged, or holds something else; its units are others; it has structural damping and
            w4 is not given.
    """
    try:
        deck = read_deck(Path(path))
    except ValueError as error:
        raise ExportError(f"{path}: {error}") from error
    ours = commented_interfaces(read_lines(Path(path)), bound=bool(node_sets(interfaces)))
    dofs = deck.dofs()
    if dofs:
        checked_size(len(dofs), path)
    names = list(deck.entries)

    def load(number: int) -> FloatArray:
        try:
            return deck.dense(names[number])
        except ValueError as error:
            raise ExportError(f"{path}: {error}") from error

    found = chosen_matrices(path, names, load, matrices=matrices, w4=w4)
    return nastran_body(
        path, deck.grids, dofs, found, ours=ours, interfaces=interfaces, frame=frame, units=units
    )


@dataclass(frozen=True, eq=False)
class Deck:
    """Cards of a deck: GRIDs, forms with types, and entries (row, column, value) of matrices by name."""

    grids: Grids
    forms: dict[str, tuple[int, int]]
    entries: dict[str, list[tuple[Dof, Dof, float]]]

    def dofs(self) -> list[Dof]:
        """Node and component of each row of the matrices, by number."""
        return sorted({dof for entries in self.entries.values() for row, column, _ in entries for dof in (row, column)})

    def dense(self, name: str) -> FloatArray:
        """A matrix, rows as `dofs` has them, or ValueError."""
        form, kind = self.forms[name]
        if not _is_square((form, kind)):
            raise ValueError(f"DMIG {name} has form {form}, type {kind}; read are real ones, square or symmetric")
        order = {dof: row for row, dof in enumerate(self.dofs())}
        matrix = np.zeros((len(order), len(order)))
        for row, column, value in self.entries[name]:
            i, j = order[row], order[column]
            matrix[i, j] = value
            if form == 6:
                matrix[j, i] = value
        return matrix


def _is_square(form: tuple[int, int]) -> bool:
    """Whether a matrix is square or symmetric, and real."""
    return form[0] in (1, 6) and form[1] in (1, 2)


def read_deck(path: Path) -> Deck:
    """The cards of a deck, others passed over.

    Raises:
        ValueError: one is damaged.
        ExportError: it cannot be read.
    """
    cards = read_bulk(path, wanted=("DMIG", *GRID_CARDS), punched=True).cards
    deck = Deck(read_grids(cards), {}, {})
    for card in cards.get("DMIG", []):
        _add(deck, card)
    return deck


def _add(deck: Deck, card: Card) -> None:
    name = card[0].upper()
    if name not in deck.forms:
        deck.forms[name] = card.whole(2), card.whole(3)
        deck.entries[name] = []
        return
    if not _is_square(deck.forms[name]):  # loads, and complex ones
        return
    column = _dof(card, 1)
    for i in range(4, len(card), 4):
        if any(card[i : i + 3]):
            deck.entries[name].append((_dof(card, i), column, card.real(i + 2)))


def _dof(card: Card, at: int) -> Dof:
    """Node and component, numbers from 0 on, or ValueError."""
    node, component = card.whole(at), card.whole(at + 1)
    if node < 0 or component < 0:
        raise card.error(f"{card.title}: component {component} of node {node}: there are no negative ones")
    return node, component
