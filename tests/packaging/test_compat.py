"""Differences between the versions of DOLFINx live in compat.py alone, and unknown versions are refused."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexmbd.continuum.compat import check_version
from flexmbd.errors import VersionError

REPOSITORY = Path(__file__).resolve().parents[2]
COMPAT = REPOSITORY / "flexmbd" / "continuum" / "compat.py"
# Runs in an environment of its own, with the DOLFINx that the other program asks for.
PEER = REPOSITORY / "benchmarks" / "external_operator_peer.py"
FILES = [
    file
    for folder in ("flexmbd", "forms", "meshes", "tests", "demos", "benchmarks")
    for file in sorted((REPOSITORY / folder).rglob("*.py"))
    if file not in (COMPAT, PEER, Path(__file__).resolve())
]

LIBRARIES = {"basix", "dolfinx", "ffcx", "petsc4py", "slepc4py", "ufl"}

# What 0.9, 0.10 and 0.11 do not have alike, or not without a warning, and what serves instead.
DIFFERENT = {
    "cmap": "compat.geometry_degree",
    "cmaps": "compat.geometry_degree",
    "geometry.dofmap": "compat.cell_nodes",
    "dofmaps": "compat.cell_nodes",
    "collapse": "compat.collapse",
    "interpolation_points": "compat.interpolation_points",
    "topological_dimension": "compat.topological_dimension",
    "create_petsc_vector": "a PETSc.Vec",
    "gmshio": "meshes.read",
    "LinearProblem": "a PETSc.KSP",
    "NewtonSolver": "a PETSc.SNES",
    "NonlinearProblem": "a PETSc.SNES",
}


def test_compat_alone_tells_versions_apart() -> None:
    assert COMPAT.is_file()
    faults = {str(file.relative_to(REPOSITORY)): list(version_dependence(file.read_text())) for file in FILES}
    assert {file: found for file, found in faults.items() if found} == {}


@pytest.mark.parametrize(
    ("source", "line"),
    [
        ("d = mesh.geometry.cmap.degree", 1),
        ("x = geometry.x[mesh.geometry.dofmap]", 1),
        ("own, dofs = space.sub(0).collapse()", 1),
        ("d = domain.topological_dimension()", 1),
        ("p = space.element.interpolation_points()", 1),
        ("from dolfinx.io import gmshio", 1),
        ("from dolfinx.fem.petsc import NonlinearProblem as Problem", 1),
        ("import dolfinx.io.gmshio", 1),
        ("import dolfinx\nold = dolfinx.__version__ < '0.10'", 2),
        ("from dolfinx import __version__", 1),
        ("from dolfinx import io\nnew = hasattr(io, 'gmsh')", 2),
        ("import dolfinx\nf = getattr(dolfinx.fem.petsc, 'assign', None)", 2),
        ("try:\n    from dolfinx.io import gmsh\nexcept ImportError:\n    gmsh = None", 2),
    ],
)
def test_what_tells_versions_apart_is_seen(source: str, line: int) -> None:
    assert [found.partition(":")[0] for found in version_dependence(source)] == [f"line {line}"]


def test_what_does_not_is_let_pass() -> None:
    assert not list(
        version_dependence(
            "import flexmbd\nfrom flexmbd.continuum import compat\nfrom dolfinx import fem\n"
            "p = compat.interpolation_points(space), fem.functionspace(mesh, e).dofmap.list, flexmbd.__version__\n"
            "q = hasattr(form, 'motion'), version('numpy')\n"
        )
    )


def version_dependence(source: str) -> Iterator[str]:
    """Where a source asks which version there is, or uses what not all versions have."""
    tree = ast.parse(source)
    attempts = [node for node in ast.walk(tree) if isinstance(node, ast.Try)]
    attempted = {part for attempt in attempts for line in attempt.body for part in ast.walk(line)}
    bound = set(LIBRARIES)  # names that mean a library or a part of one
    for node in ast.walk(tree):
        asked = [parts for parts in imports(node) if parts[0] in LIBRARIES]
        if isinstance(node, ast.ImportFrom) and asked:
            bound |= {alias.asname or alias.name for alias in node.names}
        line = getattr(node, "lineno", 0)
        if asked and node in attempted:
            yield f"line {line}: tries what {asked[0][0]} has; let compat do so"
        if isinstance(node, ast.Attribute):
            parts = dotted(node)
            if parts[-2:-1] != ["compat"]:
                asked.append([parts[0], ".".join(parts[-2:]), parts[-1]])
        if isinstance(node, ast.Call) and dotted(node.func)[-1] in ("hasattr", "getattr"):
            if dotted(node.args[0])[0] in bound:
                yield f"line {line}: asks what {dotted(node.args[0])[0]} has; let compat do so"
        for parts in asked:
            if parts[0] in bound and parts[-1] == "__version__":
                yield f"line {line}: asks which {parts[0]} there is; let compat do so"
            for part in parts:
                if part in DIFFERENT:
                    yield f"line {line}: {part} is not the same in all versions; use {DIFFERENT[part]}"


def imports(node: ast.AST) -> list[list[str]]:
    """What an import statement asks for: the parts of each name."""
    if isinstance(node, ast.Import):
        return [alias.name.split(".") for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module and not node.level:
        return [[*node.module.split("."), alias.name] for alias in node.names]
    return []


def dotted(node: ast.AST) -> list[str]:
    """The parts of `a.b.c`; an empty one stands for an `a` that is no name."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute):
        parts.insert(0, node.attr)
        node = node.value
    return [node.id if isinstance(node, ast.Name) else "", *parts]


@pytest.mark.parametrize("version", ["0.9.0", "0.9.0.post1", "0.10.0", "0.11.0.post0", "0.11.2"])
def test_known_versions(version: str) -> None:
    check_version(version)


@pytest.mark.parametrize("version", ["0.8.0", "0.12.0.dev0", "0.12.0", "1.0.0", "2026.1"])
def test_unknown_versions_are_refused(version: str) -> None:
    with pytest.raises(VersionError, match=rf"0\.9 to 0\.11, and this is {version}: .*\./run"):
        check_version(version)


def test_a_form_that_another_process_compiles_is_waited_for():
    """DOLFINx's own ten seconds are fewer than an involved form takes."""
    from dolfinx import jit

    assert jit.get_options()["timeout"] >= 300
