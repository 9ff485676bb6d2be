"""The imports of the package's files, those under TYPE_CHECKING, inside functions and by text included; their circles.

    ./run python tools/import_graph.py            # the circles of files, and the rooms that import each other
    ./run python tools/import_graph.py --texts    # the imports by text

An import is an arrow to the file that it names: `from flexmbd.run import event` to `flexmbd.run.event`,
`from flexmbd.errors import InputError` to `flexmbd.errors`. The `__init__`s that python runs on the way are not
counted. An import by text is a text that is a module's name, wherever it stands, for it may reach `import_module` by a
table or an argument; or one put together, as `f"flexmbd.command.{name}"`: it names the modules that fit, and where
texts of the same file fill its gaps, only these. Exit code 1 where there is a circle.
"""

import argparse
import ast
import os
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "flexmbd"

Graph = dict[str, set[str]]

_GAP = r"(\w+)"  # in a text that is put together: one part of a module's name


def files(root: Path = ROOT) -> dict[str, Path]:
    """The package's modules by name; `forms` and `meshes` are found through their links."""
    found = {}
    for folder, folders, names in os.walk(root / PACKAGE, followlinks=True):
        folders[:] = sorted(set(folders) - {"__pycache__"})
        for name in sorted(names):
            path = Path(folder, name)
            if path.suffix == ".py":
                parts = path.relative_to(root).with_suffix("").parts
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(root: Path = ROOT, *, types: bool = True) -> Graph:
    """Which modules of the package each of its modules imports.

    Args:
        root: The checkout.
        types: Whether imports under `if TYPE_CHECKING:` count.
    """
    modules = files(root)
    return {name: _imported(name, path, modules, types=types) - {name} for name, path in modules.items()}


def _imported(name: str, path: Path, modules: Mapping[str, Path], *, types: bool) -> set[str]:
    found: set[str] = set()
    found |= _by_text(name, path, modules)
    waiting: list[ast.AST] = [ast.parse(path.read_text())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) and not types:
            waiting += node.orelse
            continue
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            base = _base(name, node, package=path.name == "__init__.py")
            for alias in node.names:
                found.update([one for one in (f"{base}.{alias.name}", base) if one in modules][:1])
    return found


def imports_by_text(root: Path = ROOT) -> Graph:
    """Which modules of the package each of its modules names in a text."""
    modules = files(root)
    return {name: _by_text(name, path, modules) - {name} for name, path in modules.items()}


def _by_text(name: str, path: Path, modules: Mapping[str, Path]) -> set[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    known = {"__name__": name, "__package__": package}
    nodes = list(ast.walk(ast.parse(path.read_text())))
    texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    found = {text for text in texts if "." in text and text in modules}
    found |= {one for node in nodes if isinstance(node, ast.Call) and (one := _relative(node, package)) in modules}
    for node in nodes:
        if not isinstance(node, ast.JoinedStr | ast.BinOp):
            continue
        pattern = _pattern(node, known)
        if pattern is None or not pattern.startswith(re.escape(f"{PACKAGE}.")):
            continue
        fits = {module: fit.groups() for module in modules if (fit := re.fullmatch(pattern, module))}
        told = {module for module, gaps in fits.items() if set(gaps) <= set(texts)}
        found |= told or set(fits)
    return found


def _relative(node: ast.Call, package: str) -> str:
    """What `import_module(".film", __package__)` names; "" of other calls."""
    first = node.args[0].value if node.args and isinstance(node.args[0], ast.Constant) else None
    if not (ast.unparse(node.func).endswith("import_module") and isinstance(first, str) and first.startswith(".")):
        return ""
    last, parts = first.lstrip("."), package.split(".")
    return ".".join([*parts[: len(parts) + 1 - (len(first) - len(last))], last])


def _pattern(node: ast.expr, known: Mapping[str, str]) -> str | None:
    """A text that is put together as a regular expression, its gaps as groups; None for what is no text."""
    if isinstance(node, ast.Constant):
        return re.escape(node.value) if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(_pattern(part, known) or _GAP for part in node.values)
    if isinstance(node, ast.BinOp):
        sides = _pattern(node.left, known), _pattern(node.right, known)
        return None if not isinstance(node.op, ast.Add) else "".join(side or _GAP for side in sides)
    inside = ast.unparse(node.value if isinstance(node, ast.FormattedValue) else node)
    return re.escape(known[inside]) if inside in known else _GAP


def _base(name: str, node: ast.ImportFrom, *, package: bool) -> str:
    if node.level == 0:
        return node.module or ""
    parts = name.split(".")
    above = parts[: len(parts) - node.level + package]
    return ".".join([*above, node.module] if node.module else above)


def room(name: str, depth: int) -> str:
    """The first `depth` parts of a module's name below the package: its room; the package's own name for the root."""
    return ".".join(name.split(".")[1 : depth + 1]) or PACKAGE


def between_rooms(graph: Graph, depth: int = 1) -> Graph:
    """The arrows between rooms, that is between folders or loose files at most `depth` below the package."""
    rooms: Graph = {}
    for name, targets in graph.items():
        here = rooms.setdefault(room(name, depth), set())
        here.update({room(target, depth) for target in targets} - {room(name, depth)})
    return rooms


def circles(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """The strongly connected components of two members and more, the largest first (Tarjan 1972)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(one: str) -> None:
        number[one] = low[one] = len(number)
        stack.append(one)
        for other in sorted(graph[one]):
            if other not in number:
                visit(other)
            if other in stack:
                low[one] = min(low[one], low[other])
        if low[one] == number[one]:
            at = stack.index(one)
            if len(stack) - at > 1:
                found.append(sorted(stack[at:]))
            del stack[at:]

    for one in sorted(graph):
        if one not in number:
            visit(one)
    return sorted(found, key=lambda members: (-len(members), members))


def main() -> int:
    """Prints the circles of files, and at each depth the circles of rooms; 1 where there is one of files."""
    parser = argparse.ArgumentParser(description="Circles among the imports of the package's files.")
    parser.add_argument("--run-time", action="store_true", help="leave out the imports under TYPE_CHECKING")
    parser.add_argument("--texts", action="store_true", help="print the imports by text")
    chosen = parser.parse_args()
    if chosen.texts:
        for name, targets in imports_by_text().items():
            print("\n".join(f"{name} -> {target}" for target in sorted(targets)), end="\n" * bool(targets))
        return 0
    graph = imports(types=not chosen.run_time)
    found = circles(graph)
    for circle in found:
        print(f"a circle of {len(circle)} files:")
        for one in circle:
            print(f"    {one} -> {', '.join(sorted(graph[one] & set(circle)))}")
    for depth in (1, 2):
        for circle in circles(between_rooms(graph, depth)):
            print(f"a circle of {len(circle)} rooms: {', '.join(circle)}")
    print(f"{len(graph)} files, {sum(map(len, graph.values()))} imports, {len(found)} circles of files")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
