"""Nastran punch files of reduced matrices (.pch): DMIG, with the GRIDs and SPOINTs that they name.

Six components of a GRID are an interface frame, three are a node of a nodal interface, an SPOINT is a fixed-interface
mode.  Numbers stand in fields of 16 characters, which is 11 to 14 digits.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.superelements.full_matrices import NodeSet
from flexmbd.export.superelements.node_binding import (
    Interfaces,
    bound_nodes,
    node_sets,
    single_nodes,
    with_bound_nodes,
)
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    InterfaceNode,
    ReadMatrices,
    body_of,
    checked_size,
    comment,
    commented_interfaces,
    node_comment,
    position,
)
from flexmbd.export.superelements.unit_system import SI, from_si, unit_system
from flexmbd.files.whole_file import read_text, write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(nodal_interfaces=True, large_motion=False)

# Node and component (0 for SPOINTs) of a row.
_Dof = tuple[int, int]
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[edED]?([+-]?\d+))?")
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
        What is not in the file.

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


def _cards(name: str, matrix: FloatArray, dofs: list[_Dof]) -> Iterator[str]:
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


@checked("path", "interfaces", "frame", "mass", error=ExportError)
def read_dmig(
    path: str | Path,
    *,
    interfaces: Interfaces | None = None,
    frame: str | None = None,
    units: str | None = None,
) -> ReducedBody:
    """Read a body from DMIG matrices whose names begin with K, M and, where it is damped, B. Not collective.

    Args:
        path: punch file or part of a deck, in small, large or comma-separated fields; other cards are passed over.
        interfaces: names of the GRIDs with six components, `InterfaceNode.node` their numbers; or sets of GRIDs, as
            the three components of solids, each bound to a rigid frame (`NodeSet`); default: as a file of ours says,
            else all GRIDs of the file, called "grid 7" and so on.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.
        units: of the file's numbers, positions included, as length-mass-time, "mm-t-s"; default: as a file of ours
            says, else "m-kg-s".

    Raises:
        ExportError: the file is damaged, or holds something else; its units are others.
    """
    text = read_text(path)
    try:
        deck = _parsed(text)
    except (ValueError, IndexError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error
    sets = node_sets(interfaces)
    ours = commented_interfaces(text.splitlines(), bound=bool(sets))
    named = single_nodes(interfaces) or ({} if sets else dict(ours.interfaces))
    if not named and not sets:
        named = {f"grid {node}": InterfaceNode(p, node) for node, p in deck.grids.items() if node in deck.nodes}
    order = _order(deck, named, path, sets)
    K, M, D = (_matrix(deck, letter, order, path) for letter in "KMB")
    if K is None or M is None:
        raise ExportError(f"{path} holds no DMIG matrix whose name begins with {'M' if K is not None else 'K'}")
    placed = {
        name: one if one.position is not None else InterfaceNode(deck.grids.get(one.node or 0), one.node, one.axes)
        for name, one in named.items()
    }
    placed, (K, M, D) = with_bound_nodes(placed, (K, M, D), order, sets, deck.grids)
    read = ReadMatrices(placed, K, M, D, frame=ours.frame, floating=ours.floating, units=ours.units)
    return body_of(read, path, interfaces=None, frame=frame, units=units)


@dataclass(eq=False)
class _Deck:
    """Cards of a deck: positions, forms and entries (row, column, value) of matrices by name."""

    grids: dict[int, FloatArray] = field(default_factory=dict)
    forms: dict[str, int] = field(default_factory=dict)
    entries: dict[str, list[tuple[_Dof, _Dof, float]]] = field(default_factory=dict)
    nodes: set[int] = field(default_factory=set)


def _parsed(text: str) -> _Deck:
    deck = _Deck()
    for fields in _cards_of(text):
        if fields[0] == "GRID":
            if _whole(fields, 2) or _whole(fields, 6):
                raise ValueError(f"GRID {fields[1]} has coordinate systems of its own; write it in the basic one")
            deck.grids[_whole(fields, 1)] = position([_number(fields, i) for i in (3, 4, 5)])
        elif fields[0] == "DMIG":
            _add(deck, fields)
    return deck


def _add(deck: _Deck, fields: list[str]) -> None:
    name = fields[1].upper()
    if name not in deck.forms:
        form, kind = _whole(fields, 3), _whole(fields, 4)
        if form not in (1, 6) or kind not in (1, 2):
            raise ValueError(f"DMIG {name} has form {form}, type {kind}; read are real ones, square or symmetric")
        deck.forms[name] = form
        deck.entries[name] = []
        return
    column = _whole(fields, 2), _whole(fields, 3)
    for i in range(5, len(fields), 4):
        if any(fields[i : i + 3]):
            row = _whole(fields, i), _whole(fields, i + 1)
            deck.entries[name].append((row, column, _number(fields, i + 2)))
            deck.nodes |= {row[0], column[0]}


def _cards_of(text: str) -> Iterator[list[str]]:
    """Fields of one card after another, continuations joined; the first is the card's name without the star."""
    card: list[str] = []
    for line in text.splitlines():
        line = line.partition("$")[0].expandtabs().rstrip()
        if not line:
            continue
        head, fields = _fields(line)
        if head == "" or head[0] in "*+":
            if card:
                card += fields
            continue
        if card:
            yield card
        card = [head.rstrip("*").upper(), *fields]
    if card:
        yield card


