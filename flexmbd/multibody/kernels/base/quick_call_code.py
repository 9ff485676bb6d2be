"""Object code of the functions of `quick_call`: ``PyObject *call(PyObject *table, PyObject **arguments, size_t n)``."""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

_WORD, _INT, _BYTE, _DOUBLE = ir.IntType(64), ir.IntType(32), ir.IntType(8), ir.DoubleType()

# Where the parts of objects lie, in CPython's and numpy's stable interfaces: PyObject, PyTupleObject,
# PyArrayObject_fields, PyArray_Descr.
_TYPE, _COUNT, _ITEMS = 8, 16, 24
_DATA, _NDIM, _DIMENSIONS, _STRIDES, _DESCRIPTION, _FLAGS = 16, 24, 32, 40, 56, 64
_BYTE_ORDER, _TYPE_NUMBER = 26, 28
# words of the table
_ENTRY, _NAME, _NONE, _OTHERWISE, _RAISER, _TYPES = range(6)


def object_code(name: str, kinds: list[Any], returns: Any, *, keeps_lock: bool) -> bytes:
    """Object code of a function of this name for arguments and a result as `quick_call` describes them."""
    module = ir.Module(name)
    module.triple = llvm.get_process_triple()
    _Writer(module, name, kinds, returns, keeps_lock=keeps_lock)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(module.triple)
    machine = target.create_target_machine(opt=2, reloc="static", codemodel="large")
    code: bytes = machine.emit_object(llvm.parse_assembly(str(module)))
    return code


