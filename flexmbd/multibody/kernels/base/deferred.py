"""Kernels that are compiled when a machine first needs them: modes, loops, force elements, and other less common ways.

A call of one is a call through an address that stands in the caller's own code and is empty at first.  An empty one is
filled by ``_bind``, which looks the kernel up by its name and compiles it, or loads it from the cache; so nobody has to
know beforehand what a machine will need, and what it does not need is never compiled.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import inspect
import pickle
import sys
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from flexmbd.multibody.kernels.base.compiling import separate_kernel
from flexmbd.multibody.kernels.base.kernel_stamp import stands_for

F = TypeVar("F", bound=Callable[..., Any])

# what deferred kernels return, where they return something
FLAG, INTEGER, NUMBER = types.boolean, types.int64, types.float64
TUPLE2, TUPLE3, TUPLE6, TUPLE9 = (types.UniTuple(types.float64, n) for n in (2, 3, 6, 9))
WRENCH = types.Tuple((TUPLE3, TUPLE3))  # a torque and a force
INERTIA_AND_WRENCH = types.Tuple((TUPLE6, TUPLE9, TUPLE6, TUPLE3, TUPLE3))

_PREFIX = "flexmbd_deferred."
_BIND = "flexmbd_bind_deferred"
_INTERRUPTED, _FAILED = 1, 2
_BYTES, _ADDRESS = ir.IntType(8).as_pointer(), ir.IntType(64)


def deferred_kernel(returns: types.Type = types.none) -> Callable[[F], F]:
    """Compile a kernel, for the kernels that call it, when it is first called; a call costs some nanoseconds more.

    Kernels call it as any other.  ``returns`` is what it returns, which its callers are compiled with.
    """

    def decorate(function: F) -> F:
        name = function.__module__, function.__qualname__
        _kernels[name] = separate_kernel(function), returns

        def typing(typingctx: Any, *arguments: types.Type) -> Any:
            kinds = tuple(types.unliteral(kind) for kind in arguments)
            return returns(*kinds), _caller(pickle.dumps((*name, kinds)))

        typing.__name__ = function.__name__
        own = inspect.signature(function)
        context = inspect.Parameter("typingctx", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        typing.__signature__ = own.replace(parameters=[context, *own.parameters.values()])  # type: ignore[attr-defined]
        caller = intrinsic(typing)
        stands_for(caller, f"deferred {'.'.join(name)}{own} -> {returns}")
        return caller

    return decorate


_kernels: dict[tuple[str, str], tuple[Any, types.Type]] = {}


def _caller(what: bytes) -> Callable[..., Any]:
    """Generator of the code of a call of the kernel that ``what`` names."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        slot = _slot(builder.module, _PREFIX + hashlib.sha256(what).hexdigest()[:16])
        address = builder.load(slot)
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, address)):
            kind = ir.FunctionType(ir.IntType(32), [_BYTES, _ADDRESS, _ADDRESS.as_pointer()])
            bind = cgutils.get_or_insert_function(builder.module, kind, _BIND)
            name = context.insert_unique_const(
                builder.module, f"{slot.name}.name", cgutils.make_bytearray(what)
            )
            outcome = builder.call(bind, [builder.bitcast(name, _BYTES), _ADDRESS(len(what)), slot])
            with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(slot))):
                interrupted = builder.icmp_signed("==", outcome, ir.IntType(32)(_INTERRUPTED))
                with builder.if_then(interrupted):
                    context.call_conv.return_user_exc(builder, KeyboardInterrupt, ())
                context.call_conv.return_user_exc(builder, RuntimeError, ("a kernel could not be compiled",))
        kinds = signature.args
        function = ir.PointerType(context.call_conv.get_function_type(signature.return_type, kinds))
        function = builder.inttoptr(builder.load(slot), function)
        status, value = context.call_conv.call_function(builder, function, signature.return_type, kinds, arguments)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value() if signature.return_type == types.none else value

    return codegen


def _slot(module: Any, name: str) -> Any:
    """The variable of a module that holds a kernel's address; modules that become one share it."""
    slot = module.globals.get(name)
    if slot is None:
        slot = ir.GlobalVariable(module, _ADDRESS, name)
        slot.initializer = _ADDRESS(0)
        slot.linkage = "linkonce_odr"
    return slot


@ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64, ctypes.POINTER(ctypes.c_int64))
def _bind(place: int, size: int, slot: Any) -> int:
    """Write the address of the kernel that ``size`` bytes at ``place`` name into ``slot``."""
    try:
        slot[0] = _address(ctypes.string_at(place, size))
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BaseException:  # there is no way for it through the kernels
        traceback.print_exc(file=sys.stderr)
        return _FAILED
    return 0


def _address(what: bytes) -> int:
    compiled = compiled_deferred(what)
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def compiled_deferred(what: bytes) -> Any:
    """What numba made of the kernel that these bytes in a caller's code name, compiled or loaded from the cache.

    Raises:
        TypeError: it returns something else than it says.
    """
    module, name, kinds = pickle.loads(what)
    importlib.import_module(module)
    kernel, returns = _kernels[module, name]
    kernel.compile(kinds)
    compiled = kernel.overloads[kinds]
    if compiled.signature.return_type != returns:
        raise TypeError(f"{name} returns {compiled.signature.return_type}, and says that it returns {returns}")
    return compiled


llvm.add_symbol(_BIND, ctypes.cast(_bind, ctypes.c_void_p).value)
