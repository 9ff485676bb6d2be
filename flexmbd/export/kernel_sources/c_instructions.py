"""Instructions of LLVM IR as statements of C."""

from __future__ import annotations

from flexmbd.export.kernel_sources import c_calls
from flexmbd.export.kernel_sources.c_function import FunctionWriter
from flexmbd.export.kernel_sources.c_lanes import load, store, texts
from flexmbd.export.kernel_sources.c_operations import binary, cast, compare, fitted, with_sign
from flexmbd.export.kernel_sources.ir_text import LineReader, c_lane
from flexmbd.export.kernel_sources.ir_types import (
    ADDRESS,
    INT64,
    Scalar,
    Sequence,
    Type,
    lane_places,
    lanes_of,
    no_c,
    part_of,
    size_of,
)

_FLAGS = ("nuw", "nsw", "exact", "disjoint", "nneg", "samesign", "inbounds", "nusw")
_SHARED = ("atomic", "volatile")
_FAST = ("fast", "nnan", "ninf", "nsz", "arcp", "contract", "afn", "reassoc")
_BINARY = "add sub mul udiv sdiv urem srem shl lshr ashr and or xor fadd fsub fmul fdiv frem".split()
_CASTS = "trunc zext sext fptrunc fpext fptoui fptosi uitofp sitofp ptrtoint inttoptr bitcast".split()


def write(here: FunctionWriter, result: str, text: str) -> None:
    """Add the statements of one instruction to the function.

    Raises:
        ExportError: it is none that is known.
    """
    reader = here.reader(text)
    word = reader.take()
    if word in ("tail", "musttail", "notail"):
        word = reader.take()
    while reader.skip(*_FLAGS, *_FAST):
        pass
    if word == "call":
        c_calls.write(here, result, reader)
        return
    if word not in _KNOWN:
        raise no_c(f"the instruction {word!r} is not known")
    if result and not here.used[result] and reader.next not in _SHARED:
        return  # nothing else that is known has effects and a result
    if word in _BINARY:
        kind = reader.value_type()
        a, b = _two(reader, kind)
        lanes = zip(lanes_of(kind), a, b, strict=True)
        here.assign(result, kind, [binary(word, lane, one, two) for lane, one, two in lanes])
    elif word in ("icmp", "fcmp"):
        _compare(here, result, reader)
    elif word in _CASTS:
        kind, values = reader.operand()
        reader.expect("to")
        new = reader.value_type()
        if len(lanes_of(kind)) != len(lanes_of(new)):
            _regroup(here, result, kind, new, texts(kind, values))
            return
        each = zip(lanes_of(kind), lanes_of(new), texts(kind, values), strict=True)
        here.assign(result, new, [cast(word, old, fresh, value) for old, fresh, value in each])
    else:
        _OTHERS[word](here, result, reader)


def _two(reader: LineReader, kind: Type) -> tuple[list[str], list[str]]:
    a = texts(kind, reader.value(kind))
    reader.expect(",")
    return a, texts(kind, reader.value(kind))


def _next(reader: LineReader) -> tuple[Type, list[str]]:
    """An operand after a comma."""
    reader.expect(",")
    kind, values = reader.operand()
    return kind, texts(kind, values)


def _compare(here: FunctionWriter, result: str, reader: LineReader) -> None:
    what = reader.take()
    kind = reader.value_type()
    a, b = _two(reader, kind)
    answers = [compare(what, lane, one, two) for lane, one, two in zip(lanes_of(kind), a, b, strict=True)]
    truth = Scalar("i", 1)
    here.assign(result, Sequence(kind.count, truth, True) if isinstance(kind, Sequence) else truth, answers)


def _regroup(here: FunctionWriter, result: str, kind: Type, new: Type, values: list[str]) -> None:
    """The same bits as other lanes, as long as all of them are one word."""
    old, fresh = lanes_of(kind), lanes_of(new)
    if sum(lane.bits for lane in old) > INT64.bits or sum(lane.bits for lane in fresh) > INT64.bits:
        raise no_c("bits of more than one word as other lanes are not known")
    parts, place = [], 0
    for lane, value in zip(old, values, strict=True):
        whole = value if lane.kind != "f" else f"bits_f{lane.bits}({value})"
        parts.append(f"(uint64_t){whole} << {place}")
        place += lane.bits
    place = 0
    here.lines.append(f"{{\nuint64_t word = {' | '.join(parts)};")
    for name, lane in zip(here.define(result, new), fresh, strict=True):
        whole = fitted(f"(word >> {place})", Scalar("i", lane.bits))
        here.lines.append(f"{name} = {whole};" if lane.kind != "f" else f"{name} = f{lane.bits}_of({whole});")
        place += lane.bits
    here.lines.append("}")


