"""A machine on which ./run sets up trees and environments within a second: what it downloads is replaced by stubs.

The script itself, its locks, stamps, renames and removals are the real ones. The stubs write what they were called for
to a file `calls`, and fail or wait where a test lays a file `NAME.fails` or `NAME.waits` beside them.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[2]

# Half of a tree, perhaps trouble, and the rest; to the standard output as an archive if asked to.
MMDEBSTRAP = """
suite=${@: -3:1} target=${@: -2:1}
note mmdebstrap "$suite"
[[ $target != - ]] || { archive=$target; target=$(mktemp -d); }
mkdir -p "$target/usr"
trouble mmdebstrap
mkdir -p "$target"/{etc,var/lib/dpkg}
[[ -z ${archive:-} ]] || tar --create --directory "$target" .
"""

# Enters no tree, but runs the command, with the python below where it names that of a tree.
BWRAP = """
while [[ $1 != --chdir ]]; do shift; done
cd "$2" || exit
for word in "${@:3}"; do
    [[ $word != /usr/bin/python3 ]] || word=$here/python3
    command+=("$word")
done
exec "${command[@]}"
"""

PYTHON = """
case "$1 ${2-}" in
"-m venv")
    note venv
    echo "$*" >>"$here/venv.arguments"
    mkdir -p "${@: -1}/bin"
    ln -s "$here/python3" "${@: -1}/bin/python"
    ;;
"-m pip")
    note pip
    echo "$*" >>"$here/pip.arguments"
    trouble pip
    touch "${0%/*}"/{pytest,mypy,ruff}
    chmod +x "${0%/*}"/{pytest,mypy,ruff}
    ;;
"-m flexmbd")
    note "$3"
    trouble "$3"
    ;;
*) PYTHONPATH=$here/site exec PYTHON_OF_THE_TESTS -S "$@" ;;
esac
"""

HEAD = """#!/usr/bin/env bash
here=HERE
note() { printf '%s\\n' "$*" >>"$here/calls"; }
trouble() {
    [[ ! -e $here/$1.waits ]] || { touch "$here/$1.waiting"; sleep "$(cat "$here/$1.waits")"; }
    [[ ! -e $here/$1.fails ]] || { echo "E: no network for $1" >&2; exit 1; }
}
"""


class Machine:
    """A checkout, a cache and stubs in a folder."""

    def __init__(self, folder: Path) -> None:
        self.stubs, self.cache, checkout = folder / "stubs", folder / "cache", folder / "checkout"
        checkout.mkdir()
        for name in ("run", "pyproject.toml"):
            shutil.copy(REPOSITORY / name, checkout)
        self.script = checkout / "run"
        self.project = checkout / "pyproject.toml"
        site = self.stubs / "site"
        for package in ("mpi4py", "petsc4py", "slepc4py"):
            (site / package).mkdir(parents=True)
            (site / package / "__init__.py").touch()
        (site / "mpi4py" / "MPI.py").touch()
        (site / "slepc4py" / "SLEPc.py").touch()
        (site / "petsc4py" / "PETSc.py").write_text("import numpy\nScalarType = numpy.float64\n")
        (site / "numpy.py").write_text("class float64: pass\n")
        (site / "gmsh.py").touch()
        self.install_dolfinx("0.11.0.post0")
        for name, text in {"mmdebstrap": MMDEBSTRAP, "bwrap": BWRAP, "python3": PYTHON}.items():
            text = HEAD.replace("HERE", str(self.stubs)) + text.replace("PYTHON_OF_THE_TESTS", sys.executable)
            (self.stubs / name).write_text(text)
        for name in ("apt-config", "apt-get", "mount", "newuidmap"):  # they are there, and do nothing
            (self.stubs / name).write_text(HEAD.replace("HERE", str(self.stubs)))
        for stub in self.stubs.iterdir():
            stub.chmod(0o755)
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("FLEXMBD_")},
            "PATH": f"{self.stubs}:{os.environ['PATH']}",
            "FLEXMBD_CACHE": str(self.cache),
            "FLEXMBD_WAY": "tree",
            "FLEXMBD_ENTER": "bwrap",
        }

    def install_dolfinx(self, version: str) -> None:
        """What the trees' python imports from now on."""
        (self.stubs / "site" / "dolfinx.py").write_text(f"__version__ = {version!r}\n")

    def start(self, *command: str, suite: str = "trixie", **options: Any) -> subprocess.Popen[str]:
        environment = {**self.environment, "FLEXMBD_SUITE": suite}
        words = [str(self.script), *(command or ("true",))]
        return subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True, **options)

    def run(self, *command: str, suite: str = "trixie") -> tuple[int, str]:
        """The exit code and what it said."""
        process = self.start(*command, suite=suite)
        _, said = process.communicate(timeout=60)
        return process.returncode, said

    def calls(self) -> list[str]:
        """What the stubs were called for since this was last asked."""
        file = self.stubs / "calls"
        lines = file.read_text().splitlines() if file.exists() else []
        file.unlink(missing_ok=True)
        return lines

    def arguments(self, stub: str) -> list[str]:
        """What python was given at each call of a stub of its modules, a line each."""
        return (self.stubs / f"{stub}.arguments").read_text().splitlines()

    def waiting(self, stub: str) -> bool:
        """Whether a stub that was told to wait has come so far."""
        return (self.stubs / f"{stub}.waiting").exists()

    def trees(self) -> list[str]:
        """The suites of the trees there are, with a question mark those that are not complete."""
        names = [tree.name for tree in self.cache.glob("tree/*/")]
        return sorted(name.partition("-")[0] + "?" * (".tmp." in name) for name in names)
