"""A machine's kernels in its unit: linked as object code, or written as C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

from flexmbd.export.functional_mockup.kernel_code import OBJECT_SYMBOLS, SOURCE_SYMBOLS, SYMBOLS, MemoryImage
from flexmbd.export.functional_mockup.unit_build import Target, compile_library
from flexmbd.export.kernel_sources.c_module import HEADER, c_source, header
from flexmbd.multibody.kernels.base.object_code import KernelProgram, object_code

_EXPORTS = b"{ global: fmi2*; fmi3*; local: *; };\n"

#: What kernels call by its name, in machine.c and deferred.c.
CALLED = ("numba_attempt_nocopy_reshape", "flexmbd_bind_deferred")

_IMAGE = """#if defined(_WIN32)
#define READ_ONLY ".section .rdata,\\"dr\\"\\n"
#else
#define READ_ONLY ".section .rodata\\n"
#endif
__asm__(READ_ONLY ".balign 64\\n.globl machine_image\\nmachine_image: .incbin \\"image.bin\\"\\n.text\\n");
typedef int image_only; /* C wants a declaration */
"""


def linked(files: Mapping[str, bytes], kernels: Sequence[KernelProgram], memory: MemoryImage, target: Target) -> bytes:
    """The C files and the kernels as a shared library."""
    objects = {f"kernel{k}.o": object_code(kernel, target.triple) for k, kernel in enumerate(kernels)}
    exported = {"exports.map": _EXPORTS} if target.map_exports else {}
    image = {"image.c": _IMAGE.encode(), "image.bin": memory.image, SYMBOLS: OBJECT_SYMBOLS}
    options = [f"-Wl,--version-script={name}" for name in exported]
    return compile_library({**files, **image, **objects, **exported}, target, link=(*objects, *options))


def kernel_sources(kernels: Sequence[KernelProgram], names: Mapping[str, str], memory: MemoryImage) -> dict[str, bytes]:
    """C99 of the kernels and of the memory's image."""
    found = {f"{names[one.symbol]}.c": _source(one, names[one.symbol]) for one in kernels}
    rows = [", ".join(map(str, memory.image[k : k + 32])) for k in range(0, len(memory.image), 32)]
    image = '#include "machine.h"\n\nconst unsigned char machine_image[] = {\n' + ",\n".join(rows or ["0"]) + "};\n"
    return {**found, HEADER: header(), SYMBOLS: SOURCE_SYMBOLS, "image.c": image.encode()}


@cache
def _source(kernel: KernelProgram, name: str) -> bytes:
    return c_source(kernel.program, kernel.symbol, name, known=CALLED).encode()
