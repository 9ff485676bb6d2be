"""A function of LLVM IR as one of C: each value is as many variables as it has lanes, each block a label."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Protocol

from flexmbd.export.kernel_sources.ir_module import BasicBlock, Function
from flexmbd.export.kernel_sources.ir_text import Lane, LineReader, c_lane
from flexmbd.export.kernel_sources.ir_types import Scalar, Type, lanes_of, no_c

_LOCAL = re.compile(r'%"[^"]*"|%[\w.$-]+')


class Surroundings(Protocol):
    """What a function needs of its module."""

    types: dict[str, Type]

    def address(self, name: str) -> str:
        """C's word for the address of a global."""

    def call(self, name: str, result: Type | None, kinds: list[Type], given: list[str]) -> str:
        """A call of a function by its name."""

    def result(self, kind: Type | None) -> str:
        """C's type of a function's result."""


class FunctionWriter:
    """Writes one function.

    Args:
        function: what is written.
        around: its module.
    """

    def __init__(self, function: Function, around: Surroundings) -> None:
        self.function, self.around = function, around
        self.lines: list[str] = []
        self.variables: dict[str, str] = {}
        self.arrays: list[str] = []
        self._numbers: dict[str, int] = {}
        self._labels = {name: f"L{k}" for k, name in enumerate(function.blocks)}
        self._targets: set[str] = set()
        self.block = ""
        self.used = Counter(_LOCAL.findall("\n".join(line for one in function.blocks.values() for line in _texts(one))))
        self.result_type: Type | None = None

    def write(self, declare: Callable[[str], str], instruction: Callable[[FunctionWriter, str, str], None]) -> str:
        """The text of the function.

        Args:
            declare: makes its head of its arguments.
            instruction: adds the statements of one, by its result's name and its text.
        """
        arguments = self._head()
        for number, (name, block) in enumerate(self.function.blocks.items()):
            self.block = name
            for phi in block.phis:
                self.define(phi.name, self.reader(phi.kind).value_type())
            start = len(self.lines)
            self.lines.append(f"{self._labels[name]}:;")
            for result, text in block.lines:
                instruction(self, result, text)
            if number == 0 and self._labels[name] not in self._targets:
                del self.lines[start]
        lines = [one for one in self.lines if not re.fullmatch(r"L\d+:;", one) or one[:-2] in self._targets]
        body = "\n".join(lines)
        seen = Counter(re.findall(r"\bv\d+(?:_\d+)?\b", body))
        assigned = Counter(re.findall(r"^(v\d+(?:_\d+)?) = ", body, re.MULTILINE))
        kinds: dict[str, list[str]] = {}
        for name, kind in self.variables.items():
            if seen[name]:
                kinds.setdefault(kind, []).append(name)
        head = [
            f"{kind} {', '.join(names[k : k + 16])};" for kind, names in kinds.items() for k in range(0, len(names), 16)
        ]
        names = [name for _, name in arguments]
        idle = [f"(void){name};" for name in names if not seen[name]]
        idle += [f"(void){name};" for name in self.variables if seen[name] and seen[name] == assigned[name]]
        texts = ", ".join(f"{kind} {name}" for kind, name in arguments) or "void"
        return "\n".join([declare(texts) + " {", *head, *self.arrays, *idle, body, "}", ""])

    def _head(self) -> list[tuple[str, str]]:
        """C's types and names of the arguments; notes the result's type."""
        self.result_type, kinds, names = signature(self.reader(self.function.head))
        arguments = []
        for k, (kind, name) in enumerate(zip(kinds, names, strict=True)):
            lanes = self.define(name or f"%{k}", kind)
            for lane, variable in zip(lanes_of(kind), lanes, strict=True):
                arguments.append((lane.c, variable))
                del self.variables[variable]
        return arguments

    def reader(self, text: str) -> LineReader:
        """A reader of a line within this function."""
        return LineReader(text, self.around.types, self.around.address, self._value)

    def names(self, name: str, count: int) -> list[str]:
        """What C calls the lanes of a value."""
        number = self._numbers.setdefault(name, len(self._numbers))
        return [f"v{number}"] if count == 1 else [f"v{number}_{k}" for k in range(count)]

    def _value(self, name: str, count: int) -> list[Lane]:
        return list(self.names(name, count))

    def define(self, name: str, kind: Type) -> list[str]:
        """Variables of a result."""
        lanes = lanes_of(kind)
        found = self.names(name, len(lanes))
        self.variables.update(zip(found, (lane.c for lane in lanes), strict=True))
        return found

    def assign(self, name: str, kind: Type, values: list[str]) -> None:
        """A result's lanes take these values, none of which is one of them."""
        for variable, value in zip(self.define(name, kind), values, strict=True):
            self.lines.append(f"{variable} = {value};")

    def jump(self, target: str) -> str:
        """From this block to another one: values that depend on it are set all at once."""
        block = self.function.blocks[target]
        pairs: list[tuple[str, Scalar, str]] = []
        for phi in block.phis:
            kind = self.reader(phi.kind).value_type()
            if self.block not in phi.values:
                raise no_c(f"the value {phi.name} has none from {self.block}")
            values = self.reader(phi.values[self.block]).value(kind)
            lanes = lanes_of(kind)
            names = self.names(phi.name, len(lanes))
            for name, lane, value in zip(names, lanes, values, strict=True):
                if value != name:
                    pairs.append((name, lane, c_lane(lane, value)))
        self._targets.add(self._labels[target])
        set_here = {name for name, _, _ in pairs}
        before, after = [], []
        for k, (name, lane, value) in enumerate(pairs):
            if value in set_here:
                before.append(f"{lane.c} t{k} = {value};")
                value = f"t{k}"
            after.append(f"{name} = {value};")
        copies = "\n".join([*before, *after, f"goto {self._labels[target]};"])
        return f"{{\n{copies}\n}}" if before else copies


def _texts(block: BasicBlock) -> list[str]:
    return [text for _, text in block.lines] + [one for phi in block.phis for one in phi.values.values()]


def signature(reader: LineReader) -> tuple[Type | None, list[Type], list[str]]:
    """Result, arguments' types and names of a function's head."""
    reader.leave_attributes()
    result = reader.type()
    while reader.next and not reader.next.startswith("@"):
        reader.take()
    reader.take()
    reader.expect("(")
    kinds, names = [], []
    while not reader.skip(")"):
        if reader.next == "...":
            raise no_c("functions of any number of arguments are not known")
        kinds.append(reader.value_type())
        reader.leave_attributes()
        names.append(reader.take() if reader.next.startswith("%") else "")
        reader.skip(",")
    return result, kinds, names
