"""Calls in LLVM IR as statements of C: of functions, of addresses, and of what LLVM knows itself."""

from __future__ import annotations

import re

from flexmbd.export.kernel_sources.c_function import FunctionWriter
from flexmbd.export.kernel_sources.c_lanes import load, store, texts
from flexmbd.export.kernel_sources.c_operations import binary, intrinsic, overflowing
from flexmbd.export.kernel_sources.ir_text import LineReader
from flexmbd.export.kernel_sources.ir_types import Scalar, Type, lane_places, lanes_of, no_c

_WITHOUT_EFFECT = re.compile(r"lifetime\.|assume$|dbg\.|experimental\.noalias|donothing|prefetch|invariant\.")
_KINDS = re.compile(r"(\.(v\d+)?(f\d+|i\d+|p\d+))+$")
_REDUCED = {"add": "add", "mul": "mul", "and": "and", "or": "or", "xor": "xor", "fmul": "fmul"}
_EXTREME = {"smax": "smax", "smin": "smin", "umax": "umax", "umin": "umin", "fmax": "maxnum", "fmin": "minnum"}

Operands = list[tuple[Type, list[str]]]


def write(here: FunctionWriter, result: str, reader: LineReader) -> None:
    """Add the statements of a call; the reader stands behind the word ``call``."""
    reader.leave_attributes()
    kind = reader.type()
    if reader.next == "(":
        reader.leave_brackets()
    callee = reader.take()
    reader.expect("(")
    if callee.startswith("@llvm.") and _WITHOUT_EFFECT.match(callee[6:]):
        return
    given: Operands = []
    while not reader.skip(")"):
        one, lanes = reader.operand()
        given.append((one, texts(one, lanes)))
        reader.skip(",")
    if callee.startswith("@llvm."):
        _built_in(here, result, kind, _KINDS.sub("", callee[6:]), given)
        return
    if not callee.startswith(("@", "%")):
        raise no_c(f"a call of {callee!r}")
    flat = [text for _, lanes in given for text in lanes]
    kinds = [one for one, _ in given]
    if callee.startswith("@"):
        text = here.around.call(callee, kind, kinds, flat)
    else:
        words = ", ".join(lane.c for one in kinds for lane in lanes_of(one)) or "void"
        (address,) = here.names(callee, 1)
        text = f"(({here.around.result(kind)} (*)({words}))(uintptr_t){address})({', '.join(flat)})"
    if kind is None or not here.used[result]:
        here.lines.append(f"{text};" if kind is None else f"(void){text};")
    elif isinstance(kind, Scalar):
        here.assign(result, kind, [text])
    else:
        names = here.define(result, kind)
        parts = "\n".join(f"{name} = found.e{k};" for k, name in enumerate(names))
        here.lines.append(f"{{\n{here.around.result(kind)} found = {text};\n{parts}\n}}")


def _built_in(here: FunctionWriter, result: str, kind: Type | None, name: str, given: Operands) -> None:
    if name in ("memset", "memset.inline"):
        here.lines.append(f"fill({', '.join(lanes[0] for _, lanes in given[:3])});")
    elif name in ("memcpy", "memmove", "memcpy.inline"):
        here.lines.append(f"copy({', '.join(lanes[0] for _, lanes in given[:3])});")
    elif name == "trap":
        here.lines.append("abort();")
    elif name == "masked.store":
        (of, values), (_, (address,)), mask = given[0], given[1], given[-1][1]
        for lane, value, place, ask in zip(lanes_of(of), values, lane_places(of), mask, strict=True):
            here.lines += [f"if ({ask})", store(lane, address, value, place)]
    elif name == "masked.scatter":
        (of, values), (_, addresses), mask = given[0], given[1], given[-1][1]
        for lane, value, address, ask in zip(lanes_of(of), values, addresses, mask, strict=True):
            here.lines += [f"if ({ask})", store(lane, address, value)]
    elif kind is None:
        raise no_c(f"the function llvm.{name} is not known")
    elif here.used[result]:
        here.assign(result, kind, _values(kind, name, given))


def _values(kind: Type, name: str, given: Operands) -> list[str]:
    """The lanes of what a function of LLVM's without effects returns."""
    lanes = lanes_of(kind)
    if name in ("masked.load", "masked.gather"):
        addresses, mask, otherwise = given[0][1], given[-2][1], given[-1][1]
        places = lane_places(kind) if name == "masked.load" else [0] * len(lanes)
        where = addresses * len(lanes) if name == "masked.load" else addresses
        every = zip(lanes, mask, where, places, otherwise, strict=True)
        return [f"{ask} ? ({load(lane, p, place)}) : {other}" for lane, ask, p, place, other in every]
    if name.endswith(".with.overflow"):
        (of, a), (_, b) = given
        pairs = [overflowing(name.split(".")[0], lane, x, y) for lane, x, y in zip(lanes_of(of), a, b, strict=True)]
        return [pair[0] for pair in pairs] + [pair[1] for pair in pairs]
    if name.startswith("vector.reduce."):
        return [_reduced(name.split(".")[-1], lanes[0], given)]
    several = [values if len(values) == len(lanes) else values * len(lanes) for _, values in given]
    return [intrinsic(name, lane, each) for lane, *each in zip(lanes, *several, strict=True)]


def _reduced(what: str, lane: Scalar, given: Operands) -> str:
    """One lane of all those of a vector; sums of floating-point numbers half by half, as code for a processor does."""
    values = given[-1][1]
    while len(values) > 1:
        half = len(values) // 2
        pairs = zip(values[:half], values[half : 2 * half], strict=True)
        if what == "fadd":
            found = [f"({a} + {b})" for a, b in pairs]
        elif what in _REDUCED:
            found = [f"({binary(_REDUCED[what], lane, a, b)})" for a, b in pairs]
        elif what in _EXTREME:
            found = [f"({intrinsic(_EXTREME[what], lane, (a, b))})" for a, b in pairs]
        else:
            raise no_c(f"the function llvm.vector.reduce.{what} is not known")
        values = found + values[2 * half :]
    if len(given) == 2:
        return f"{given[0][1][0]} {'+' if what == 'fadd' else '*'} {values[0]}"
    return values[0]
