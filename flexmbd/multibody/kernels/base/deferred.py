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

from flexmbd.multibody.kernels.base.entry import EntryKernel
from flexmbd.multibody.kernels.base.kernel_store import Image
from flexmbd.multibody.kernels.base.machine_code import load
from flexmbd.multibody.kernels.base.on_demand import cgutils, intrinsic, ir, types

F = TypeVar("F", bound=Callable[..., Any])

# what deferred kernels return, where they return something: a number's kind, or a tuple of these
FLAG, INTEGER, NUMBER = "boolean", "int64", "float64"
TUPLE2, TUPLE3, TUPLE6, TUPLE9 = ((NUMBER,) * n for n in (2, 3, 6, 9))
WRENCH = (TUPLE3, TUPLE3)  # a torque and a force
INERTIA_AND_WRENCH = (TUPLE6, TUPLE9, TUPLE6, TUPLE3, TUPLE3)

_PREFIX = "flexmbd_deferred."
_BIND = "flexmbd_bind_deferred"
_INTERRUPTED, _FAILED = 1, 2


def deferred_kernel(returns: Any = "none") -> Callable[[F], F]:
    """Compile a kernel, for the kernels that call it, when it is first called; a call costs some nanoseconds more.

    Kernels call it as any other.  ``returns`` is what it returns, which its callers are compiled with.
    """

    def decorate(function: F) -> F:
        name = function.__module__, function.__qualname__
        _kernels[name] = EntryKernel(function), returns

        def typing(typingctx: Any, *arguments: Any) -> Any:
            kinds = tuple(types.unliteral(kind) for kind in arguments)
            # its name can be read without numba, which knows the types
            return _type_of(returns)(*kinds), _caller(pickle.dumps((*name, pickle.dumps(kinds))))

        typing.__name__ = function.__name__
        own = inspect.signature(function)
        context = inspect.Parameter("typingctx", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        typing.__signature__ = own.replace(parameters=[context, *own.parameters.values()])  # type: ignore[attr-defined]
        return intrinsic(typing, text=f"deferred {'.'.join(name)}{own} -> {returns}")  # type: ignore[no-any-return]

    return decorate


def _type_of(returns: Any) -> Any:
    """Numba's type of what a kernel says that it returns."""
    if isinstance(returns, tuple):
        return types.Tuple([_type_of(one) for one in returns])
    return getattr(types, returns)


_kernels: dict[tuple[str, str], tuple[EntryKernel, Any]] = {}


def _caller(what: bytes) -> Callable[..., Any]:
    """Generator of the code of a call of the kernel that ``what`` names."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        slot = _slot(builder.module, _PREFIX + hashlib.sha256(what).hexdigest()[:16])
        address = builder.load(slot)
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, address)):
            text, word = ir.IntType(8).as_pointer(), ir.IntType(64)
            kind = ir.FunctionType(ir.IntType(32), [text, word, word.as_pointer()])
            bind = cgutils.get_or_insert_function(builder.module, kind, _BIND)
            name = context.insert_unique_const(
                builder.module, f"{slot.name}.name", cgutils.make_bytearray(what)
            )
            outcome = builder.call(bind, [builder.bitcast(name, text), word(len(what)), slot])
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
        slot = ir.GlobalVariable(module, ir.IntType(64), name)
        slot.initializer = ir.IntType(64)(0)
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
    return load(compiled_deferred(what))[1]


def compiled_deferred(what: bytes) -> Image:
    """The kernel that these bytes in a caller's code name, compiled or loaded from the cache.

    Raises:
        TypeError: it returns something else than it says.
    """
    module, name, kinds = pickle.loads(what)
    importlib.import_module(module)
    kernel, returns = _kernels[module, name]
    image = kernel.image(hashlib.sha256(kinds).hexdigest(), lambda: pickle.loads(kinds))
    if image.kind != (said := _text(returns)):
        raise TypeError(f"{name} returns {image.kind}, and says that it returns {said}")
    return image


def _text(returns: Any) -> str:
    """As an image has it."""
    return f"({', '.join(map(_text, returns))})" if isinstance(returns, tuple) else str(returns)


llvm.add_symbol(_BIND, ctypes.cast(_bind, ctypes.c_void_p).value)
