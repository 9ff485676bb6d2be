"""Arguments of compiled kernels laid out in one block of memory, and calls of the kernels from C."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct, words
from flexmbd.multibody.kernels.base.object_code import Kernel

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


def c_call(kernel: Kernel, arguments: Sequence[Any], memory: MemoryImage, *, name: str) -> str:
    """A C function ``static int name(unsigned char *m, void *result)`` that calls the kernel; 0, or what it raised.

    Each array is numba's record of it: no owner, its numbers, where it lies in the block at m, shape and strides; each
    structure is a pointer to its words.
    """
    kinds, values = ["void *", "void **"], ["result", "&raised"]
    blocks: list[str] = []
    for one in arguments:
        if isinstance(one, ArrayStruct):
            kinds.append("int64_t *")
            values.append(_c_block(one, memory, blocks))
        else:
            for kind, value in _c_values(one, memory):
                kinds.append(kind)
                values.append(value)
    return (
        f'extern int32_t {name}_kernel({", ".join(kinds)}) __asm__("{kernel.symbol}");\n\n'
        f"static int {name}(unsigned char *m, void *result) {{\n    void *raised = 0;\n{''.join(blocks)}"
        f"    return {name}_kernel({', '.join(values)});\n}}\n\n"
    )


def _c_block(struct: ArrayStruct, memory: MemoryImage, blocks: list[str]) -> str:
    """The name of a structure's words, whose declaration follows those of ``blocks``."""
    found: list[str] = []
    for one in struct.fields().values():
        if isinstance(one, np.ndarray):
            found += [f"(int64_t)(m + {memory.place(one)})", *map(str, one.shape)]
        elif isinstance(one, ArrayStruct):
            found.append(f"(int64_t){_c_block(one, memory, blocks)}")
        else:
            found += map(str, words(one))
    name = f"b{len(blocks)}"
    blocks.append(f"    int64_t {name}[] = {{{', '.join(found)}}};\n")
    return name


def _c_values(one: Any, memory: MemoryImage) -> list[tuple[str, str]]:
    """Types and values of the C arguments that an array or a number is."""
    if isinstance(one, np.ndarray):
        numbers = [("int64_t", str(number)) for number in (*one.shape, *one.strides)]
        head = [("int64_t", str(number)) for number in (one.size, one.itemsize)]
        return [("void *", "0"), ("void *", "0"), *head, ("void *", f"m + {memory.place(one)}"), *numbers]
    return [("double", repr(one))] if isinstance(one, float) else [("int64_t", str(int(one)))]


def bind_deferred(deferred: Mapping[bytes, Kernel]) -> str:
    """The C function by which kernels find those that they call by address, from what names each."""
    lines = ["#include <stdint.h>", "#include <string.h>", ""]
    cases = []
    for k, (what, kernel) in enumerate(deferred.items()):
        numbers = ", ".join(map(str, what))
        lines += [f'extern void kernel_{k}(void) __asm__("{kernel.symbol}");']
        lines += [f"static const unsigned char name_{k}[] = {{{numbers}}};"]
        test = f"size == sizeof name_{k} && memcmp(name, name_{k}, sizeof name_{k}) == 0"
        cases += [f"    if ({test})", f"        return *slot = (int64_t)&kernel_{k}, 0;"]
    lines += ["", "int32_t flexmbd_bind_deferred(const void *name, int64_t size, int64_t *slot) {"]
    return "\n".join([*lines, *cases, "    return 2;", "}", ""])
