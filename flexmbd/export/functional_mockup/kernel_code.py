"""Arguments of compiled kernels laid out in one block of memory, and calls of the kernels from C.

Kernels are called in one way, whether they are machine code or C: whole numbers and addresses are unsigned numbers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct, words
from flexmbd.multibody.kernels.base.object_code import KernelProgram

_ALIGNED = 64


@dataclass(frozen=True)
class MemoryImage:
    """Arrays laid out in one block; arrays that share memory share it there.

    Attributes:
        places: address of each array's first byte to its offset in the block.
        image: what the block holds.
    """

    places: dict[int, int]
    image: bytes

    def place(self, array: np.ndarray, index: int = 0) -> int:
        """Offset (bytes) of an entry of a flattened array; 0 for arrays without entries."""
        return self.places[array.ctypes.data] + index * array.itemsize if array.size else 0


def lay_out(arguments: Iterable[Any]) -> MemoryImage:
    """One block for all arrays among arguments, which are arrays, numbers, structures of them and tuples of these.

    Pieces of memory follow in the order in which the arguments name them: the same arguments give the same block.
    """
    arrays = [one for one in arrays_in(arguments) if one.size]
    pieces: list[list[int]] = []
    for start, size in sorted({(one.ctypes.data, one.nbytes) for one in arrays}):
        if pieces and start < pieces[-1][1]:
            pieces[-1][1] = max(pieces[-1][1], start + size)
        else:
            pieces.append([start, start + size])
    starts = np.array([start for start, _ in pieces], np.int64)
    bases: dict[int, int] = {}
    places: dict[int, int] = {}
    image = bytearray()
    for one in arrays:
        start, end = pieces[int(np.searchsorted(starts, one.ctypes.data, side="right")) - 1]
        if start not in bases:
            image.extend(bytes(-len(image) % _ALIGNED))
            bases[start] = len(image)
            image.extend(ctypes.string_at(start, end - start))
        places[one.ctypes.data] = bases[start] + one.ctypes.data - start
    return MemoryImage(places, bytes(image))


def arrays_in(arguments: Iterable[Any]) -> list[np.ndarray]:
    """All arrays among arguments, in their order."""
    found: list[np.ndarray] = []
    for one in arguments:
        if isinstance(one, tuple):
            found += arrays_in(one)
        elif isinstance(one, ArrayStruct):
            found += arrays_in(one.fields().values())
        elif isinstance(one, np.ndarray):
            found.append(one)
    return found


#: What the files of calls include: SYMBOL, by which kernels are found that are linked as object code.
SYMBOLS = "kernel_symbols.h"
OBJECT_SYMBOLS = b"#define SYMBOL(name) __asm__(name)\n"
SOURCE_SYMBOLS = b"#define SYMBOL(name) /* the names are those of the sources */\n"


def c_names(kernels: Iterable[KernelProgram]) -> dict[str, str]:
    """The C name of each kernel, by its symbol: the same in every unit."""
    return {one.symbol: f"kernel_{sha256(one.symbol.encode()).hexdigest()[:16]}" for one in kernels}


def c_call(kernel: str, symbol: str, arguments: Sequence[Any], memory: MemoryImage, *, name: str) -> str:
    """A C function ``static int name(unsigned char *m, void *result)`` that calls the kernel; 0, or what it raised.

    Each array is numba's record of it: no owner, its numbers, where it lies in the block at m, shape and strides; each
    structure is a pointer to its words.
    """
    kinds, values = ["uint64_t", "uint64_t"], ["WORD(result)", "WORD(&raised)"]
    blocks: list[str] = []
    for one in arguments:
        if isinstance(one, ArrayStruct):
            kinds.append("uint64_t")
            values.append(f"WORD({_c_block(one, memory, blocks)})")
        else:
            for kind, value in _c_values(one, memory):
                kinds.append(kind)
                values.append(value)
    return (
        f'extern uint32_t {kernel}({", ".join(kinds)}) SYMBOL("{symbol}");\n\n'
        f"static int {name}(unsigned char *m, void *result) {{\n    void *raised = 0;\n    (void)m;\n{''.join(blocks)}"
        f"    return (int){kernel}({', '.join(values)});\n}}\n\n"
    )


def _c_block(struct: ArrayStruct, memory: MemoryImage, blocks: list[str]) -> str:
    """The name of a structure's words, whose declaration follows those of ``blocks``."""
    found: list[str] = []
    for one in struct.fields().values():
        if isinstance(one, np.ndarray):
            found += [f"WORD(m + {memory.place(one)})", *map(str, one.shape)]
        elif isinstance(one, ArrayStruct):
            found.append(f"WORD({_c_block(one, memory, blocks)})")
        else:
            found += [f"(uint64_t){word}" for word in words(one)]
    name = f"b{len(blocks)}"
    blocks.append(f"    uint64_t {name}[] = {{{', '.join(found)}}};\n")
    return name


def _c_values(one: Any, memory: MemoryImage) -> list[tuple[str, str]]:
    """Types and values of the C arguments that an array or a number is."""
    if isinstance(one, np.ndarray):
        numbers = [("uint64_t", str(number)) for number in (*one.shape, *one.strides)]
        head = [("uint64_t", str(number)) for number in (0, 0, one.size, one.itemsize)]
        return [*head, ("uint64_t", f"WORD(m + {memory.place(one)})"), *numbers]
    return [("double", repr(one))] if isinstance(one, float) else [("uint64_t", f"(uint64_t){int(one)}")]


def bind_deferred(deferred: Mapping[bytes, KernelProgram], names: Mapping[str, str]) -> str:
    """The C function by which kernels find those that they call by address, from what names each."""
    lines = ["#include <stdint.h>", "#include <string.h>", "", f'#include "{SYMBOLS}"', ""]
    lines += ["uint32_t flexmbd_bind_deferred(uint64_t name, uint64_t size, uint64_t slot);", ""]
    cases = []
    for k, (what, kernel) in enumerate(deferred.items()):
        called, numbers = names[kernel.symbol], ", ".join(map(str, what))
        lines += [f'extern void {called}(void) SYMBOL("{kernel.symbol}");']
        lines += [f"static const unsigned char name_{k}[] = {{{numbers}}};"]
        test = f"size == sizeof name_{k} && memcmp((void *)(uintptr_t)name, name_{k}, sizeof name_{k}) == 0"
        cases += [f"    if ({test})", f"        found = (uint64_t)(uintptr_t)&{called};"]
    lines += [
        "",
        "uint32_t flexmbd_bind_deferred(uint64_t name, uint64_t size, uint64_t slot) {",
        "    uint64_t found = 0;",
    ]
    ending = ["    (void)name, (void)size;", "    memcpy((void *)(uintptr_t)slot, &found, sizeof found);"]
    return "\n".join([*lines, *cases, *ending, "    return found ? 0 : 2;", "}", ""])
