"""Kernels as Python calls them: what they take and return, what they raise, and that numba is not there for it."""

from __future__ import annotations

import copy
import enum
import json
import os
import pickle
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import brief_entry_kernel, entry_kernel, kernel


class Place(enum.IntEnum):
    SECOND = 1


@entry_kernel
def gathered(table, row, k, share, is_double, nothing=None):
    factor = 2.0 if is_double else 1.0
    return table[k, 1] * share * factor, (k + row[0], table.shape[0] > 2)


@entry_kernel
def flattened(values):
    total = 0.0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            total = 10.0 * total + values[i, j]
    return total


@entry_kernel
def summed(values, pair):
    return values[0] + pair[0] - pair[1][0]


@entry_kernel
def refused(k):
    if k > 1:
        raise ValueError("k is beyond the table")
    return k


@kernel
def inside(x):
    return x


@brief_entry_kernel
def brief(n):
    if n < 0:
        raise ValueError("n is negative")
    total = 0.0
    for k in range(n):
        total += 1.0 / (1.0 + k * total)
    return total


def test_numbers_arrays_and_tuples_go_in_and_come_out() -> None:
    table, row = np.arange(6.0).reshape(3, 2), np.array([7, 8])
    assert gathered(table, row, 2, 0.5, True) == (5.0, (9, True))
    assert gathered(table[:1], row, k=Place.SECOND - 1, share=np.float64(0.5), is_double=np.False_) == (0.5, (7, False))
    value, (whole, truth) = gathered(table, row, Place.SECOND, 1.0, False, None)
    assert (value, whole, truth) == (3.0, 8, True)
    assert (type(value), type(whole), type(truth)) == (float, int, bool)
    assert summed(np.array([1.0]), (0.25, (4.0, 5.0))) == -2.75
    assert refused(-(2**62)) == -(2**62)


@pytest.mark.parametrize("constant", [False, True])
def test_an_array_is_read_by_its_strides(constant: bool) -> None:
    """Contiguous in either order, every second entry, backwards; also what may not be written to."""
    whole = np.arange(1.0, 9.0).reshape(2, 4)
    whole.flags.writeable = not constant
    for _ in range(2):  # before and after the kernel was called often with the first
        for view in (whole, whole.T, whole[:, ::2], whole[::-1], np.asfortranarray(whole), whole[:, :0]):
            expected = 0.0
            for value in view.ravel():
                expected = 10.0 * expected + value
            assert flattened(view) == expected
        assert {flattened(whole) for _ in range(100)} == {12345678.0}


def test_what_a_kernel_raises_is_raised() -> None:
    assert refused(1) == 1
    with pytest.raises(ValueError, match="k is beyond the table"):
        refused(2)


def test_what_kernels_do_not_take_is_refused() -> None:
    with pytest.raises(TypeError, match=r"kernels take arrays, .* not \[1.0\]"):
        summed([1.0], (0.0, (0.0, 0.0)))
    with pytest.raises(TypeError, match="kernels take arrays"):
        refused(np.float32(1.0))
    with pytest.raises(TypeError, match="missing a required argument: 'pair'"):
        summed(np.zeros(1))  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="inside is called by kernels alone; @entry_kernel gives it a way in"):
        inside(1.0)


@dataclass(frozen=True, eq=False)
class Rows(ArrayStruct):
    table: np.ndarray


@entry_kernel
def mixed(rows, values, pair, k, share, truth, nothing):
    return rows.table[k, 1] + values[0, k] + pair[1] * share, (k, truth), nothing


def test_calls_are_the_same_however_often() -> None:
    """Python reads the arguments of the first calls, machine code those of later ones of the same types."""
    rows, pair = Rows(np.arange(6.0).reshape(3, 2)), (7, 0.5)
    values = np.arange(12.0).reshape(3, 4)
    given = rows, values[:, ::2], pair, 1, 2.0, True, None
    others = [
        (rows, values, pair, 1, 2.0, True, None),
        (rows, values.astype(">f8").astype(float)[:, ::2], pair, 1, np.float64(2.0), True, None),
        (rows, values[:, ::2], pair, Place.SECOND, 2.0, np.True_, None),
        (rows, values[:, ::2], (7, 1), 1, 2, True, None),
    ]
    before = [mixed(*one) for one in (given, *others)]
    assert before[0] == (3.0 + 2.0 + 1.0, (1, True), None)
    held = [sys.getrefcount(one) for one in (*given, None, True)]
    for _ in range(300):
        assert mixed(*given) == before[0]
    assert mixed._quick is not None  # type: ignore[attr-defined]
    assert [sys.getrefcount(one) for one in (*given, None, True)] == held
    assert [mixed(*one) for one in (given, *others)] == before
    assert mixed(*given[:-1], nothing=None) == before[0]
    with pytest.raises(TypeError, match="missing a required argument"):
        mixed(*given[:-1])  # type: ignore[call-arg]
    with pytest.raises(OverflowError):
        mixed(rows, values[:, ::2], pair, 2**63, 2.0, True, None)
    for _ in range(300):
        refused(1)
    with pytest.raises(ValueError, match="k is beyond the table"):
        refused(2)


