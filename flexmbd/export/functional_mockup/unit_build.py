"""The parts of a unit put together: C compiled, and a zip archive that is the same for the same content."""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.model_description import Fmi

#: The program, in ways that do not depend on the processor that compiles: no fused multiplication and addition.
COMPILE = ("gcc", "-std=c99", "-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-Wall", "-Wextra")
LINK = ("-shared", "-Wl,--build-id=none", "-Wl,--no-undefined", "-s")

_LAYER = {Fmi.V2: ("fmi2.c", "fmi2.h"), Fmi.V3: ("fmi3.c", "fmi3.h")}


def source(name: str) -> bytes:
    """A C file of this package."""
    return (resources.files(__package__) / name).read_bytes()


def layer_sources(fmi: Fmi) -> dict[str, bytes]:
    """Name and content of the files between a model and a version of FMI."""
    return {name: source(name) for name in (*_LAYER[fmi], "instance.c", "instance.h", "model.h")}


def binary_folder(fmi: Fmi) -> str:
    """Where a unit keeps the library for this machine.

    Raises:
        ExportError: this version has no name for it.
    """
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if platform.system() != "Linux" or (fmi is Fmi.V2 and machine != "x86_64"):
        raise ExportError(
            f"a binary of FMI {fmi.value} is compiled on Linux{' x86_64' if fmi is Fmi.V2 else ''} alone, this is "
            f"{platform.system()} {machine}; write the sources alone, binary=False, and compile them there"
        )
    return "binaries/linux64" if fmi is Fmi.V2 else f"binaries/{machine}-linux"


def compile_library(files: Mapping[str, bytes], *, link: Sequence[str] = ()) -> bytes:
    """Compile and link C files to a shared library.

    Args:
        files: all sources, headers and ready object files by name; those that end with ".c" are compiled.
        link: names of object files among them and further options of the linker.

    Raises:
        ExportError: there is no gcc, or it fails.
    """
    if shutil.which(COMPILE[0]) is None:
        raise ExportError(
            "an FMU's binary is compiled by gcc, which is not on the PATH: install it (apt install gcc libc6-dev), or "
            "write the sources alone with binary=False"
        )
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        sources = sorted(name for name in files if name.endswith(".c"))
        command = [*COMPILE, *sources, *link, *LINK, "-o", "library.so", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines()
            raise ExportError("gcc cannot compile the FMU's binary: " + "; ".join(lines[:3]))
        return (Path(folder) / "library.so").read_bytes()


def build_description(identifier: str, sources: Sequence[str]) -> bytes:
    """The file sources/buildDescription.xml of FMI 3, with the names of the C files."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    group = SubElement(configuration, "SourceFileSet", language="C99")
    for name in sources:
        SubElement(group, "SourceFile", name=name)
    SubElement(configuration, "Library", name="m", external="true", description="C's mathematical functions")
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def zipped(members: Mapping[str, bytes]) -> bytes:
    """An archive without dates, so that the same members give the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            entry = zipfile.ZipInfo(name)  # of 1980, the first date of an archive
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if name.endswith(".so") else 0o100644) << 16
            archive.writestr(entry, content)
    return buffer.getvalue()


def c_array(declaration: str, values: Iterable[float]) -> str:
    """A C array of doubles with all their digits; C has no empty ones, so there is always one number."""
    numbers = [repr(float(value)) for value in values] or ["0.0"]
    lines = [", ".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
    return f"const double {declaration}[] = {{\n    " + ",\n    ".join(lines) + "};\n"
