"""One meaning a name: no two classes or types of the package share one, nor two files of the machine's rooms."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
#: Every form has Parameters and a Reference of its own, and may have a Quadrature, as the contract of forms names them.
OF_FORMS = {"Parameters", "Reference", "Quadrature"}
#: Files that their room tells apart: steps, matrices, work arrays and Newton iterations of integrators, and interfaces.
BY_THEIR_ROOM = {"__init__.py", "matrix.py", "newton.py", "protocol.py", "step.py", "workspace.py"}


def places_of_classes(folder: str) -> dict[str, list[str]]:
    """Files of each class, classes within classes and functions included."""
    places = defaultdict(list)
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(str(path.relative_to(REPOSITORY)))
    return places


def definitions_of_types(folder: str) -> dict[str, dict[str, list[str]]]:
    """Of each name that a module gives to a type, what it stands for, and in which files."""
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
            if not isinstance(target, ast.Name) or not target.id[0].isupper() or target.id.isupper():
                continue
            assert isinstance(node, ast.Assign | ast.AnnAssign)
            assert node.value is not None
            definition = ast.unparse(node.value).replace("npt.", "")
            found[target.id][definition].append(str(path.relative_to(REPOSITORY)))
    return found


def test_a_name_stands_for_one_type() -> None:
    """Where two modules give a name to a type it is the same type, and no class has that name."""
    types, classes = definitions_of_types("flexmbd"), places_of_classes("flexmbd")
    for folder in ("forms", "meshes"):
        for name, meanings in definitions_of_types(folder).items():
            for definition, files in meanings.items():
                types[name][definition] += files
    assert {name: meanings for name, meanings in types.items() if len(meanings) > 1} == {}
    assert {name: classes[name] for name in types if name in classes} == {}
    assert len(types) > 40


def test_no_two_classes_have_one_name() -> None:
    own = places_of_classes("flexmbd")
    assert {name: files for name, files in own.items() if len(files) > 1} == {}
    assert len(own) > 400


def test_forms_share_names_of_their_contract_alone() -> None:
    own, forms = places_of_classes("flexmbd"), places_of_classes("forms")
    shared = {name: files for name, files in forms.items() if len(files + own.get(name, [])) > 1}
    assert set(shared) <= OF_FORMS, shared


def test_files_of_the_machine_differ_in_name() -> None:
    """Within multibody and integrate, where one file imports from many rooms."""
    places = defaultdict(list)
    for room in ("multibody", "integrate"):
        for path in sorted((REPOSITORY / "flexmbd" / room).rglob("*.py")):
            places[path.name].append(str(path.relative_to(REPOSITORY)))
    assert {name: files for name, files in places.items() if len(files) > 1 and name not in BY_THEIR_ROOM} == {}
