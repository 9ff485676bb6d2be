"""The names that a user may rely on: few rooms, all that README, documents and demos need, and every type in them."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from fresh_python import ran_afresh

import flexmbd as fm

REPOSITORY = Path(__file__).parents[2]
ROOMS = (
    "beams", "contact", "continuum", "ensemble", "export", "force", "forms", "integrate", "joint", "meshes", "output",
    "parameter", "reduction", "visual",
)  # fmt: skip
PUBLIC = ("flexmbd", *(f"flexmbd.{room}" for room in ROOMS))
#: Pages about the inside of flexmbd, for those who work on it.
INSIDE = {"architecture.md", "machine.md"}


def sources() -> Iterator[tuple[str, str]]:
    """What users read and copy: (place, code)."""
    for page in (REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))):
        if page.name not in INSIDE:
            for i, block in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)):
                yield f"{page.name}-{i}", block
    for demo in sorted((REPOSITORY / "demos").rglob("*.py")):
        yield str(demo.relative_to(REPOSITORY)), demo.read_text()


SOURCES = dict(sources())


def test_a_room_is_imported_in_either_way() -> None:
    """As `import flexmbd.joint` and `from flexmbd import joint`, each by itself, and as an attribute."""
    statement = (
        "import flexmbd as fm; a = fm.{0}; import flexmbd.{0}; from flexmbd import {0} as b; "
        "assert a is b is flexmbd.{0}, (a, b)"
    )
    ran = zip(ROOMS, ran_afresh([statement.format(room) for room in ROOMS]), strict=True)
    assert {room: one.error for room, one in ran if one.error} == {}


def test_the_root_shows_no_other_module() -> None:
    shown = {name for name in dir(fm) if isinstance(getattr(fm, name), ModuleType)}
    assert shown == set(ROOMS)
    assert all(hasattr(fm, name) for name in dir(fm))


@pytest.mark.parametrize("room", PUBLIC)
def test_all_names_of_a_room_bring_no_file_of_it(room: str) -> None:
    """A file's name, as `modes`, would hide a user's own; forms are files themselves."""
    brought: dict[str, Any] = {}
    exec(f"from {room} import *", brought)
    del brought["__builtins__"]
    files = {name for name, value in brought.items() if isinstance(value, ModuleType)}
    assert files == (set(shown(room)) if room == "flexmbd.forms" else set())
    assert set(brought) == set(shown(room)) - (set(ROOMS) if room == "flexmbd" else set())


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Sytem'"):
        fm.Sytem  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("place", SOURCES)
def test_what_users_copy_imports_public_names(place: str) -> None:
    tree = ast.parse(SOURCES[place])
    private = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "flexmbd":
            module = str(node.module)
            if module.startswith("flexmbd.forms"):  # a form's own names: its Parameters, its laws
                module = "flexmbd.forms"
                continue
            names = {alias.name for alias in node.names}
            if module not in PUBLIC:
                private.append(f"{module}: {names}")
            else:
                private += [f"{module}.{name}" for name in names - set(shown(module))]
        elif isinstance(node, ast.Import):
            private += [a.name for a in node.names if a.name.split(".")[0] == "flexmbd" and a.name not in PUBLIC]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "fm":
            private += [f"fm.{node.attr}"] if node.attr not in dir(fm) else []
    assert private == []


@cache
def shown(module: str) -> dict[str, Any]:
    """The public names of a room: those that it imports or makes, but for modules; of the forms and the root all."""
    room = importlib.import_module(module)
    names = dir(room)
    if module in ("flexmbd", "flexmbd.forms"):
        return {name: getattr(room, name) for name in names if name[0] != "_"}
    return {
        name: getattr(room, name)
        for name in names
        if name[0] != "_" and not isinstance(getattr(room, name), ModuleType)
    }


# ---------------------------------------------------------------------------------------------- types in annotations

#: What the machine asks of joints, forces, integrators and its plan: called by it, on types of its inside.
ASKED_BY_THE_MACHINE = {"rows", "steps", "assemble", "stepper", "check", "rule", "force_elements", "tableau"}
#: Types that users pass on and do not look into, or that belong to the compiled machine.
OPAQUE = {
    "RowChoice", "Signature", "Snapshot", "HistorySnapshot", "Strain", "LinearEquations", "InteriorSnapshot",
    "EventMemory", "InteriorRecord", "Field", "WrenchSource", "Slots", "Machine", "Samples", "ResultsFile",
    "PlacedInterior", "Bearing", "UserBody", "ElementKind", "SteppedScene", "SteppedMemory",
    "ClosedPosition",
}  # fmt: skip
COMPILED = ("flexmbd.multibody.plan.", "flexmbd.multibody.kernels.")


def functions(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """A function, or a class and its public methods, with the place of each."""
    if inspect.isfunction(value):
        yield name, value
    elif isinstance(value, type) and not value.__module__.startswith(COMPILED):
        yield name, value
        for base in value.__mro__:
            for key, member in vars(base).items():
                if base.__module__.startswith("flexmbd") and (key[0] != "_" or key in ("__init__", "__call__")):
                    member = getattr(member, "fget", None) or getattr(member, "__func__", member)
                    member = getattr(member, "func", member)
                    if inspect.isfunction(member) and key not in ASKED_BY_THE_MACHINE:
                        yield f"{name}.{key}", member


def flexmbd_types(annotation: Any, module: ModuleType) -> Iterator[tuple[str, Any]]:
    """The classes of flexmbd, and its unions of such, that an annotation names."""
    if not isinstance(annotation, str):
        annotation = annotation.__name__ if isinstance(annotation, type) else str(annotation)
    for node in ast.walk(ast.parse(annotation, mode="eval")):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            yield from flexmbd_types(node.value, module)
        if isinstance(node, ast.Name):
            value = imported(node.id, module)
            parts = getattr(value, "__args__", ())
            own = [part for part in (value, *parts) if isinstance(part, type) and is_own(part)]
            if own:
                yield node.id, value


def is_own(value: type) -> bool:
    return value.__module__.split(".")[0] == "flexmbd"


def imported(name: str, module: ModuleType) -> Any:
    """What a name means in a module, those imported for type checkers alone included."""
    if hasattr(module, name):
        return getattr(module, name)
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom) and name in {alias.asname or alias.name for alias in node.names}:
            return getattr(importlib.import_module(str(node.module)), name, None)
    return None


@pytest.mark.parametrize("room", PUBLIC)
def test_types_in_annotations_are_public(room: str) -> None:
    """Whoever wants to write the type of an argument or a result can import it."""
    everywhere = [value for name in PUBLIC for value in shown(name).values()]
    missing: dict[str, str] = {}
    for name, value in shown(room).items():
        for place, thing in functions(value, name):
            if not thing.__module__.startswith("flexmbd"):
                continue
            for key, annotation in getattr(thing, "__annotations__", {}).items():
                if key[0] == "_":
                    continue
                for what, found in flexmbd_types(annotation, sys.modules[thing.__module__]):
                    hidden = what in OPAQUE or getattr(found, "__module__", "").startswith(COMPILED)
                    if not hidden and not any(found is one for one in everywhere):
                        missing[what] = f"{place}({key})"
    assert missing == {}


def test_types_of_a_checkout_are_found(tmp_path: Path) -> None:
    """A type checker that runs elsewhere finds the package and its marker: a system is none of type Any."""
    script = tmp_path / "scene.py"
    lines = "import flexmbd as fm", "reveal_type(fm.System())", "reveal_type(fm.joint.Revolute('z'))", "fm.Sytem()"
    script.write_text("\n".join(lines))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--follow-imports=silent", "--no-error-summary", script.name],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    said = re.sub(r"scene\.py:", "", done.stdout).splitlines()
    assert [line for line in said if "System" in line or "Revolute" in line or "Sytem" in line][:3] == [
        '2: note: Revealed type is "flexmbd.machine.system.System"',
        '3: note: Revealed type is "flexmbd.multibody.joint.revolute.Revolute"',
        '4: error: Module has no attribute "Sytem"; maybe "System"?  [attr-defined]',
    ]
