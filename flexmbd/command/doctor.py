"""`flexmbd doctor`: what is installed, in which version, and what to do about what is broken.

Libraries of the continuum side are loaded in a process of their own: one that crashes there is reported, not followed.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.metadata
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from flexmbd.command.launch import launched_ranks, usable_cores
from flexmbd.command.terminal import add_json, print_json, print_line
from flexmbd.files.form_compiler import form_compiler, lacking_for_forms
from flexmbd.multibody.kernels.base.kernel_store import cache_folder

_BROKEN = 1
_PATIENCE = 120.0  # s, for libraries that load from a slow disk
_EXAMPLES = """\
examples:
  flexmbd doctor
  flexmbd doctor --json | jq -r '.findings[] | select(.state == "broken") | .remedy'

exit code 1: something that is needed is broken; its line says what to do
"""

#: Libraries by what needs them.
_MACHINE = ("numpy", "scipy", "numba", "h5py")
_CONTINUUM = ("mpi4py.MPI", "petsc4py.PETSc", "slepc4py.SLEPc", "dolfinx", "basix", "ufl", "gmsh")
_OURS = "flexmbd.continuum"
_PICTURES = ("matplotlib", "pyvista", "vtk", "imageio", "imageio-ffmpeg", "tqdm")
_CLIENTS = ("exudyn", "fmpy", "pyNastran", "openfast_io")
_PROGRAMS = ("mbdyn", "ccx", "octave-cli", "mpirun")

_BLAS = ("openblas", "mkl_rt", "blis", "libblas")

_PROBE = """
import importlib, json, sys
found = {}
for name in sys.argv[1:]:
    try:
        module = importlib.import_module(name)
        version = getattr(module, "__version__", "")
        if name == "mpi4py.MPI":
            version = module.Get_library_version().split("\\n")[0].rstrip("\\x00").split(",")[0]
        elif name.endswith(("PETSc", "SLEPc")):
            version = ".".join(map(str, module.Sys.getVersion()))
            if name.endswith("PETSc") and module.ScalarType().dtype.kind == "c":
                raise RuntimeError("PETSc is built with complex numbers; flexmbd wants real ones")
        found[name] = [True, str(version)]
    except BaseException as error:
        found[name] = [False, f"{type(error).__name__}: {error}".splitlines()[0]]
    print(json.dumps(found), flush=True)
import os
os._exit(0)
"""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        part: of flexmbd that it concerns: "machine", "continuum", "pictures", "clients", "speed".
        name: of the thing.
        state: "ok", "missing" (only what it serves is not to be had) or "broken" (the exit code is 1).
        detail: version, place, or what is wrong.
        remedy: what to do; empty where nothing is.
    """

    part: str
    name: str
    state: str
    detail: str
    remedy: str = ""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Say what flexmbd finds on this machine, and what to do about what is broken."
    parser.epilog = _EXAMPLES
    add_json(parser)
    parser.set_defaults(run=doctor)


def doctor(arguments: argparse.Namespace) -> int:
    """Look, report; 1 where something needed is broken. Loads nothing of the continuum side here; not collective."""
    findings = [*_machine(), *_speed(), *_continuum()]
    findings += [*_listed("pictures", _PICTURES, "pip install 'flexmbd[pictures]'")]
    findings += [*_listed("clients", _CLIENTS, ""), *_programs(), _compiler()]
    broken = [one for one in findings if one.state == "broken"]
    if arguments.json:
        print_json({"healthy": not broken, "findings": [asdict(one) for one in findings]})
    else:
        print_line(_sheet(findings))
        print_line(f"\n{len(broken)} broken" if broken else "\nnothing that is needed is broken")
    return _BROKEN if broken else 0


def _sheet(findings: list[Finding]) -> str:
    lines: list[str] = []
    part = ""
    for one in findings:
        if one.part != part:
            part = one.part
            lines += ["", part] if lines else [part]
        mark = {"ok": "  ", "missing": "- ", "broken": "! "}[one.state]
        lines.append(f"{mark}{one.name:<18}{one.detail}")
        if one.remedy:
            lines.append(f"  {'':<18}{one.remedy}")
    return "\n".join(lines)


def _machine() -> list[Finding]:
    findings = [
        Finding("machine", "flexmbd", "ok", f"{_version('flexmbd') or 'not installed'}, {Path(__file__).parents[1]}"),
        Finding("machine", "python", "ok", f"{platform.python_version()}, {sys.executable}"),
    ]
    for name in _MACHINE:
        fine, text = _load(name)
        remedy = "" if fine else f"pip install --upgrade {name}"
        findings.append(Finding("machine", name, "ok" if fine else "broken", text, remedy))
    return [*findings, _numba_cache()]


