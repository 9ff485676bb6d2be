"""Compiled kernels outside Python: their optimised programs, and object code for any processor of a kind.

The cache keeps the optimised program of each kernel. From it comes object code that uses no instructions beyond the
architecture's first, without what steps in from Python; what is left asks for C's mathematical functions alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import llvmlite.binding as llvm

from flexmbd.multibody.kernels.base.deferred import compiled_deferred
from flexmbd.multibody.kernels.base.kernel_store import Image


@dataclass(frozen=True)
class KernelProgram:
    """A kernel for the types of its arguments.

    Attributes:
        symbol: its name in the object code.
        program: text of the LLVM module that holds it.
        triple: the platform.
    """

    symbol: str
    program: str
    triple: str


def kernel_for(function: Any, arguments: tuple[Any, ...]) -> KernelProgram:
    """The kernel compiled, or loaded from the cache, for arguments of these types."""
    return _kernel(function.image_for(arguments))


def deferred_kernels(kernels: Iterable[KernelProgram]) -> dict[bytes, KernelProgram]:
    """All deferred kernels that these may call, directly or not, by what ``flexmbd_bind_deferred`` is asked for."""
    found: dict[bytes, KernelProgram] = {}
    waiting = list(kernels)
    while waiting:
        for text in _DEFERRED.findall(waiting.pop().program):
            what = _ESCAPED.sub(_unescaped, text.encode("latin-1"))
            if what not in found:
                found[what] = _kernel(compiled_deferred(what))
                waiting.append(found[what])
    return found


# constants that name deferred kernels in a module's text, and how it writes bytes that are no letters
_DEFERRED = re.compile(r'^@"?flexmbd_deferred\.\w+\.name[.\w]*"? = [^"]*? c"([^"]*)"', re.MULTILINE)
_ESCAPED = re.compile(rb"\\(\\|[0-9A-Fa-f]{2})")


def _unescaped(one: re.Match[bytes]) -> bytes:
    return one[1] if one[1] == b"\\" else bytes([int(one[1], 16)])


def _kernel(image: Image) -> KernelProgram:
    return KernelProgram(image.symbol, _without(image.entry, str(llvm.parse_bitcode(image.program))), image.triple)


def _without(entry: str, program: str) -> str:
    """A module's text without the function by which Python calls into it."""
    lines, leaving_out = [], False
    for line in program.splitlines():
        if line.startswith("define") and f"@{entry}(" in line.replace('"', ""):
            leaving_out = True
        if not leaving_out:
            lines.append(line)
        if line == "}":
            leaving_out = False
    return "\n".join(lines)


@cache
def object_code(kernel: KernelProgram, triple: str = "") -> bytes:
    """Object code, to be placed anywhere, for every processor of the platform's architecture.

    Args:
        kernel: a compiled one.
        triple: another system's, of the same architecture, whose calling convention and file format are taken.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(kernel.program)
    for one in module.functions:
        if not one.is_declaration:  # weak definitions, as numba has them, are not seen from elsewhere on Windows
            one.linkage = "external" if one.name == kernel.symbol else "internal"
    oldest = "x86-64" if kernel.triple.startswith("x86_64") else "generic"
    target = llvm.Target.from_triple(triple or kernel.triple)
    machine = target.create_target_machine(cpu=oldest, features="", opt=2, reloc="pic", codemodel="default")
    if triple:
        module.triple, module.data_layout = triple, str(machine.target_data)
    code: bytes = machine.emit_object(module)
    return code
