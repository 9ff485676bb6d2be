"""Stamps of kernels: every change that reaches a kernel's machine code changes its stamp, and no other does."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flexmbd.multibody.kernels.base.kernel_stamp import stamp

CONSTANTS = '"""Columns."""\n\nFIRST = 0\nSECOND = 1\n'
CALLED = '''
"""Kernels that others call."""

import enum
import numpy as np
from llvmlite import ir
from numba import types
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, summing_kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.base.on_demand import intrinsic

WEIGHTS = np.array([1.0, 2.0])
PAIR = (3.0, (4, 5))


class Side(enum.IntEnum):
    LEFT = 1


def _number():
    return 7.0


@intrinsic
def seven(typingctx):
    def codegen(context, builder, signature, args):
        return ir.Constant(ir.DoubleType(), _number())

    return types.float64(), codegen


@kernel
def inner(x):
    """Doubles."""
    return 2.0 * x


@kernel
def tripled(x):
    return 3.0 * x


@entry_kernel
def entered(x):
    return inner(x) + 1.0


@deferred_kernel(NUMBER)
def behind(x):
    return inner(x) + 3.0
'''
CALLING = '''
import math
import called_kernels as other
import constant_kernels as at
from called_kernels import PAIR, WEIGHTS, Side, behind, entered, seven
from flexmbd.multibody.kernels.base.by_kind import by_kind
from flexmbd.multibody.kernels.base.compiling import kernel

_picked = by_kind({2: other.tripled})


@kernel
def by_number(x):
    return _picked(2, (x,))


@kernel
def root(values, k=1):
    return entered(values[at.FIRST]) + behind(values[0]) + PAIR[0] * WEIGHTS[1] + seven() + Side.LEFT + k


@kernel
def through_module(x):
    return other.inner(x) + math.sin(x)


@kernel
def alone(x):
    return x + 1.0
'''
NAMES = ("by_number", "root", "through_module", "alone")


@pytest.fixture
def stamps(tmp_path: Path) -> Iterator[Callable[..., dict[str, str]]]:
    """Gives the stamps of the three kernels of CALLING with some text of the three files replaced."""
    modules = {"constant_kernels": CONSTANTS, "called_kernels": CALLED, "calling_kernels": CALLING}
    count = 0

    def found(old: str = "", new: str = "") -> dict[str, str]:
        nonlocal count
        count += 1
        assert any(old in text for text in modules.values())
        for name, text in modules.items():
            path = tmp_path / f"{name}{count}.py"
            path.write_text(text.replace(old, new) if old else text)
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None
            assert spec.loader is not None
            sys.modules[name] = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])
        calling = sys.modules["calling_kernels"]
        return {name: stamp(vars(calling)[name].py_func, vars(calling)[name].options) for name in NAMES}

    yield found
    for name in modules:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("return 2.0 * x", "return 2.5 * x", {"root", "through_module"}),
        ("inner(x) + 1.0", "inner(x) + 1.5", {"root"}),
        ("return 7.0", "return 7.5", {"root"}),
        ("ir.Constant(ir.DoubleType()", "ir.Constant(ir.FloatType()", {"root"}),
        ("FIRST = 0", "FIRST = 1", {"root"}),
        ("(3.0, (4, 5))", "(3.0, (4, 6))", {"root"}),
        ("[1.0, 2.0]", "[1.0, 2.5]", {"root"}),
        ("LEFT = 1", "LEFT = 2", {"root"}),
        ("k=1", "k=2", {"root"}),
        ("math.sin(x)", "math.cos(x)", {"through_module"}),
        ("@kernel\ndef inner", "@summing_kernel\ndef inner", {"root", "through_module"}),
        ("@deferred_kernel(NUMBER)\ndef behind(x)", "@deferred_kernel(NUMBER)\ndef behind(x, y=0)", {"root"}),
        ("@deferred_kernel(NUMBER)\ndef behind", "@deferred_kernel()\ndef behind", {"root"}),
        ("return x + 1.0", "return x - 1.0", {"alone"}),
        ("return 3.0 * x", "return 3.5 * x", {"by_number"}),
        ("{2: other.tripled}", "{4: other.tripled}", {"by_number"}),
        # what reaches no machine code
        ("inner(x) + 3.0", "inner(x) + 3.5", set()),
        ("SECOND = 1", "SECOND = 2", set()),
        ("Doubles.", "Twice.", set()),
        ("@kernel\ndef alone", "# a comment, and lines further down\n\n\n@kernel\ndef alone", set()),
    ],
)
def test_stamps_follow_what_becomes_machine_code(
    stamps: Callable[..., dict[str, str]], old: str, new: str, changed: set[str]
) -> None:
    before = stamps()
    assert stamps() == before
    after = stamps(old, new)
    assert {name for name in NAMES if after[name] != before[name]} == changed