def _numba_cache() -> Finding:
    """Where compiled kernels are kept: without a place each process compiles them anew."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        remedy = "set NUMBA_CACHE_DIR to a folder that may be written to, or each process compiles for half a minute"
        return Finding("machine", "kernel cache", "broken", f"{folder}: {error.strerror}", remedy)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return Finding("machine", "kernel cache", "ok", f"{folder}, {size / 1e6:.0f} MB")


def _speed() -> list[Finding]:
    """What the linear algebra runs on."""
    findings = [Finding("speed", "cores", "ok", f"{usable_cores()} of {os.cpu_count()}")]
    threads = os.environ.get("OMP_NUM_THREADS", "")
    findings.append(Finding("speed", "BLAS of numpy", "ok", _loaded_blas()))
    limit = f"OMP_NUM_THREADS={threads}" if threads else "not limited"
    remedy = "under mpirun set OMP_NUM_THREADS=1, or the ranks' threads get in each other's way"
    ranks = launched_ranks()
    crowded = ranks > 1 and threads != "1"
    findings.append(Finding("speed", "threads of BLAS", "ok", limit, remedy if crowded else ""))
    findings.append(Finding("speed", "MPI ranks", "ok", str(ranks)))
    return findings


def _loaded_blas() -> str:
    """The library that numpy has loaded, which numpy itself knows only by the name it was built with."""
    np.ones((2, 2)) @ np.ones((2, 2))
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:  # no Linux
        return "unknown"
    paths = sorted({line.split(maxsplit=5)[-1] for line in lines if "/" in line})
    found = [path for path in paths if any(word in Path(path).name for word in _BLAS)]
    return ", ".join(found) or "unknown"


def _continuum() -> list[Finding]:
    """DOLFINx and what goes with it: all missing is a choice, some missing or of a wrong version is a fault."""
    probed = _probe([*_CONTINUUM, _OURS])
    missing = [name for name in _CONTINUUM if probed[name][1].startswith("ModuleNotFoundError")]
    remedy = "see docs/install.md: pip install 'flexmbd[fem]', ./run, Debian's python3-dolfinx or conda-forge's"
    if "dolfinx" in missing:
        detail = "not installed; flexmbd check and reduce need it, nothing else does"
        return [Finding("continuum", "dolfinx", "missing", detail, remedy)]
    findings = []
    for name in _CONTINUUM:
        fine, text = probed[name]
        findings.append(
            Finding("continuum", name.partition(".")[0], "ok" if fine else "broken", text, "" if fine else remedy)
        )
    fine, text = probed[_OURS]
    if not fine and all(one.state == "ok" for one in findings):
        findings.append(Finding("continuum", _OURS, "broken", text, remedy))
    return findings


def _listed(part: str, names: tuple[str, ...], remedy: str) -> list[Finding]:
    """Packages by their versions, which are not loaded."""
    versions = {name: _version(name) for name in names}
    return [
        Finding(part, name, "ok" if version else "missing", version or "not installed", "" if version else remedy)
        for name, version in versions.items()
    ]


def _programs() -> list[Finding]:
    return [
        Finding("clients", name, "ok" if place else "missing", place or "not on the PATH")
        for name, place in ((name, shutil.which(name)) for name in _PROGRAMS)
    ]


def _compiler() -> Finding:
    """The C compiler, for forms and, where it is gcc, for FMUs."""
    compiler, lacking = form_compiler(), lacking_for_forms()
    if not compiler:
        return Finding("clients", "C compiler", "missing", "not on the PATH", "for FMUs and new forms: apt install gcc")
    return Finding("clients", "C compiler", "ok", shutil.which(compiler) or compiler, lacking)


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _load(name: str) -> tuple[bool, str]:
    """Whether a module loads here, and its version or what is wrong."""
    try:
        return True, str(importlib.import_module(name).__version__)
    except ImportError as error:
        return False, f"{type(error).__name__}: {error}".splitlines()[0]


def _probe(names: list[str]) -> dict[str, tuple[bool, str]]:
    """Whether each module loads in a process of its own, and its version or what is wrong."""
    # a process that mpirun has not started must not believe that it did
    prefixes = ("OMPI_COMM", "OMPI_UNIVERSE", "OMPI_FILE", "PMIX_", "PMI_", "PRTE_LAUNCHED")
    outside = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(prefixes) or key.startswith("PMIX_MCA")
    }
    fault = "no answer"
    out = ""
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE, *names], capture_output=True, text=True, env=outside, timeout=_PATIENCE
        )
        out = done.stdout
        if done.returncode:
            fault = f"loading it ended the process with code {done.returncode}"
    except subprocess.TimeoutExpired as late:
        out = late.stdout.decode() if isinstance(late.stdout, bytes) else ""
        fault = f"loading it took more than {_PATIENCE:.0f} s"
    found: dict[str, tuple[bool, str]] = dict.fromkeys(names, (False, fault))
    lines = [line for line in out.splitlines() if line.startswith("{")]
    if lines:
        found.update({name: (bool(fine), str(text)) for name, (fine, text) in json.loads(lines[-1]).items()})
    return found