def test_brief_kernels_let_no_other_thread_in() -> None:
    """Neither as Python reads their arguments nor as machine code does, later; and they raise as all do."""
    n, ran, stop = 1_000_000, [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            ran[0] += 1
            time.sleep(0)  # hands the lock over, as nothing else does for so long an interval

    patience = sys.getswitchinterval()
    sys.setswitchinterval(1e3)
    thread = threading.Thread(target=count)
    thread.start()
    try:
        for _ in range(3):
            for _ in range(40):
                assert brief(0) == 0.0
            before = ran[0]
            found = brief(n)
            assert ran[0] == before
            assert found > 1.0
    finally:
        stop.set()
        thread.join()
        sys.setswitchinterval(patience)
    assert brief._quick is not None  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="n is negative"):
        brief(-1)


def test_a_kernel_is_pickled_by_its_name_and_copied_as_itself() -> None:
    assert pickle.loads(pickle.dumps(refused)) is refused
    assert copy.deepcopy(refused) is refused


RUN = """
import json, sys
if sys.argv[1] == "with":
    import numba
import flexmbd as fm

scene = fm.System(gravity=(0.0, 0.0, -9.81))
first, second = (scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), com=(0.5, 0.0, 0.0))) for _ in range(2))
hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), first.frame())
scene.connect(fm.joint.Revolute("y"), first.frame(p=(1.0, 0.0, 0.0)), second.frame())
scene.add_force(fm.force.JointSpring(hinge, stiffness=1.0))
run = scene.simulate(0.1, rtol=1e-6)
assert ("numba" in sys.modules) == (sys.argv[1] == "with")
print(json.dumps([run.position(second.frame()).tolist(), run.energy().total.tolist()]))
"""


def test_a_run_of_compiled_kernels_asks_for_no_numba(tmp_path: Path) -> None:
    """Deferred kernels are found without it, too, and all give the same to the bit."""
    script = tmp_path / "run.py"
    script.write_text(RUN)

    def numbers(how: str) -> object:
        done = subprocess.run([sys.executable, str(script), how], capture_output=True, text=True, env=dict(os.environ))
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    numbers("with")  # what is not in the cache is compiled
    assert numbers("with") == numbers("without")


PLAIN = """
import sys
import numpy as np
import test_entries as kernels
from flexmbd.multibody.kernels.base import pipeline

if sys.argv[1] == "a pass that is gone":
    pipeline._TO_LLVM = (*pipeline._TO_LLVM, (pipeline.typed_passes, "NoSuchPass"))
asked = []
own = pipeline.DefaultPassBuilder.define_nopython_pipeline
pipeline.DefaultPassBuilder.define_nopython_pipeline = lambda *given: asked.append(1) or own(*given)
print(kernels.weighed(np.array([[1.0, 2.0], [3.0, 4.0]]), 0.5), bool(asked))
"""


@kernel
def weight(x, share):
    return share * np.sqrt(x)


@entry_kernel
def weighed(values, share):
    total = 0.0
    for row in values:
        for x in row:
            total += weight(x, share)
    return total


@pytest.mark.parametrize("why", ["asked for", "a pass that is gone", "none"])
def test_numba_s_own_passes_serve_as_well(why: str, tmp_path: Path) -> None:
    environment = {name: one for name, one in os.environ.items() if name != "FLEXMBD_PLAIN_NUMBA"}
    environment |= {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parent)}
    if why == "asked for":
        environment["FLEXMBD_PLAIN_NUMBA"] = "1"
    command = [sys.executable, "-c", PLAIN, why]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    number, asked = done.stdout.split()
    assert abs(float(number) - 0.5 * (1.0 + 2.0**0.5 + 3.0**0.5 + 2.0)) < 1e-15 * 8
    assert asked == str(why != "none")
