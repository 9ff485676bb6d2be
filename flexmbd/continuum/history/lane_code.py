"""FFCx's code of a cell, rewritten for several cells at a time: each number becomes one of as many lanes.

FFCx writes loops over points and straight lines of arithmetic in between.  The same lines on vectors of the C
compiler's (GCC and clang have them) do for a block of cells what they did for one, operation by operation in the same
order, so the numbers are the same to the bit whatever the width of the processor's registers.  Comparisons choose lane
by lane; functions other than the root are called lane by lane.

A table that is 1 at one point and 0 at all others, as of an element that has its values at the points, needs no loop:
its sums have one term.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from pycparser import c_ast, c_parser

_HEAD = """
#include <math.h>
#include <stdint.h>
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef int64_t marks __attribute__((vector_size(8 * LANES)));
typedef lanes stored __attribute__((aligned(8)));  /* in arrays of numbers */
#define ALL(x) ((x) - (lanes){0})
#define CHOOSE(m, a, b) ((lanes)(((m) & (marks)(a)) | (~(m) & (marks)(b))))
#define EACH(call) lanes r; for (int k = 0; k < LANES; ++k) r[k] = call; return r;
"""

_ONE = "static inline __attribute__((always_inline)) lanes lanes_{0}(lanes x) {{ EACH({0}(x[k])) }}\n"
_TWO = (
    "static inline __attribute__((always_inline)) lanes lanes_{0}(lanes x, lanes y) {{ EACH({0}(x[k], y[k])) }}\n"
)
_FUNCTIONS = {
    **dict.fromkeys(
        ("sqrt", "fabs", "cos", "sin", "tan", "acos", "asin", "atan", "cosh", "sinh", "tanh", "acosh", "asinh",
         "atanh", "exp", "log", "erf"),
        _ONE,
    ),
    **dict.fromkeys(("pow", "atan2", "fmin", "fmax"), _TWO),
}  # fmt: skip

# what an expression is: a whole number, a number, a truth, and the last two of each lane
_WHOLE, _NUMBER, _TRUTH, _LANES, _MARKS = range(5)


class NotRewrittenError(Exception):
    """The code has something that FFCx does not write, as far as this module knows."""


class _Value(NamedTuple):
    text: str
    kind: int


def lane_code(code: str, name: str, *, lanes: int) -> str:
    """C code of a function with the arguments of FFCx's one, whose tensor, coefficients and coordinates have lanes.

    Args:
        code: a C file of FFCx, in which there is one function that tabulates.
        name: of the new function.
        lanes: numbers of (m,) become (m, lanes); a power of two.

    Raises:
        NotRewrittenError: the code has what this module does not know.
    """
    try:
        tree = c_parser.CParser().parse(f"typedef unsigned char uint8_t; typedef int bool;\n{_function(code)}")
    except Exception as error:  # pycparser's own kind is not the same in all versions
        raise NotRewrittenError(str(error)) from error
    return f"#define LANES {lanes}\n{_Rewriting(tree.ext[-1]).code(name)}"


def _function(code: str) -> str:
    """The text of the function that tabulates, without comments."""
    plain = re.sub(r"//[^\n]*", "", code)
    begin = re.search(r"^void tabulate_tensor_\w+\(", plain, re.MULTILINE)
    depth = 0
    for brace in re.finditer("[{}]", plain[begin.start() :] if begin else ""):
        depth += 1 if brace.group() == "{" else -1
        if depth == 0 and begin:
            return plain[begin.start() : begin.start() + brace.end()]
    raise NotRewrittenError("no function that tabulates")


class _Rewriting:
    """Of one function."""

    def __init__(self, function: Any) -> None:
        self._function = function
        self._kinds = {"c": _NUMBER, "A": _LANES, "w": _LANES, "coordinate_dofs": _LANES}
        self._changed = {_root(node.lvalue) for node in _walk(function) if isinstance(node, c_ast.Assignment)}
        self._units: set[str] = set()  # tables that are one at one point
        self._functions: dict[str, str] = {}

    def code(self, name: str) -> str:
        body = "".join(self._statement(one, "  ") for one in self._function.body.block_items or ())
        return (
            f"{_HEAD}{''.join(self._functions.values())}"
            f"void {name}(stored* restrict A, const stored* restrict w, const double* restrict c, "
            "const stored* restrict coordinate_dofs,\n"
            "          const int* restrict entity_local_index, const uint8_t* restrict quadrature_permutation, "
            f"void* custom)\n{{\n{body}}}\n"
        )

    def _statement(self, node: Any, indent: str) -> str:
        match node:
            case c_ast.Compound():
                inner = "".join(self._statement(one, indent + "  ") for one in node.block_items or ())
                return f"{indent}{{\n{inner}{indent}}}\n"
            case c_ast.Decl():
                return indent + self._declaration(node)
            case c_ast.For():
                return self._loop(node, indent)
            case c_ast.Assignment():
                return indent + self._assignment(node)
            case c_ast.EmptyStatement():
                return ""
        raise NotRewrittenError(type(node).__name__)

    def _declaration(self, node: Any) -> str:
        sizes, kind = [], node.type
        while isinstance(kind, c_ast.ArrayDecl):
            sizes.append(self._expression(kind.dim).text)
            kind = kind.type
        (named,) = kind.type.names[-1:]
        shape = "".join(f"[{size}]" for size in sizes)
        if named == "double" and "static" in node.storage:
            self._kinds[node.name] = _NUMBER
            if _is_unit(node.init):
                self._units.add(node.name)
            return f"static const double {node.name}{shape} = {_listed(node.init)};\n"
        if named == "double" and sizes:
            self._kinds[node.name] = _LANES
            if node.init is not None and any(float(one) for one in _numbers(node.init)):
                raise NotRewrittenError("an array that begins with other values than zeros")
            return f"lanes {node.name}{shape}{' = {{0}}' if node.init is not None else ''};\n"
        value = None if node.init is None else self._expression(node.init)
        if named == "int" and _given(value).kind != _LANES:  # that of a choice between whole numbers has lanes
            self._kinds[node.name] = _WHOLE
            return f"int {node.name} = {_given(value).text};\n"
        if named == "bool":
            truth = _given(value)
            self._kinds[node.name] = truth.kind
            return f"{'marks' if truth.kind == _MARKS else 'int'} {node.name} = {truth.text};\n"
        if named not in ("double", "int"):
            raise NotRewrittenError(f"a variable of type {named}")
        if value is not None and value.kind in (_WHOLE, _NUMBER) and node.name not in self._changed:
            self._kinds[node.name] = _NUMBER
            return f"double {node.name} = {value.text};\n"
        self._kinds[node.name] = _LANES
        return f"lanes {node.name}{'' if value is None else f' = {_in_lanes(value)}'};\n"

    def _loop(self, node: Any, indent: str) -> str:
        """A loop; what has one term of its sum stands before it."""
        (begin,) = node.init.decls
        self._kinds[begin.name] = _WHOLE
        single, rest = "", []
        for one in node.stmt.block_items or ():
            at = self._only_at(one, begin.name)
            if at is None:
                rest.append(one)
            else:
                single += f"{indent}{{ const int {begin.name} = {at}; {self._assignment(one).strip()} }}\n"
        if not rest:
            return single
        inner = "".join(self._statement(one, indent + "  ") for one in rest)
        bounds = f"int {begin.name} = {self._expression(begin.init).text}; {self._expression(node.cond).text}"
        return f"{single}{indent}for ({bounds}; ++{begin.name})\n{indent}{{\n{inner}{indent}}}\n"

    def _only_at(self, node: Any, index: str) -> str | None:
        """At which value of a loop's index a sum grows, where a table is 1 there and 0 elsewhere."""
        if not isinstance(node, c_ast.Assignment) or node.op != "+=":
            return None
        for factor in _factors(node.rvalue):
            if isinstance(factor, c_ast.ArrayRef) and _root(factor) in self._units:
                point, place = factor.name.subscript, factor.subscript
                if isinstance(point, c_ast.ID) and isinstance(place, c_ast.ID) and place.name == index != point.name:
                    return str(point.name)
        return None

    def _assignment(self, node: Any) -> str:
        target, value = self._expression(node.lvalue), self._expression(node.rvalue)
        if target.kind != _LANES:
            raise NotRewrittenError("an assignment to what has no lanes")
        return f"{target.text} {node.op} {_in_lanes(value)};\n"

    def _expression(self, node: Any) -> _Value:
        match node:
            case c_ast.Constant():
                return _Value(node.value, _WHOLE if node.type == "int" else _NUMBER)
            case c_ast.ID():
                return _Value(node.name, self._kind(node.name))
            case c_ast.ArrayRef():
                inner = self._expression(node.name)
                return _Value(f"{inner.text}[{self._expression(node.subscript).text}]", inner.kind)
            case c_ast.UnaryOp():
                return self._unary(node)
            case c_ast.BinaryOp():
                return self._binary(node)
            case c_ast.TernaryOp():
                return self._choice(node)
            case c_ast.FuncCall():
                return self._call(node)
        raise NotRewrittenError(type(node).__name__)

    def _kind(self, name: str) -> int:
        if name not in self._kinds:
            raise NotRewrittenError(f"the name {name}")
        return self._kinds[name]

    def _unary(self, node: Any) -> _Value:
        value = self._expression(node.expr)
        if node.op == "!" and value.kind == _MARKS:
            return _Value(f"(~{value.text})", _MARKS)
        if node.op not in ("-", "!"):
            raise NotRewrittenError(node.op)
        return _Value(f"({node.op}{value.text})", value.kind)

    def _binary(self, node: Any) -> _Value:
        left, right, op = self._expression(node.left), self._expression(node.right), node.op
        if op in ("&&", "||"):
            if _MARKS not in (left.kind, right.kind):
                return _Value(f"({left.text} {op} {right.text})", _TRUTH)
            return _Value(f"({_in_marks(left)} {op[0]} {_in_marks(right)})", _MARKS)
        compares = op in ("<", ">", "<=", ">=", "==", "!=")
        if not compares and op not in ("+", "-", "*", "/"):
            raise NotRewrittenError(op)
        if compares and _LANES in (left.kind, right.kind):
            return _Value(f"((marks)({_in_lanes(left)} {op} {_in_lanes(right)}))", _MARKS)
        if compares:
            return _Value(f"({left.text} {op} {right.text})", _TRUTH)
        if _LANES in (left.kind, right.kind):
            return _Value(f"({_as_number(left)} {op} {_as_number(right)})", _LANES)
        return _Value(f"({left.text} {op} {right.text})", max(left.kind, right.kind))

    def _choice(self, node: Any) -> _Value:
        chooses = self._expression(node.cond)
        first, second = self._expression(node.iftrue), self._expression(node.iffalse)
        if chooses.kind == _MARKS:
            return _Value(f"CHOOSE({chooses.text}, {_in_lanes(first)}, {_in_lanes(second)})", _LANES)
        if _LANES in (first.kind, second.kind):
            return _Value(f"({chooses.text} ? {_in_lanes(first)} : {_in_lanes(second)})", _LANES)
        return _Value(f"({chooses.text} ? {first.text} : {second.text})", _NUMBER)

    def _call(self, node: Any) -> _Value:
        name, values = node.name.name, [self._expression(one) for one in node.args.exprs]
        if name not in _FUNCTIONS:
            raise NotRewrittenError(f"the function {name}")
        if all(value.kind != _LANES for value in values):
            return _Value(f"{name}({', '.join(value.text for value in values)})", _NUMBER)
        if name == "pow" and values[1].kind in (_WHOLE, _NUMBER) and values[1].text in ("2", "2.0"):
            # as compilers make of it for a number alone
            self._functions["square"] = "static inline lanes lanes_square(lanes x) { return x * x; }\n"
            return _Value(f"lanes_square({values[0].text})", _LANES)
        self._functions[name] = _FUNCTIONS[name].format(name)
        return _Value(f"lanes_{name}({', '.join(map(_in_lanes, values))})", _LANES)


