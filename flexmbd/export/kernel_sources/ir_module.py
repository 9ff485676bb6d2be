"""A module of LLVM IR in its parts: named types, globals, functions with their blocks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Phi:
    """A value that depends on where the block is entered from.

    Attributes:
        name: of the value.
        kind: text of its type.
        values: from the name of each block before to the text of the value.
    """

    name: str
    kind: str
    values: dict[str, str]


@dataclass
class BasicBlock:
    """Instructions that follow each other, each with the name of its result or "" for none."""

    phis: list[Phi] = field(default_factory=list)
    lines: list[tuple[str, str]] = field(default_factory=list)


@dataclass(frozen=True)
class Function:
    """A function.

    Attributes:
        head: its result and arguments, from the word after ``define`` or ``declare`` on.
        blocks: by name, the one where it begins first; none of those declared.
    """

    head: str
    blocks: dict[str, BasicBlock]


@dataclass(frozen=True)
class Module:
    """Named types, globals and functions, by names that begin with % or @."""

    types: dict[str, str]
    globals: dict[str, str]
    functions: dict[str, Function]


_GLOBAL = re.compile(r'(@"[^"]*"|@[\w.$-]+) = (.*)')
_TYPE = re.compile(r'(%"[^"]*"|%[\w.$-]+) = type (.*)')
_NAME = re.compile(r'@"[^"]*"|@[\w.$-]+')
_LABEL = re.compile(r'("[^"]*"|[\w.$-]+):')
_RESULT = re.compile(r'\s*(?:(%"[^"]*"|%[\w.$-]+) = )?(.*)')
_PHI = re.compile(r"phi (?:(?:reassoc|contract|fast|nnan|ninf|nsz|arcp|afn) )*(.*?) (\[ .*)")
_CHOICE = re.compile(r'\[ (.*?), (%"[^"]*"|%[\w.$-]+) \]')
_METADATA = re.compile(r", ![\w.]+.*| #\d+$")


def module_of(text: str) -> Module:
    """The parts of a module that LLVM has printed."""
    module = Module({}, {}, {})
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith("define"):
            function = Function(line[len("define") :], {})
            module.functions[_name_of(line)] = function
            _fill(function, lines)
        elif line.startswith("declare"):
            module.functions[_name_of(line)] = Function(line[len("declare") :], {})
        elif found := _GLOBAL.match(line):
            module.globals[found[1]] = found[2]
        elif found := _TYPE.match(line):
            module.types[found[1]] = found[2]
    return module


def _name_of(line: str) -> str:
    found = _NAME.search(line)
    return found[0] if found else ""


def _fill(function: Function, lines: Iterator[str]) -> None:
    """Take the blocks from the lines up to the bracket that ends them."""
    block: BasicBlock | None = None
    for line in lines:
        if line == "}":
            return
        if not line.strip() or line.lstrip().startswith((";", "#dbg")):
            continue
        if not line.startswith(" ") and (label := _LABEL.match(line)):
            block = function.blocks["%" + label[1]] = BasicBlock()
            continue
        if block is None:  # without a name it has the number after those of the arguments without one
            block = function.blocks[f"%{_unnamed(function.head)}"] = BasicBlock()
        while line.rstrip().endswith("["):  # a switch has its cases on lines of their own
            for case in lines:
                line += case
                if case.strip().startswith("]"):
                    break
            line = line.rstrip() + ";"
        name, text = _RESULT.findall(line)[0]
        text = _METADATA.sub("", text)
        if phi := _PHI.match(text):
            block.phis.append(Phi(name, phi[1], {one[2]: one[1] for one in _CHOICE.finditer(phi[2])}))
        else:
            block.lines.append((name, text))


def _unnamed(head: str) -> int:
    return len(re.findall(r"%\d+", head))
