"""Pictures of the rooms and of what they import: docs/pictures/rooms*.svg.

    ./run python tools/draw_rooms.py            # draws them anew
    ./run python tools/draw_rooms.py --check    # says which are not of today's imports; exit code 1

A room stands above all that it imports, and every arrow points down; an arrow that a way through other rooms implies
is left out. Dashed: rooms that are to come.
"""

import argparse
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from import_graph import PACKAGE, ROOT, Graph, circles, imports

PICTURES = ROOT / "docs" / "pictures"

_WIDE, _HIGH, _GAP, _FALL = 148, 40, 22, 52  # of boxes, and between them
_BEND = 8  # of an arrow that passes between boxes
_DASH = ' stroke-dasharray="5 4"'


@dataclass(frozen=True)
class Picture:
    """What a picture shows.

    Attributes:
        file: its name.
        inside: the room whose rooms are shown; the package.
        together: modules and rooms that share a box, by its name.
        notes: a second line of a box.
        planned: rooms to come, and the rooms that they will import.
    """

    file: str
    inside: str
    together: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    planned: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


SHOWN = (
    Picture(
        "rooms.svg",
        PACKAGE,
        {
            "command": ("cli", "__main__"),
            "scene_file": ("toml_file",),
            "machine": ("joint", "force", "output", "parameter"),
            "leaves": ("errors", "given", "given_values", "rotation", "coupling"),
        },
        {
            "continuum": "mesh + form: K, M",
            "reduction": "Craig-Bampton",
            "record": "gate 1 of the wall",
            "multibody": "gate 2: interiors",
            "ensemble": "any executor",
            "integrate": "one controller",
            "leaves": "errors, rotation, ...",
            "forms": "UFL alone",
            "meshes": "gmsh",
        },
        {
            "controllers": ("machine",),
            "shapes, contact": ("multibody",),
            "moving beams": ("multibody", "beams"),
        },
    ),
    Picture("rooms_multibody.svg", f"{PACKAGE}.multibody"),
    Picture("rooms_continuum.svg", f"{PACKAGE}.continuum", {"compat, parallel": ("compat", "parallel")}),
)


def rooms(graph: Graph, picture: Picture) -> Graph:
    """The boxes of a picture and the boxes that each imports."""
    box = {module: name for name, modules in picture.together.items() for module in modules}
    inside = picture.inside + "."

    def of(module: str) -> str:
        first = module.removeprefix(inside).split(".")[0]
        return box.get(first, first)

    found: Graph = {}
    for module, targets in graph.items():
        if module.startswith(inside):
            here = found.setdefault(of(module), set())
            here.update({of(target) for target in targets if target.startswith(inside)} - {of(module)})
    return found


def levels(graph: Graph) -> dict[str, int]:
    """How high each box stands: one above the highest that it imports."""
    known: dict[str, int] = {}

    def height(name: str) -> int:
        if name not in known:
            known[name] = 1 + max((height(other) for other in graph[name]), default=-1)
        return known[name]

    for name in graph:
        height(name)
    return known


def plain_arrows(graph: Graph) -> list[tuple[str, str]]:
    """The arrows that no way through other boxes implies."""
    below: Graph = {}
    for name in sorted(graph, key=levels(graph).__getitem__):
        below[name] = set().union(*(below[other] | {other} for other in graph[name]))
    return [
        (name, other)
        for name in sorted(graph)
        for other in sorted(graph[name])
        if not any(other in below[third] for third in graph[name])
    ]