def _fields(line: str) -> tuple[str, list[str]]:
    """Name and data fields of a line: four wide ones or eight small ones, those that are not there empty."""
    if "," in line:
        head, *fields = (item.strip() for item in line.split(","))
        return head, (fields + [""] * 8)[: 4 if "*" in head else 8]
    head = line[:8].strip()
    width = 16 if "*" in head else 8
    return head, [line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(64 // width)]


def _whole(fields: list[str], at: int) -> int:
    text = fields[at] if at < len(fields) else ""
    if not re.fullmatch(r"\d{0,9}", text, re.ASCII):
        raise ValueError(f"{fields[0]} {fields[1]}: {text[:30]!r} is not a whole number")
    return int(text or 0)


def _number(fields: list[str], at: int) -> float:
    text = fields[at] if at < len(fields) else ""
    found = _NUMBER.fullmatch(text or "0.")
    value = math.nan if found is None else float(f"{found[1]}e{found[2] or 0}")
    if not math.isfinite(value):
        raise ValueError(f"{fields[0]} {fields[1]}: {text[:30]!r} is not a finite number")
    return value


def _order(
    deck: _Deck, named: Mapping[str, InterfaceNode], path: str | Path, sets: Mapping[str, NodeSet]
) -> dict[_Dof, int]:
    """Row of each degree of freedom: six of each interface, then those of bound nodes and scalar points by number."""
    bound = bound_nodes(sets)
    dofs = {dof for entries in deck.entries.values() for row, column, _ in entries for dof in (row, column)}
    order: dict[_Dof, int] = {}
    for name, one in named.items():
        if one.node not in deck.nodes:
            raise ExportError(f"{path} has no matrix entries of interface {name!r}, GRID {one.node}")
        order |= {(one.node, c): len(order) + c - 1 for c in range(1, 7)}
    for node, component in sorted(dofs):
        if component == 0 or node in bound:
            order[node, component] = len(order)
        elif (node, component) not in order:
            raise ExportError(
                f"{path}: component {component} of GRID {node} is of no interface of six components; name the GRID "
                "among the interfaces, bind it to a frame (NodeSet), or couple it to one (RBE2, RBE3) before "
                "the reduction"
            )
    checked_size(len(order), path)
    return order


def _matrix(deck: _Deck, letter: str, order: Mapping[_Dof, int], path: str | Path) -> FloatArray | None:
    names = [name for name in deck.forms if name.startswith(letter)]
    if not names:
        return None
    if len(names) > 1:
        raise ExportError(f"{path} holds {' and '.join(names)}; leave one matrix beginning with {letter}")
    matrix = np.zeros((len(order), len(order)))
    for row, column, value in deck.entries[names[0]]:
        i, j = order[row], order[column]
        matrix[i, j] = value
        if deck.forms[names[0]] == 6:
            matrix[j, i] = value
    return matrix
