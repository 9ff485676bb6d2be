"""CalculiX and Abaqus: a fragment of a deck and the matrices that it names, as text.

CalculiX takes matrices of nodes with six components, so six fixed-interface modes share a node. Abaqus takes the same
lines as *MATRIX INPUT.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_losses, checked_writer
from flexmbd.export.superelements.matrix_text import (
    Block,
    Dof,
    Entries,
    blocks,
    dense,
    number,
    triplets,
    user_element,
    whole,
)
from flexmbd.export.superelements.node_binding import Interfaces, node_sets, single_nodes, with_bound_nodes
from flexmbd.export.superelements.superelement import superelement
from flexmbd.export.superelements.superelement_frames import (
    InterfaceNode,
    ReadMatrices,
    body_of,
    checked_size,
    comment,
    commented_interfaces,
    node_comment,
)
from flexmbd.export.superelements.unit_system import SI, from_si, unit_system
from flexmbd.files.whole_file import read_text, write_file
from flexmbd.given import checked
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(nodal_interfaces=True, large_motion=False)

#: Nodes that CalculiX takes in one matrix.
_MOST_NODES = 255
# Suffixes of the files of the matrices, and what a deck of Abaqus calls them.
_PARTS = {"K": ".sti", "M": ".mas", "D": ".dam"}
_ABAQUS = {"K": "STIFFNESS", "M": "MASS", "D": "VISCOUSDAMPING"}


@checked_writer
def calculix(
    body: ReducedBody,
    path: str | Path,
    *,
    name: str = "BODY",
    first: int = 1,
    units: str = SI,
    lossy: bool = False,
) -> tuple[str, ...]:
    """Write a fragment of a deck, to be included, and beside it the matrices as .sti and .mas. Not collective.

    Blanks in the fragment's name become underscores in those of the matrices.

    Nodes `first` and on are the interfaces in the record's order, components 1 to 6 along B's axes, then the nodes of
    nodal interfaces, components 1 to 3, the others held; each node after them has six fixed-interface modes as
    components. Where the body is damped a .dam is written too, which Abaqus
    reads and CalculiX does not.

    Args:
        body: with an interface; at most 255 nodes.
        path: the fragment, by habit .inp.
        name: of the matrix in CalculiX, one to four letters or digits.
        first: number of the first node.
        units: of the file's numbers, as length-mass-time, "mm-t-s".
        lossy: as of all formats.

    Returns:
        The parts that are not in the files.

    Raises:
        ExportError: the body has no superelement or too many nodes, the name does not fit, or the destination cannot
            be written.
    """
    left = check_losses(body, CAPABILITIES, kind="CalculiX", lossy=lossy)
    element = from_si(superelement(body, nodes=True), unit_system(units))
    b, k, m = len(element.names), len(element.node), element.n_modes
    nodes = b + k + -(-m // 6)
    if not (name.isascii() and name.isalnum() and len(name) <= 4):
        raise ExportError(f"CalculiX: the matrix cannot be called {name!r}; take one to four letters or digits")
    if nodes > _MOST_NODES or first < 1 or first + nodes > 10**9:
        with_nodal = f" with the {k} of nodal interfaces" if k else ""
        raise ExportError(
            f"CalculiX: {nodes} nodes{with_nodal} from number {first} on do not fit; {_MOST_NODES} are the most"
        )
    stem = Path(path).stem.replace(" ", "_")  # CalculiX takes blanks out of file names
    if len(stem.encode()) > 60 or set(stem) & set('",='):
        raise ExportError(f"CalculiX: files cannot be called {stem!r}; take at most 60 letters, none of \" , =")
    dofs = [(first + i // 6, 1 + i % 6) for i in range(6 * b)]
    dofs += [(first + b + i // 3, 1 + i % 3) for i in range(3 * k)]
    dofs += [(first + b + k + i // 6, 1 + i % 6) for i in range(m)]
    matrices = {"K": element.K, "M": element.M}
    if np.any(element.D):
        matrices["D"] = element.D
    for part, matrix in matrices.items():
        lines = [
            f"{dofs[i][0]},{dofs[i][1]},{dofs[j][0]},{dofs[j][1]},{float(matrix[i, j]):.16E}"
            for j in range(len(dofs))
            for i in range(j, len(dofs))  # zeros too: CalculiX wants all that is in the mass in the stiffness
        ]
        write_file(Path(path).with_name(stem + _PARTS[part]), "\n".join(lines) + "\n")
    deck = [f"** reduced body, units {units}; Abaqus reads the same files by *MATRIX INPUT, and takes these nodes"]
    deck += ["** " + comment(element, i, node=first + i, units=units) for i in range(b)]
    deck += ["** " + node_comment(element, i, node=first + b + i) for i in range(k)]
    deck += [f"*NODE, NSET=N{name}"]
    places = np.vstack([element.p, element.x])
    deck += [f"{first + i}, {x:.12E}, {y:.12E}, {z:.12E}" for i, (x, y, z) in enumerate(places)]
    deck += [f"{first + i}, 0., 0., 0." for i in range(b + k, nodes)]
    # without quotes, which CalculiX does not take off
    files = f"STIFFNESS FILE={stem}.sti,MASS FILE={stem}.mas"
    deck += [f"*MATRIX ASSEMBLE,NAME={name},{files}"]
    deck += [f"*MATERIAL, NAME=M{name}", "*ELASTIC", "1., 0.3", "*DENSITY", "1."]
    if k:
        deck += ["** nodes of nodal interfaces do not turn", "*BOUNDARY"]
        deck += [f"{first + b + i}, 4, 6" for i in range(k)]
    if m % 6:
        deck += ["** components without a mode", "*BOUNDARY", f"{first + nodes - 1}, {m % 6 + 1}, 6"]
    if "D" in matrices:
        deck += [f"** damping: {stem}.dam"]
    write_file(path, "\n".join(deck) + "\n")
    return left


@checked("path", "interfaces", "frame", "mass", error=ExportError)
def read_calculix(
    path: str | Path,
    *,
    mass: str | Path | None = None,
    interfaces: Interfaces | None = None,
    frame: str | None = None,
    units: str | None = None,
) -> ReducedBody:
    """Read a body from matrices of CalculiX or Abaqus. Not collective.

    Args:
        path: a deck with *MATRIX ASSEMBLE (and *MATRIX INPUT) whose files lie beside it; a *USER ELEMENT with its
            matrices, as *SUBSTRUCTURE MATRIX OUTPUT writes it; or the stiffness as triplets.
        mass: the mass as triplets, or a user element, where the first file does not have it.
        interfaces: names of the nodes with six components, `InterfaceNode.node` their numbers; or sets of nodes, as
            the three components of solids, each bound to a rigid frame (`NodeSet`); what is left are modes; default:
            as a deck of ours says.
        frame: the interface that carries the body frame; "" for one that floats; default: as a file of ours says, else
            the first.
        units: of the file's numbers, positions included, as length-mass-time, "mm-t-s"; default: as a file of ours
            says, else "m-kg-s".

    Raises:
        ExportError: a file is damaged, or holds something else; its units are others.
    """
    text = read_text(path)
    found = list(blocks(text))
    sets = node_sets(interfaces)
    ours = commented_interfaces(text.splitlines(), bound=bool(sets))
    try:
        positions = dict(_positions(found))
        parts = _parts(found, Path(path), mass)
    except (ValueError, KeyError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error
    if not {"K", "M"} <= set(parts):
        raise ExportError(f"{path} holds no {'mass' if 'K' in parts else 'stiffness'} matrix; give mass=, of triplets")
    named = {
        name: one if one.position is not None else InterfaceNode(positions.get(one.node or 0), one.node, one.axes)
        for name, one in (single_nodes(interfaces) or ({} if sets else ours.interfaces)).items()
    }
    order = _order(parts, named, path)
    K, M = dense(parts["K"], order), dense(parts["M"], order)
    D = dense(parts["D"], order) if "D" in parts else None
    named, (K, M, D) = with_bound_nodes(named, (K, M, D), order, sets, positions)
    read = ReadMatrices(named, K, M, D, frame=ours.frame, floating=ours.floating, units=ours.units)
    return body_of(read, path, interfaces=None, frame=frame, units=units)


def _positions(found: list[Block]) -> list[tuple[int, FloatArray]]:
    places = []
    for block in found:
        if block.keyword == "NODE":
            for line in block.lines:
                words = line.split(",")
                numbers = [number(word) for word in words[1:4]]
                places.append((whole(words[0]), np.array(numbers + [0.0] * (3 - len(numbers)))))
    return places


def _parts(found: list[Block], path: Path, mass: str | Path | None) -> dict[str, Entries]:
    """Entries of K, M and D from whatever form the file has."""
    parts: dict[str, Entries] = {}
    assembled = [block for block in found if block.keyword == "MATRIXASSEMBLE"]
    inputs = {block.parameters.get("NAME", "").upper(): block for block in found if block.keyword == "MATRIXINPUT"}
    if len(assembled) > 1:
        raise ValueError(f"it assembles {len(assembled)} matrices; one is read")
    for block in assembled:
        for part, what in _ABAQUS.items():
            if f"{what}FILE" in block.parameters:
                parts[part] = _file(path, block.parameters[f"{what}FILE"])
            elif what in block.parameters:
                given = inputs[block.parameters[what].upper()]
                file = given.parameters.get("INPUT")
                parts[part] = triplets(given.lines) if file is None else _file(path, file)
        damping = [line.partition("** damping:")[2].strip() for item in found for line in item.comments]
        if any(damping):
            parts["D"] = _file(path, next(filter(None, damping)))
    if any(block.keyword == "USERELEMENT" for block in found):
        dofs, matrices = user_element(found)
        for part, kind in (("K", "STIFFNESS"), ("M", "MASS"), ("D", "VISCOUSDAMPING")):
            if kind in matrices:
                parts[part] = _entries(dofs, matrices[kind])
    elif not assembled:
        parts["K"] = triplets(found[0].lines)
    if mass is not None:
        other = list(blocks(read_text(mass)))
        if any(block.keyword == "USERELEMENT" for block in other):
            dofs, matrices = user_element(other)
            parts["M"] = _entries(dofs, matrices.get("MASS", next(iter(matrices.values()))))
        else:
            parts["M"] = triplets(other[0].lines)
    return parts


def _file(deck: Path, name: str) -> Entries:
    """Triplets of a file beside the deck."""
    if not name or Path(name).name != name:
        raise ValueError(f"its matrix file {name!r} is not in the same folder; bring them together")
    return triplets(next(blocks(read_text(deck.with_name(name)))).lines)


def _entries(dofs: list[Dof], matrix: FloatArray) -> Entries:
    return {(row, column): float(matrix[i, j]) for i, row in enumerate(dofs) for j, column in enumerate(dofs)}


def _order(parts: Mapping[str, Entries], named: Mapping[str, InterfaceNode], path: str | Path) -> dict[Dof, int]:
    """Row of each degree of freedom: six of each interface, then the others by node and component."""
    dofs = {row for entries in parts.values() for row, _ in entries}
    nodes = {node for node, _ in dofs}
    order: dict[Dof, int] = {}
    for name, one in named.items():
        if one.node not in nodes:
            raise ExportError(f"{path} has no matrix entries of interface {name!r}, node {one.node}")
        order |= {(one.node, c): len(order) + c - 1 for c in range(1, 7)}
    rest = [dof for dof in sorted(dofs) if dof not in order]
    if not set(order) <= dofs:
        node, component = sorted(set(order) - dofs)[0]
        raise ExportError(
            f"{path}: node {node} has no component {component}, and an interface has six. Bind the nodes to a frame "
            "before the reduction; or bind nodes of three components to one here, by a NodeSet; or read a whole mesh "
            "by read_triplets and reduce it by reduce_matrices"
        )
    order |= {dof: len(order) + i for i, dof in enumerate(rest)}
    checked_size(len(order), path)
    return order