def _negate(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    here.assign(result, kind, [f"-{value}" for value in texts(kind, values)])


def _same(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    here.assign(result, kind, texts(kind, values))


def _select(here: FunctionWriter, result: str, reader: LineReader) -> None:
    condition, which = reader.operand()
    kind, a = _next(reader)
    _, b = _next(reader)
    chosen = texts(condition, which)
    chosen = chosen if len(chosen) == len(a) else chosen * len(a)
    here.assign(result, kind, [f"{c} ? {one} : {two}" for c, one, two in zip(chosen, a, b, strict=True)])


def _allocate(here: FunctionWriter, result: str, reader: LineReader) -> None:
    size = size_of(reader.value_type())
    first = next(iter(here.function.blocks))
    if here.block != first or (reader.skip(",") and reader.next != "align"):
        raise no_c("memory on the stack of a size that is known in a run alone")
    (name,) = here.define(result, ADDRESS)
    here.arrays.append(f"uint64_t {name}_m[{max(1, -(-size // 8))}];")
    here.lines.append(f"{name} = (uint64_t)(uintptr_t){name}_m;")


def _load(here: FunctionWriter, result: str, reader: LineReader) -> None:
    if reader.next in _SHARED:
        raise no_c("memory that is shared between threads")
    kind = reader.value_type()
    _, (address,) = _next(reader)
    pairs = zip(lanes_of(kind), lane_places(kind), strict=True)
    here.assign(result, kind, [load(lane, address, place) for lane, place in pairs])


def _store(here: FunctionWriter, result: str, reader: LineReader) -> None:
    if reader.next in _SHARED:
        raise no_c("memory that is shared between threads")
    kind, values = reader.operand()
    _, (address,) = _next(reader)
    for lane, place, value in zip(lanes_of(kind), lane_places(kind), texts(kind, values), strict=True):
        here.lines.append(store(lane, address, value, place))


def _element(here: FunctionWriter, result: str, reader: LineReader) -> None:
    """The address of a part: that of the whole, and what the indices add to it."""
    kind = reader.value_type()
    base_kind, bases = _next(reader)
    offset, variable = reader.offset(kind)
    count = max([len(bases), *(len(lanes) for _, _, lanes in variable)])
    found = []
    for k in range(count):
        text = bases[k % len(bases)]
        for size, index_kind, lanes in variable:
            lane = lanes_of(index_kind)[0]
            value = c_lane(lane, lanes[k % len(lanes)])
            index = value if lane.bits == INT64.bits else f"(uint64_t)({with_sign(value, lane)})"
            text += f" + {index}" if size == 1 else f" + {index} * {size}u"
        found.append(text + (f" + {offset}ull" if offset else ""))
    many = count > 1 or isinstance(base_kind, Sequence)
    here.assign(result, Sequence(count, ADDRESS, True) if many else ADDRESS, found)


def _extract_value(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    first, inner = _part(reader, kind)
    here.assign(result, inner, texts(kind, values)[first : first + len(lanes_of(inner))])


def _insert_value(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    _, given = _next(reader)
    first, _ = _part(reader, kind)
    found = texts(kind, values)
    found[first : first + len(given)] = given
    here.assign(result, kind, found)


def _part(reader: LineReader, kind: Type) -> tuple[int, Type]:
    first = 0
    while reader.skip(","):
        before, kind, _ = part_of(kind, int(reader.take()))
        first += before
    return first, kind


def _index(reader: LineReader) -> int:
    reader.expect(",")
    _, (index,) = reader.operand()
    if not isinstance(index, int):
        raise no_c("a lane that is known in a run alone")
    return index


def _extract_element(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    index = _index(reader)
    here.assign(result, lanes_of(kind)[index], [texts(kind, values)[index]])


def _insert_element(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    _, (value,) = _next(reader)
    index = _index(reader)
    found = texts(kind, values)
    found[index] = value
    here.assign(result, kind, found)


def _shuffle(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, a = reader.operand()
    found = texts(kind, a) + _next(reader)[1]
    reader.expect(",")
    _, order = reader.operand()
    if not isinstance(kind, Sequence):
        raise no_c("a scalar's lanes in another order")
    values = [found[k] for k in order if isinstance(k, int)]
    here.assign(result, Sequence(len(order), kind.of, True), values)


def _branch(here: FunctionWriter, result: str, reader: LineReader) -> None:
    if reader.skip("label"):
        here.lines.append(here.jump(reader.take()))
        return
    kind, values = reader.operand()
    targets = []
    for _ in range(2):
        reader.expect(",")
        reader.expect("label")
        targets.append(reader.take())
    here.lines += [f"if ({texts(kind, values)[0]}) {{", here.jump(targets[0]), "}", here.jump(targets[1])]


def _switch(here: FunctionWriter, result: str, reader: LineReader) -> None:
    kind, values = reader.operand()
    reader.expect(",")
    reader.expect("label")
    default = reader.take()
    reader.expect("[")
    here.lines.append(f"switch ({texts(kind, values)[0]}) {{")
    while not reader.skip("]"):
        case, which = reader.operand()
        reader.expect(",")
        reader.expect("label")
        here.lines += [f"case {texts(case, which)[0]}:", here.jump(reader.take())]
    here.lines += ["default:", here.jump(default), "}"]


def _return(here: FunctionWriter, result: str, reader: LineReader) -> None:
    if reader.skip("void"):
        here.lines.append("return;")
        return
    kind, values = reader.operand()
    found = texts(kind, values)
    if isinstance(kind, Scalar):
        here.lines.append(f"return {found[0]};")
    else:
        parts = "\n".join(f"found.e{k} = {value};" for k, value in enumerate(found))
        here.lines.append(f"{{\n{here.around.result(kind)} found;\n{parts}\nreturn found;\n}}")


def _unreachable(here: FunctionWriter, result: str, reader: LineReader) -> None:
    here.lines.append("abort();")


_OTHERS = {
    "fneg": _negate,
    "freeze": _same,
    "select": _select,
    "alloca": _allocate,
    "load": _load,
    "store": _store,
    "getelementptr": _element,
    "extractvalue": _extract_value,
    "insertvalue": _insert_value,
    "extractelement": _extract_element,
    "insertelement": _insert_element,
    "shufflevector": _shuffle,
    "br": _branch,
    "switch": _switch,
    "ret": _return,
    "unreachable": _unreachable,
}
_KNOWN = {*_BINARY, *_CASTS, "icmp", "fcmp", *_OTHERS}