class _Writer:
    """Writes the function; pointers are words."""

    def __init__(self, module: Any, name: str, kinds: list[Any], returns: Any, *, keeps_lock: bool) -> None:
        self.module = module
        function = ir.Function(module, ir.FunctionType(_WORD, [_WORD] * 3), name)
        self.builder = builder = ir.IRBuilder(function.append_basic_block())
        self.other = function.append_basic_block("other")
        self.failed = function.append_basic_block("failed")
        self.types = 0
        self.words: list[Any] = []
        own, self.arguments, count = function.args
        self.table = self.call("PyLong_AsLongLong", own)
        self.demand(builder.icmp_unsigned("==", count, _WORD(len(kinds))))
        for k, kind in enumerate(kinds):
            self.read(self.load(self.arguments, 8 * k), kind)
        self.enter(returns, keeps_lock=keeps_lock)
        builder.position_at_end(self.other)
        builder.ret(self.call("PyObject_Vectorcall", self.fixed(_OTHERWISE), self.arguments, count, _WORD(0)))
        builder.position_at_end(self.failed)
        builder.ret(_WORD(0))

    def call(self, name: str, *values: Any, kind: Any = _WORD) -> Any:
        """What a function of Python's interface returns."""
        function = self.module.globals.get(name)
        if function is None:
            function = ir.Function(self.module, ir.FunctionType(kind, [one.type for one in values]), name)
        return self.builder.call(function, values)

    def load(self, address: Any, offset: int, kind: Any = _WORD) -> Any:
        place = self.builder.add(address, _WORD(offset))
        return self.builder.load(self.builder.inttoptr(place, kind.as_pointer()))

    def fixed(self, k: int) -> Any:
        """A word of the table."""
        return self.load(self.table, 8 * k)

    def demand(self, truth: Any, otherwise: Any = None) -> None:
        """Go on where something is true; elsewhere the arguments are of other types."""
        behind = self.builder.append_basic_block()
        self.builder.cbranch(truth, behind, otherwise or self.other)
        self.builder.position_at_end(behind)

    def read(self, value: Any, kind: Any) -> None:
        """The words of an argument."""
        builder = self.builder
        self.demand(builder.icmp_unsigned("==", self.load(value, _TYPE), self.fixed(_TYPES + self.types)))
        self.types += 1
        if isinstance(kind, list):
            self.demand(builder.icmp_unsigned("==", self.load(value, _COUNT), _WORD(len(kind))))
            for k, one in enumerate(kind):
                self.read(self.load(value, _ITEMS + 8 * k), one)
        elif isinstance(kind, tuple):
            self.read_array(value, *kind)
        elif kind == "d":
            self.words.append(builder.bitcast(self.call("PyFloat_AsDouble", value, kind=_DOUBLE), _WORD))
        elif kind == "?":
            truth = self.call("PyObject_IsTrue", value, kind=_INT)
            self.words.append(builder.zext(truth, _WORD))
        elif kind == "q":
            self.words.append(self.whole(value))
        elif kind == "s":
            number = self.call("PyObject_GetAttr", value, self.fixed(_NAME))
            self.demand(builder.icmp_unsigned("!=", number, _WORD(0)), self.failed)
            self.words.append(self.call("PyLong_AsLongLong", number))
            self.call("Py_DecRef", number, kind=ir.VoidType())

    def whole(self, value: Any) -> Any:
        """A whole number; OverflowError where it does not fit into a word."""
        builder = self.builder
        number = self.call("PyLong_AsLongLong", value)
        odd = builder.icmp_signed("==", number, _WORD(-1))
        with builder.if_then(odd, likely=False):
            raised = self.call("PyErr_Occurred")
            with builder.if_then(builder.icmp_unsigned("!=", raised, _WORD(0))):
                builder.branch(self.failed)
        return number

    def read_array(self, value: Any, number: int, order: int, ndim: int, mask: int, flags: int, strided: bool) -> None:
        builder = self.builder
        description = self.load(value, _DESCRIPTION)
        found = [
            builder.icmp_signed("==", self.load(value, _NDIM, _INT), _INT(ndim)),
            builder.icmp_signed("==", builder.and_(self.load(value, _FLAGS, _INT), _INT(mask)), _INT(flags)),
            builder.icmp_signed("==", self.load(description, _TYPE_NUMBER, _INT), _INT(number)),
            builder.icmp_signed("==", self.load(description, _BYTE_ORDER, _BYTE), _BYTE(order)),
        ]
        for one in found:
            self.demand(one)
        self.words.append(self.load(value, _DATA))
        for offset in (_DIMENSIONS, _STRIDES) if strided else (_DIMENSIONS,):
            row = self.load(value, offset)
            self.words += [self.load(row, 8 * axis) for axis in range(ndim)]

    def enter(self, returns: Any, *, keeps_lock: bool) -> None:
        """Call the machine code, without Python's lock unless it is kept, and return what it writes or raises."""
        builder, count = self.builder, len(self.words)
        with builder.goto_entry_block():
            block = builder.alloca(ir.ArrayType(_WORD, count + max(1, _size(returns))))
        begin = builder.ptrtoint(block, _WORD)
        for k, word in enumerate(self.words):
            self.store(begin, 8 * k, word)
        kind = ir.FunctionType(_INT, [_WORD]).as_pointer()
        state = None if keeps_lock else self.call("PyEval_SaveThread")
        status = builder.call(builder.inttoptr(self.fixed(_ENTRY), kind), [begin])
        if state is not None:
            self.call("PyEval_RestoreThread", state, kind=ir.VoidType())
        with builder.if_then(builder.icmp_signed("!=", status, _INT(0)), likely=False):
            place = self.call("PyLong_FromLongLong", self.load(begin, 8 * count))
            self.store(begin, 0, place)
            self.call("PyObject_Vectorcall", self.fixed(_RAISER), begin, _WORD(1), _WORD(0))
            builder.ret(_WORD(0))
        self.results = iter(range(count, count + _size(returns)))
        builder.ret(self.made(returns, begin))

    def store(self, address: Any, offset: int, value: Any) -> None:
        place = self.builder.add(address, _WORD(offset))
        self.builder.store(value, self.builder.inttoptr(place, value.type.as_pointer()))

    def made(self, returns: Any, begin: Any) -> Any:
        """A new object of the result's next words."""
        if isinstance(returns, list):
            row = self.call("PyTuple_New", _WORD(len(returns)))
            for k, one in enumerate(returns):
                self.call("PyTuple_SetItem", row, _WORD(k), self.made(one, begin), kind=_INT)
            return row
        if returns is None:
            self.call("Py_IncRef", self.fixed(_NONE), kind=ir.VoidType())
            return self.fixed(_NONE)
        word = self.load(begin, 8 * next(self.results))
        if returns == "d":
            return self.call("PyFloat_FromDouble", self.builder.bitcast(word, _DOUBLE))
        return self.call("PyLong_FromLongLong" if returns == "q" else "PyBool_FromLong", word)


def _size(returns: Any) -> int:
    if isinstance(returns, list):
        return sum(map(_size, returns))
    return 0 if returns is None else 1
