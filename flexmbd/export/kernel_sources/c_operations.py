"""Operations of LLVM IR on one lane, as C expressions; kernel_words.h has the functions that they call."""

from __future__ import annotations

from collections.abc import Sequence

from flexmbd.export.kernel_sources.ir_types import INT32, Scalar, no_c

_PLAIN = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^"}
_FLOATING = {"fadd": "+", "fsub": "-", "fmul": "*", "fdiv": "/"}
_ORDER = {"eq": "==", "ne": "!=", "gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_OPPOSITE = {"eq": "ne", "ne": "eq", "gt": "le", "ge": "lt", "lt": "ge", "le": "gt"}

#: C's functions of doubles, by how many arguments.
MATHEMATICS = {
    **dict.fromkeys(
        "sqrt sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp exp2 expm1 log log2 log10 log1p fabs "
        "floor ceil trunc round rint nearbyint cbrt erf erfc tgamma lgamma".split(),
        1,
    ),
    **dict.fromkeys("atan2 pow fmod hypot copysign fmin fmax fdim remainder nextafter".split(), 2),
    "fma": 3,
}
_RENAMED = {"minnum": "fmin", "maxnum": "fmax", "roundeven": "rint"}


def fitted(text: str, kind: Scalar) -> str:
    """A number of C that may have more bits, cut to those of the lane."""
    cut = f"({text} & {hex(2**kind.bits - 1)}ull)" if kind.bits != 8 * kind.size else text
    return f"({kind.c}){cut}"


def with_sign(text: str, kind: Scalar) -> str:
    """A whole number as one of C with a sign."""
    if kind.bits == 8 * kind.size:
        return f"(int64_t)(int{kind.bits}_t){text}"
    return f"sign({text}, {kind.bits})"


def binary(operation: str, kind: Scalar, a: str, b: str) -> str:
    """An operation on two lanes of a kind."""
    wide = "uint32_t" if kind.bits <= INT32.bits else "uint64_t"
    within = f"(({wide}){b} & {8 * kind.size - 1}u)" if kind.size > 2 else f"(({wide}){b} & 31u)"
    if operation in _FLOATING:
        return f"{a} {_FLOATING[operation]} {b}"
    if operation == "frem":
        return f"({kind.c})fmod({a}, {b})"
    if operation in _PLAIN:
        return fitted(f"(({wide}){a} {_PLAIN[operation]} ({wide}){b})", kind)
    if operation == "shl":
        return fitted(f"(({wide}){a} << {within})", kind)
    if operation == "lshr":
        return fitted(f"(({wide}){a} >> {within})", kind)
    if operation == "ashr":
        return fitted(f"(uint64_t)shifted({with_sign(a, kind)}, (int){within})", kind)
    if operation in ("udiv", "urem"):
        return f"({kind.c})({a} {'/' if operation == 'udiv' else '%'} {b})"
    if operation in ("sdiv", "srem"):
        symbol = "/" if operation == "sdiv" else "%"
        return fitted(f"(uint64_t)({with_sign(a, kind)} {symbol} {with_sign(b, kind)})", kind)
    raise no_c(f"the instruction {operation!r} is not known")


def compare(what: str, kind: Scalar, a: str, b: str) -> str:
    """A comparison of whole numbers, addresses or floating-point numbers, as 0 or 1."""
    if kind.kind == "f":
        if what in ("true", "false"):
            return str(int(what == "true"))
        if what in ("ord", "uno"):
            return f"{'!' if what == 'ord' else ''}unordered({a}, {b})"
        order = what[1:]
        if order in ("eq", "ne") and what != "oeq" and what != "une":  # one and ueq: less or greater, or neither
            return f"{'!' if what == 'ueq' else ''}({a} < {b} || {a} > {b})"
        return f"!({a} {_ORDER[_OPPOSITE[order]]} {b})" if what[0] == "u" else f"{a} {_ORDER[order]} {b}"
    if what in ("eq", "ne"):
        return f"{a} {_ORDER[what]} {b}"
    if what[0] == "s":
        a, b = with_sign(a, kind), with_sign(b, kind)
    return f"{a} {_ORDER[what[1:]]} {b}"


def cast(operation: str, old: Scalar, new: Scalar, a: str) -> str:
    """A lane of another type."""
    if operation in ("trunc", "zext", "ptrtoint", "inttoptr"):
        return fitted(a, new) if new.bits < old.bits else f"({new.c}){a}"
    if operation == "sext":
        return fitted(f"(uint64_t)({with_sign(a, old)})", new)
    if operation in ("fptrunc", "fpext", "uitofp"):
        return f"({new.c}){a}"
    if operation == "sitofp":
        return f"({new.c})({with_sign(a, old)})"
    if operation == "fptosi":
        return f"whole32({a})" if new == INT32 else fitted(f"whole({a})", new)
    if operation == "fptoui":
        return fitted(f"unsigned_whole({a})", new)
    if operation == "bitcast" and old.bits == new.bits:
        if old.kind == "f" and new.kind != "f":
            return f"bits_f{old.bits}({a})"
        return f"f{new.bits}_of({a})" if new.kind == "f" and old.kind != "f" else a
    raise no_c(f"the conversion {operation!r} of {old.bits} to {new.bits} bits is not known")


def overflowing(operation: str, kind: Scalar, a: str, b: str) -> tuple[str, str]:
    """Of uadd, usub, umul, sadd, ssub and smul: the result that wraps around, and whether it did."""
    most = f"{hex(2**kind.bits - 1)}ull"
    found = binary(operation[1:], kind, a, b)
    if operation == "umul":
        return found, f"long_product({a}, {b}, {most})"
    if operation == "smul":
        return found, f"long_signed_product({with_sign(a, kind)}, {with_sign(b, kind)}, {kind.bits})"
    if operation[0] == "u":
        return found, f"({a} > {most} - {b})" if operation == "uadd" else f"({a} < {b})"
    top = kind.bits - 1
    differ = "~" if operation == "sadd" else ""
    return found, f"(uint8_t)(({differ}((uint64_t){a} ^ {b}) & ((uint64_t){a} ^ ({found}))) >> {top} & 1)"


def intrinsic(name: str, kind: Scalar, given: Sequence[str]) -> str:
    """A function of LLVM's, or of C's mathematical ones, on lanes of a kind."""
    function = _RENAMED.get(name, name)
    if kind.kind == "f":
        if name == "fmuladd":
            return f"{given[0]} * {given[1]} + {given[2]}"
        if name == "powi":
            return f"({kind.c})whole_power({given[0]}, {given[1]})"
        if function in MATHEMATICS:
            return f"{function}{'f' if kind.bits == 32 else ''}({', '.join(given[: MATHEMATICS[function]])})"
    elif name in ("smax", "smin", "umax", "umin"):
        order = compare(f"{name[0]}{'gt' if name[1:] == 'max' else 'lt'}", kind, given[0], given[1])
        return f"{order} ? {given[0]} : {given[1]}"
    elif name == "abs":
        return f"{compare('slt', kind, given[0], '0')} ? {binary('sub', kind, '0', given[0])} : {given[0]}"
    elif name == "ctpop":
        return f"({kind.c})ones({given[0]})"
    elif name in ("ctlz", "cttz"):
        return f"({kind.c})zeros_{'above' if name == 'ctlz' else 'below'}({given[0]}, {kind.bits})"
    elif name in ("uadd.sat", "usub.sat"):
        found, wrapped = overflowing(name[:4], kind, given[0], given[1])
        return f"{wrapped} ? {2**kind.bits - 1 if name == 'uadd.sat' else 0}ull : {found}"
    elif name in ("fshl", "fshr") and kind.bits == 8 * kind.size:
        high, low, by = (f"(uint64_t){one}" for one in given)
        left = f"({by} % {kind.bits}u)" if name == "fshl" else f"({kind.bits}u - {by} % {kind.bits}u)"
        right = f"({kind.bits}u - {by} % {kind.bits}u)" if name == "fshl" else f"({by} % {kind.bits}u)"
        whole = fitted(low if name == "fshr" else high, kind)
        return f"{by} % {kind.bits}u == 0 ? {whole} : {fitted(f'({high} << {left} | {low} >> {right})', kind)}"
    elif name == "is.fpclass":
        return f"of_class({given[0]}, {given[1]})"
    elif name == "expect":
        return given[0]
    raise no_c(f"the function llvm.{name} is not known")
