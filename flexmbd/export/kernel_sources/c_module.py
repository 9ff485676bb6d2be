"""A module of LLVM IR as a file of C99."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from importlib import resources

from flexmbd.export.kernel_sources import c_instructions
from flexmbd.export.kernel_sources.c_function import FunctionWriter
from flexmbd.export.kernel_sources.c_operations import MATHEMATICS
from flexmbd.export.kernel_sources.ir_module import Module, module_of
from flexmbd.export.kernel_sources.ir_text import LineReader
from flexmbd.export.kernel_sources.ir_types import Scalar, Type, lane_places, lanes_of, no_c, size_of

HEADER = "kernel_words.h"


def header() -> bytes:
    """What all files of kernels include, by the name HEADER."""
    return (resources.files(__package__) / HEADER).read_bytes()


def c_source(program: str, symbol: str, name: str, *, known: Collection[str] = ()) -> str:
    """C99 of a function and of all that it calls, which stays within the file.

    Whole numbers and addresses are unsigned there, ``uint64_t`` and narrower; floating-point numbers are as they are.

    Args:
        program: text of an LLVM module; optimised or not, with vectors or without.
        symbol: the function's name in it.
        name: its name in C.
        known: functions that are called by their names and lie in other files.

    Raises:
        ExportError: an instruction, a type or a called function that has no C here; the message names it.
    """
    return _ModuleWriter(module_of(program), known).write(symbol, name)


@dataclass
class _ModuleWriter:
    """Writes a function and what it needs, each once."""

    module: Module
    known: Collection[str]
    types: dict[str, Type] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    waiting: list[str] = field(default_factory=list)
    prototypes: dict[str, str] = field(default_factory=dict)
    results: dict[str, str] = field(default_factory=dict)
    data: list[str] = field(default_factory=list)

    def write(self, symbol: str, name: str) -> str:
        for one, text in self.module.types.items():
            if text != "opaque":
                self.types[one] = self._reader(text).value_type()
        first = symbol if f"@{symbol}" in self.module.functions else f'"{symbol}"'
        self.names[f"@{first}"] = name
        self.waiting.append(f"@{first}")
        bodies = []
        for one in self.waiting:  # it grows
            bodies.append(self._function(one) if one in self.module.functions else self._data(one))
        parts = [f'#include "{HEADER}"', "#include <stdlib.h>", *self.results.values(), *self.prototypes.values()]
        return "\n".join([*parts, *self.data, *(body for body in bodies if body), ""])

    def _reader(self, text: str) -> LineReader:
        return LineReader(text, self.types, self.address)

    def _function(self, name: str) -> str:
        function = self.module.functions[name]
        if not function.blocks:
            raise no_c(f"the function {name[1:]} is not known")
        writer = FunctionWriter(function, self)
        within = "" if name == self.waiting[0] else "static "
        heads: list[str] = []

        def declare(arguments: str) -> str:
            heads.append(f"{within}{self.result(writer.result_type)} {self.names[name]}({arguments})")
            return heads[0]

        text = writer.write(declare, c_instructions.write)
        self.prototypes[name] = heads[0] + ";"
        return text

    def _data(self, name: str) -> str:
        """A global: its words of eight bytes, of which addresses are some."""
        reader = self._reader(self.module.globals[name])
        while reader.next not in ("global", "constant"):
            if not reader.next:
                raise no_c(f"the global {name[1:]} is not known")
            reader.take()
        reader.take()
        kind = reader.value_type()
        lanes = reader.value(kind) if reader.next not in ("", ",") else [0] * len(lanes_of(kind))
        count = max(1, -(-size_of(kind) // 8))
        memory, addresses = bytearray(8 * count), {}
        for lane, place, value in zip(lanes_of(kind), lane_places(kind), lanes, strict=True):
            if isinstance(value, int):
                memory[place : place + lane.size] = value.to_bytes(lane.size, "little")
            elif place % 8 or lane.size != 8:
                raise no_c(f"the global {name[1:]} holds an address at a place that is not its own")
            else:
                addresses[place] = value
        words = [
            addresses.get(k, f"{int.from_bytes(memory[k : k + 8], 'little')}ull") for k in range(0, len(memory), 8)
        ]
        self.prototypes[name] = f"static uint64_t {self.names[name]}[{count}];"
        return f"static uint64_t {self.names[name]}[{count}] = {{{', '.join(words)}}};\n"

    def _name(self, name: str) -> str:
        if name not in self.names:
            self.names[name] = f"{'f' if name in self.module.functions else 'g'}{len(self.names)}"
            self.waiting.append(name)
        return self.names[name]

    def address(self, name: str) -> str:
        """C's word for the address of a global."""
        return f"(uint64_t)(uintptr_t){'&' if name in self.module.functions else ''}{self._name(name)}"

    def call(self, name: str, result: Type | None, kinds: list[Type], given: list[str]) -> str:
        """A call of a function by its name."""
        function = self.module.functions.get(name)
        bare = name[1:].strip('"')
        if function is not None and not function.blocks:
            if MATHEMATICS.get(bare) == len(given) and all(kind == Scalar("f", 64) for kind in kinds):
                return f"{bare}({', '.join(given)})"
            if bare not in self.known:
                raise no_c(f"the function {bare} is not known")
            words = ", ".join(lane.c for kind in kinds for lane in lanes_of(kind))
            self.prototypes[name] = f"extern {self.result(result)} {bare}({words or 'void'});"
            return f"{bare}({', '.join(given)})"
        return f"{self._name(name)}({', '.join(given)})"

    def result(self, kind: Type | None) -> str:
        """C's type of a function's result."""
        if kind is None or isinstance(kind, Scalar):
            return "void" if kind is None else kind.c
        lanes = lanes_of(kind)
        name = "parts_" + "_".join(lane.c for lane in lanes)
        parts = " ".join(f"{lane.c} e{k};" for k, lane in enumerate(lanes))
        self.results[name] = f"typedef struct {{ {parts} }} {name};"
        return name