def _walk(node: Any) -> Iterator[Any]:
    yield node
    for _, child in node.children():
        yield from _walk(child)


def _root(node: Any) -> str:
    """The name of a variable, or of the array of an entry."""
    while isinstance(node, c_ast.ArrayRef):
        node = node.name
    return str(node.name)


def _factors(node: Any) -> Iterator[Any]:
    if isinstance(node, c_ast.BinaryOp) and node.op == "*":
        yield from _factors(node.left)
        yield from _factors(node.right)
    else:
        yield node


def _numbers(node: Any) -> Iterator[str]:
    """The numbers of an initialiser, in order."""
    if isinstance(node, c_ast.InitList):
        for one in node.exprs:
            yield from _numbers(one)
    elif isinstance(node, c_ast.UnaryOp) and node.op == "-":
        yield f"-{node.expr.value}"
    else:
        yield str(node.value)


def _listed(node: Any) -> str:
    if isinstance(node, c_ast.InitList):
        return f"{{{', '.join(_listed(one) for one in node.exprs)}}}"
    return next(_numbers(node))


def _is_unit(node: Any) -> bool:
    """Whether a table [1][1][n][n] is 1 where its last places are the same and 0 elsewhere."""
    for _ in range(2):
        if not isinstance(node, c_ast.InitList) or len(node.exprs) != 1:
            return False
        node = node.exprs[0]
    if not isinstance(node, c_ast.InitList) or not all(isinstance(row, c_ast.InitList) for row in node.exprs):
        return False
    rows = [[float(one) for one in _numbers(row)] for row in node.exprs]
    return len(rows) > 1 and rows == [[float(i == j) for j in range(len(rows))] for i in range(len(rows))]


def _given(value: _Value | None) -> _Value:
    if value is None:
        raise NotRewrittenError("a variable without value")
    return value


def _as_number(value: _Value) -> str:
    """Beside lanes in an operation."""
    return f"(double)({value.text})" if value.kind == _WHOLE else value.text


def _in_lanes(value: _Value) -> str:
    if value.kind in (_TRUTH, _MARKS):
        raise NotRewrittenError("a truth among numbers")
    return value.text if value.kind == _LANES else f"ALL({_as_number(value)})"


def _in_marks(value: _Value) -> str:
    return value.text if value.kind == _MARKS else f"((marks){{0}} - (int64_t)({value.text} ? 1 : 0))"
