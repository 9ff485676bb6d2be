"""Compiled kernels outside Python: their optimised programs, and object code for any processor of a kind.

Numba keeps the optimised program of each kernel. From it comes object code that uses no instructions beyond the
architecture's first, without what steps in from Python; what is left asks for C's mathematical functions alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from numba import typeof


@dataclass(frozen=True)
class Kernel:
    """A kernel for the types of its arguments.

    Attributes:
        symbol: its name in the object code.
        program: text of the LLVM module that holds it.
        triple: the platform.
    """

    symbol: str
    program: str
    triple: str


def kernel_for(function: Any, arguments: tuple[Any, ...]) -> Kernel:
    """The kernel compiled, or loaded from the cache, for arguments of these types."""
    kinds = tuple(typeof(argument) for argument in arguments)
    function.compile(kinds)
    compiled = function.overloads[kinds]
    module = compiled.library._get_module_for_linking()
    return Kernel(compiled.fndesc.llvm_func_name, _without_python(str(module)), module.triple)


def _without_python(program: str) -> str:
    """A module's text without the functions by which Python calls into it."""
    lines, leaving_out = [], False
    for line in program.splitlines():
        if line.startswith("define") and "@_ZN7cpython" in line:
            leaving_out = True
        if not leaving_out:
            lines.append(line)
        if line == "}":
            leaving_out = False
    return "\n".join(lines)


@cache
def object_code(kernel: Kernel) -> bytes:
    """Object code, to be placed anywhere, for every processor of the platform's architecture."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(kernel.program)
    for one in module.functions:
        if not one.is_declaration and one.name != kernel.symbol:
            one.linkage = "internal"
    oldest = "x86-64" if kernel.triple.startswith("x86_64") else "generic"
    target = llvm.Target.from_triple(kernel.triple)
    machine = target.create_target_machine(cpu=oldest, features="", opt=2, reloc="pic", codemodel="default")
    code: bytes = machine.emit_object(module)
    return code
