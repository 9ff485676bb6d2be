"""What a mesh file of another finite element program holds: nodes, elements and sets, by its own numbers.

Such files number nodes and elements as they like, and name sets of either; a set of elements may hold
solids, shells on their faces, or both.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]

# Kinds of elements, by meshio's names: cell, degree of the geometry, dimension.
KINDS = {
    "tetra": ("tetrahedron", 1, 3),
    "tetra10": ("tetrahedron", 2, 3),
    "hexahedron": ("hexahedron", 1, 3),
    "hexahedron20": ("hexahedron", 2, 3),
    "hexahedron27": ("hexahedron", 2, 3),
    "wedge": ("prism", 1, 3),
    "wedge15": ("prism", 2, 3),
    "wedge18": ("prism", 2, 3),
    "pyramid": ("pyramid", 1, 3),
    "pyramid13": ("pyramid", 2, 3),
    "pyramid14": ("pyramid", 2, 3),
    "triangle": ("triangle", 1, 2),
    "triangle6": ("triangle", 2, 2),
    "quad": ("quadrilateral", 1, 2),
    "quad8": ("quadrilateral", 2, 2),
    "quad9": ("quadrilateral", 2, 2),
}

@dataclass(frozen=True, eq=False)
class ElementBlock:
    """Elements of one kind.

    Attributes:
        kind: meshio's name.
        numbers: (m,) the file's numbers of them.
        nodes: (m, k) the file's numbers of their nodes, in VTK's order; 0 for a middle of an edge that is not there.
    """

    kind: str
    numbers: IntArray
    nodes: IntArray

    @property
    def cell(self) -> str:
        """basix's name of the cell."""
        return KINDS[self.kind][0]

    @property
    def dim(self) -> int:
        """Its dimension."""
        return KINDS[self.kind][2]


@dataclass(frozen=True, eq=False)
class ForeignMesh:
    """A file's nodes, elements and sets, by the file's own numbers.

    Attributes:
        path: of the file, for messages.
        node_numbers: (n,) in any order.
        points: (n, 3) coordinates, in the file's unit.
        elements: of one kind each.
        element_sets: numbers of elements, by name.
        node_sets: numbers of nodes, by name.
        surfaces: by name, numbers of elements with the label of one face of each, as "S1".
        faces: by name, (f, 4) numbers of the vertices of faces, around; -1 for the fourth of a triangle.
        helpers: names of sets that the program made for itself, which become groups where nothing else does.
        beside: how many elements there are, by their type, that bear or weigh and are neither solids nor shells.
    """

    path: Path
    node_numbers: IntArray
    points: npt.NDArray[np.float64]
    elements: Sequence[ElementBlock]
    element_sets: Mapping[str, IntArray]
    node_sets: Mapping[str, IntArray] = field(default_factory=dict)
    surfaces: Mapping[str, Sequence[tuple[IntArray, str]]] = field(default_factory=dict)
    faces: Mapping[str, IntArray] = field(default_factory=dict)
    helpers: Collection[str] = ()
    beside: Mapping[str, int] = field(default_factory=dict)


def members(ascending: IntArray, ranges: Sequence[range]) -> IntArray:
    """Those of ascending numbers that are in ranges, whatever these claim."""
    parts: list[IntArray] = []
    single = np.array([one.start for one in ranges if len(one) == 1], dtype=np.int64)
    parts.append(ascending[np.isin(ascending, single)])
    for one in ranges:
        if len(one) > 1:
            inside = ascending[np.searchsorted(ascending, one.start) : np.searchsorted(ascending, one.stop)]
            parts.append(inside[(inside - one.start) % one.step == 0])
    return np.unique(np.concatenate(parts))