def draw(graph: Graph, picture: Picture) -> str:
    """The picture as SVG."""
    whole = {**graph, **{name: set(under) for name, under in picture.planned.items()}}
    height = levels(whole)
    ways = [_way(arrow, height) for arrow in plain_arrows(whole)]
    rows = [sorted(name for name in whole if height[name] == k) for k in range(max(height.values()) + 1)]
    for way in ways:
        for k, bend in enumerate(way[1:-1], start=1):
            rows[height[way[0]] - k].append(bend)
    _untangle(rows, [pair for way in ways for pair in pairwise(way)])
    widths = {name: _WIDE if name in whole else _BEND for row in rows for name in row}
    width = max(sum(widths[name] + _GAP for name in row) for row in rows) + _GAP
    tall = len(rows) * (_HIGH + _FALL) + _GAP
    place = {}
    for k, row in enumerate(rows):
        x = (width - sum(widths[name] + _GAP for name in row) + _GAP) / 2
        for name in row:
            place[name] = (x + widths[name] / 2, tall - _GAP - k * (_HIGH + _FALL) - _HIGH)
            x += widths[name] + _GAP
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {tall}" width="{width}" height="{tall}"'
        ' font-family="sans-serif" font-size="14" text-anchor="middle">',
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" fill="#555"/></marker></defs>',
        f'<rect width="{width}" height="{tall}" fill="white"/>',
    ]
    for way in ways:
        (x, y), (u, v) = place[way[0]], place[way[-1]]
        bends = "".join(f" L{place[b][0]:g} {place[b][1]:g} V{place[b][1] + _HIGH:g}" for b in way[1:-1])
        line = f"M{x:g} {y + _HIGH:g}{bends} L{u:g} {v:g}"
        dash = _DASH if way[0] in picture.planned else ""
        lines.append(f'<path d="{line}" stroke="#555" fill="none" marker-end="url(#head)"{dash}/>')
    for name in whole:
        lines += _box(name, *place[name], note=picture.notes.get(name, ""), planned=name in picture.planned)
    return "\n".join([*lines, "</svg>", ""])


def _way(arrow: tuple[str, str], height: Mapping[str, int]) -> list[str]:
    """An arrow's ends, and between them a bend on each level that it passes."""
    name, other = arrow
    passed = range(height[name] - 1, height[other], -1)
    return [name, *(f"{name} > {other} at {k}" for k in passed), other]


def _box(name: str, x: float, y: float, *, note: str, planned: bool) -> list[str]:
    dash, fill = (_DASH, "white") if planned else ("", "#eef3f8")
    lines = [
        f'<rect x="{x - _WIDE / 2:g}" y="{y:g}" width="{_WIDE}" height="{_HIGH}" rx="5" fill="{fill}"'
        f' stroke="#345"{dash}/><text x="{x:g}" y="{y + (17 if note else 25):g}">{name}</text>'
    ]
    if note:
        lines.append(f'<text x="{x:g}" y="{y + 33:g}" font-size="11" fill="#555">{note}</text>')
    return lines


def _untangle(rows: list[list[str]], joined: Iterable[tuple[str, str]]) -> None:
    """Order each row by the mean place of what it is joined to in the row before, up and down by turns."""
    pairs = list(joined)
    above = {name: [one for one, other in pairs if other == name] for row in rows for name in row}
    below = {name: [other for one, other in pairs if one == name] for row in rows for name in row}
    for turn in range(24):
        order, near = (rows, below) if turn % 2 else (rows[::-1], above)
        place: dict[str, float] = {}
        for row in order:
            mean = {name: sum(place[o] for o in near[name]) / max(1, len(near[name])) for name in row}
            free = {name: (row.index(name) + 0.5) / len(row) for name in row if not near[name]}
            row.sort(key=lambda name, at={**mean, **free}: (at[name], name))  # type: ignore[misc]
            place.update({name: (k + 0.5) / len(row) for k, name in enumerate(row)})


def main() -> int:
    """Draws, or checks; 1 where a picture is out of date or rooms import each other."""
    parser = argparse.ArgumentParser(description="Pictures of the rooms and of what they import.")
    parser.add_argument("--check", action="store_true", help="only say which pictures are out of date")
    check = parser.parse_args().check
    graph, late = imports(), 0
    for picture in SHOWN:
        shown = rooms(graph, picture)
        for circle in circles(shown):
            print(f"{picture.file}: {', '.join(circle)} import each other")
            return 1
        path, text = PICTURES / picture.file, draw(shown, picture)
        if not check:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            print(f"{path.relative_to(ROOT)} is not of today's imports: ./run python tools/draw_rooms.py")
            late = 1
    return late


if __name__ == "__main__":
    sys.exit(main())
