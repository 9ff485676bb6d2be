"""LLVM IR's text: tokens, types and constants."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping

from flexmbd.export.kernel_sources.ir_types import (
    ADDRESS,
    INT32,
    LayoutType,
    Scalar,
    Sequence,
    Type,
    lanes_of,
    no_c,
    part_of,
    size_of,
)

_TOKEN = re.compile(
    r'c"[^"]*"|[%@!]?"[^"]*"|[%@][\w.$-]+|![\w.]*|\#\d+|-?\d+\.\d+(?:e[+-]\d+)?|0x[A-Z]?[0-9A-F]+|-?\d+|[A-Za-z_][\w.]*'
    r"|\.\.\.|[()\[\]{}<>,=*:|]"
)
_ESCAPED = re.compile(rb"\\(\\|[0-9A-Fa-f]{2})")
_FLOATS = {"half": 16, "bfloat": 16, "float": 32, "double": 64, "x86_fp80": 80, "fp128": 128}
_ATTRIBUTE = re.compile(
    r"no\w+|read\w+|write\w+|signext|zeroext|inreg|returned|immarg|dereferenceable\w*|captures|range|align|dead_on_\w+"
    r"|byval|sret|initializes|allocalign|allocptr|swift\w+|fastcc|ccc|coldcc|cc|dso_local|local_unnamed_addr"
    r"|unnamed_addr|internal|private|linkonce_odr|linkonce|weak_odr|weak|external|common|hidden|protected|default"
    r"|dllexport|available_externally"
)

#: A lane of a constant or an operand: a constant's bits, or what C calls a value.
Lane = int | str


class LineReader:
    """Reads one line's tokens from left to right.

    Args:
        text: the line.
        named: named types.
        address: what C calls the address of a global.
        local: what C calls the lanes of a local value, by its name and their number.
    """

    def __init__(
        self,
        text: str,
        named: Mapping[str, Type],
        address: Callable[[str], str],
        local: Callable[[str, int], list[Lane]] | None = None,
    ) -> None:
        self.tokens = _TOKEN.findall(text)
        self.at = 0
        self._named, self._address, self._local = named, address, local

    @property
    def next(self) -> str:
        """The next token; "" at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self) -> str:
        """The next token, left behind."""
        self.at += 1
        return str(self.tokens[self.at - 1]) if self.at <= len(self.tokens) else ""

    def skip(self, *tokens: str) -> bool:
        """Leave the next token behind if it is one of these; whether it was."""
        found = self.next in tokens
        self.at += found
        return found

    def expect(self, token: str) -> None:
        """Leave behind what must be there."""
        if self.take() != token:
            raise no_c(f"{token!r} is missing in {' '.join(self.tokens[:40])!r}")

    def leave_attributes(self) -> None:
        """Go beyond attributes of arguments, results and functions."""
        while _ATTRIBUTE.fullmatch(self.next):
            if self.take() == "align" and self.next != "(":
                self.take()
            if self.next == "(":
                self.leave_brackets()

    def leave_brackets(self) -> None:
        """Go beyond a bracket and all in it."""
        depth = 0
        while True:
            depth += {"(": 1, ")": -1}.get(self.take(), 0)
            if depth == 0 or not self.next:
                return

    def type(self) -> Type | None:
        """A type, None for void."""
        token = self.take()
        found: Type | None = None
        if token == "ptr":
            found = ADDRESS
        elif re.fullmatch(r"i\d+", token):
            found = Scalar("i", int(token[1:]))
        elif token in _FLOATS:
            found = Scalar("f", _FLOATS[token])
        elif token == "[" or (token == "<" and self.next != "{"):
            count = int(self.take())
            self.expect("x")
            found = Sequence(count, self.value_type(), token == "<")
            self.expect("]" if token == "[" else ">")
        elif token in "{<":
            packed = token == "<" and self.skip("{")
            parts = []
            while not self.skip("}"):
                parts.append(self.value_type())
                self.skip(",")
            if packed:
                self.expect(">")
            found = LayoutType(tuple(parts), packed)
        elif token in self._named:
            found = self._named[token]
        elif token != "void":
            raise no_c(f"the type {token!r} is not known")
        while self.skip("*"):  # of LLVM before 17
            found = ADDRESS
        return found

    def value_type(self) -> Type:
        """A type of values."""
        found = self.type()
        if found is None:
            raise no_c("a value of type void")
        return found

    def operand(self) -> tuple[Type, list[Lane]]:
        """A type, attributes and a value of the type."""
        kind = self.value_type()
        self.leave_attributes()
        return kind, self.value(kind)

    def value(self, kind: Type) -> list[Lane]:
        """The lanes of a value of a type."""
        token, lanes = self.take(), lanes_of(kind)
        if token.startswith("%"):
            if self._local is None:
                raise no_c(f"{token} among constants")
            return self._local(token, len(lanes))
        if token in ("zeroinitializer", "undef", "poison", "null", "false", "none"):
            return [0] * len(lanes)  # what is undefined may be anything
        if token == "true":
            return [1]
        if token.startswith("@"):
            return [self._address(token)]
        if token.startswith('c"'):
            data = token[2:-1].encode("latin-1")
            return list(_ESCAPED.sub(lambda one: b"\\" if one[1] == b"\\" else bytes([int(one[1], 16)]), data))
        if token == "splat":
            self.expect("(")
            part = self.operand()[1]
            self.expect(")")
            return part * (len(lanes) // len(part))
        if token in "[{<":
            return self._parts({"[": "]", "{": "}", "<": ">"}[token])
        if re.match(r"-?\d", token) and isinstance(kind, Scalar):
            return [_bits(token, kind)]
        return [self._expression(token)]

    def _parts(self, end: str) -> list[Lane]:
        packed, found = end == ">" and self.skip("{"), []
        while not self.skip("}" if packed else end):
            found += self.operand()[1]
            self.skip(",")
        if packed:
            self.expect(">")
        return found

    def _expression(self, name: str) -> Lane:
        """A constant that is computed of others."""
        if name == "getelementptr":
            self.skip("inbounds", "nuw", "nusw")
            self.expect("(")
            kind = self.value_type()
            self.expect(",")
            base = self.operand()[1][0]
            offset, variable = self.offset(kind)
            if not variable:
                self.expect(")")
                return f"({c_lane(ADDRESS, base)} + {offset}ull)"
        elif name in ("inttoptr", "ptrtoint", "bitcast"):
            self.expect("(")
            lane = self.operand()[1][0]
            self.expect("to")
            self.value_type()
            self.expect(")")
            return lane
        raise no_c(f"the constant {name!r} is not known")

    def offset(self, kind: Type) -> tuple[int, list[tuple[int, Type, list[Lane]]]]:
        """What indices that follow, each after a comma, add to an address.

        Returns:
            Bytes modulo 2^64; and of indices that are known in a run alone what each is times, its type and lanes.
        """
        offset, first = 0, True
        variable: list[tuple[int, Type, list[Lane]]] = []
        while self.skip(","):
            index_kind, lanes = self.operand()
            whole = signed(lanes[0], lanes_of(index_kind)[0]) if len(lanes) == 1 and isinstance(lanes[0], int) else None
            if isinstance(kind, LayoutType) and not first:
                if whole is None:
                    raise no_c("a part of a structure that is known in a run alone")
                _, kind, place = part_of(kind, whole)
                offset += place
            else:
                if not first:
                    if not isinstance(kind, Sequence):
                        raise no_c("a part of a scalar is asked for")
                    kind = kind.of
                if whole is None:
                    variable.append((size_of(kind), index_kind, lanes))
                else:
                    offset += whole * size_of(kind)
            first = False
        return offset % 2**64, variable


def signed(bits: Lane, kind: Scalar) -> int:
    """A constant's value as a number with a sign."""
    if not isinstance(bits, int):
        raise no_c("a number that is known in a run alone")
    return bits - 2**kind.bits if bits >> (kind.bits - 1) else bits


def _bits(token: str, kind: Scalar) -> int:
    if kind.kind != "f":
        return int(token) % 2**kind.bits
    if token.startswith("0x"):  # of doubles, which is how other numbers are written as well
        if not re.fullmatch("0x[0-9A-F]+", token):
            raise no_c(f"the number {token} is not known")
        whole = int(token, 16)
        if kind.bits == 64:
            return whole
        value: float = struct.unpack("<d", struct.pack("<Q", whole))[0]
    else:
        value = float(token)
    packed = struct.pack("<d" if kind.bits == 64 else "<f", value)
    return int.from_bytes(packed, "little")


def c_lane(kind: Scalar, lane: Lane) -> str:
    """A lane as C."""
    if isinstance(lane, str):
        return lane
    if kind.kind != "f":
        return f"{lane}u" if kind.bits <= INT32.bits else f"{lane}ull"
    value: float = struct.unpack("<d" if kind.bits == 64 else "<f", lane.to_bytes(kind.size, "little"))[0]
    if value - value != 0.0:
        return f"f{kind.bits}_of({lane}ull)"
    return ("({}f)" if kind.bits == 32 else "({})").format(value.hex() if value or lane else "0.0")
