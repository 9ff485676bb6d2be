"""The parts of a unit put together: C compiled, and a zip archive that is the same for the same content."""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.model_description import Fmi

#: Options of every compiler: results do not depend on who compiles, as multiplication and addition stay apart.
C99 = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra")


@dataclass(frozen=True, eq=False)
class Target:
    """A kind of computer that a unit's binary is compiled for.

    Attributes:
        folder: FMI 2's and FMI 3's names of it, None where a version has none.
        suffix: of shared libraries there.
        compile: the compiler and its options.
        link: the linker's options.
        packages: of Debian, which hold the compiler.
        triple: LLVM's name of it; "" for the computer at hand.
        map_exports: whether a map tells the linker what the library exports; else the sources say it themselves.
    """

    folder: Mapping[Fmi, str | None]
    suffix: str
    compile: tuple[str, ...]
    link: tuple[str, ...]
    packages: str
    triple: str = ""
    map_exports: bool = False

    @property
    def compiler(self) -> str:
        """The compiler's name."""
        return self.compile[0]

    def member(self, fmi: Fmi, identifier: str) -> str:
        """Where a unit keeps its binary for this target."""
        return f"binaries/{self.folder[fmi]}/{identifier}{self.suffix}"


#: 64-bit Windows, by the cross compiler mingw-w64.
WINDOWS = Target(
    {Fmi.V2: "win64", Fmi.V3: "x86_64-windows"},
    ".dll",
    ("x86_64-w64-mingw32-gcc", *C99),
    ("-shared", "-static-libgcc", "-Wl,--no-insert-timestamp", "-s"),
    "gcc-mingw-w64-x86-64",
    triple="x86_64-w64-windows-gnu",
)

_LAYER = {Fmi.V2: ("fmi2.c", "fmi2.h"), Fmi.V3: ("fmi3.c", "fmi3.h")}


def source(name: str) -> bytes:
    """A C file of this package."""
    return (resources.files(__package__) / name).read_bytes()


def layer_sources(fmi: Fmi) -> dict[str, bytes]:
    """Name and content of the files between a model and a version of FMI."""
    return {name: source(name) for name in (*_LAYER[fmi], "instance.c", "instance.h", "model.h")}


def processor() -> str:
    """FMI's name of this computer's processor, as x86_64."""
    machine = platform.machine().lower()
    return {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)


def this_target(fmi: Fmi, *, otherwise: str = "") -> Target:
    """The computer at hand, by gcc.

    Args:
        fmi: the version of the interface.
        otherwise: what else can be done, for the message.

    Raises:
        ExportError: this version has no name for it.
    """
    machine = processor()
    if platform.system() != "Linux" or (fmi is Fmi.V2 and machine != "x86_64"):
        raise ExportError(
            f"a binary of FMI {fmi.value} is compiled on Linux{' x86_64' if fmi is Fmi.V2 else ''} alone, this is "
            f"{platform.system()} {machine}{otherwise}"
        )
    folder = {Fmi.V2: "linux64", Fmi.V3: f"{machine}-linux"}
    compile_with = ("gcc", *C99, "-fPIC", "-fvisibility=hidden")
    link = ("-shared", "-Wl,--build-id=none", "-Wl,--no-undefined", "-s")
    return Target(folder, ".so", compile_with, link, "gcc libc6-dev", map_exports=True)


def targets_of(fmi: Fmi, *, windows: bool, binary: bool = True, otherwise: str = "") -> tuple[Target, ...]:
    """The targets of the binaries, once each compiler is found.

    Raises:
        ExportError: there is no such binary, or no compiler; the message ends with ``otherwise``.
    """
    targets: tuple[Target, ...] = (this_target(fmi, otherwise=otherwise),) if binary else ()
    targets += (WINDOWS,) if windows else ()
    for one in targets:
        if shutil.which(one.compiler) is None:
            raise ExportError(
                f"an FMU's binary {one.suffix} is compiled by {one.compiler}, which is not on the PATH: install it "
                f"(apt install {one.packages}){otherwise}"
            )
    return targets


def compile_library(files: Mapping[str, bytes], target: Target, *, link: Sequence[str] = ()) -> bytes:
    """Compile and link C files to a shared library.

    Args:
        files: all sources, headers and ready object files by name; those that end with ".c" are compiled.
        target: for what; its compiler is there.
        link: names of object files among them and further options of the linker.

    Raises:
        ExportError: the compiler fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        sources = sorted(name for name in files if name.endswith(".c"))
        command = [*target.compile, *sources, *link, *target.link, "-o", f"library{target.suffix}", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines()
            raise ExportError(f"{target.compiler} cannot compile the FMU's binary: " + "; ".join(lines[:3]))
        return (Path(folder) / f"library{target.suffix}").read_bytes()


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
            entry.external_attr = (0o100755 if name.startswith("binaries/") else 0o100644) << 16
            archive.writestr(entry, content)
    return buffer.getvalue()


def c_array(declaration: str, values: Iterable[float]) -> str:
    """A C array of doubles with all their digits; C has no empty ones, so there is always one number."""
    numbers = [repr(float(value)) for value in values] or ["0.0"]
    lines = [", ".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
    return f"const double {declaration}[] = {{\n    " + ",\n    ".join(lines) + "};\n"
