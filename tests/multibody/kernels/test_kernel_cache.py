"""Kernels in the cache: an entry that is damaged, cut short or another one's counts as absent and is written anew."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmbd.multibody.kernels.base import compiling

PACKAGE = Path(compiling.__file__).parents[3]

# Two quaternions' product and one's exponential, and whether their machine code came from the cache.
CALLS = """
import json
from flexmbd.multibody.kernels.algebra import so3
from flexmbd.multibody.kernels.base.kernel_store import _written as written

product = so3.quaternion_product((0.6, 0.8, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0))
turn = so3.quaternion_exp((0.2, 0.0, 0.0))
compiled = [name for name in written if name.endswith(".kernel")]
names = "so3.quaternion_product-", "so3.quaternion_exp-"
hits = [int(not any(name.startswith(one) for name in compiled)) for one in names]
print(json.dumps([product, turn, hits]))
"""


def call(cache: Path) -> list[int]:
    """What two kernels give in a fresh process, asserted; how often each was found in the cache."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run([sys.executable, "-c", CALLS], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    product, turn, hits = json.loads(done.stdout)
    np.testing.assert_allclose(product, [0.36, 0.48, 0.48, 0.64], rtol=1e-15)
    np.testing.assert_allclose(turn, [np.cos(0.1), np.sin(0.1), 0.0, 0.0], rtol=1e-15)
    return list(hits)


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that holds both kernels."""
    cache = tmp_path_factory.mktemp("kernels")
    assert call(cache) == [0, 0]
    assert call(cache) == [1, 1]
    return cache


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def empty(path: Path) -> None:
    os.truncate(path, 0)


def flip(path: Path) -> None:
    """One bit of what it holds, as a bad disk would: pickles and machine code with it may load."""
    content = bytearray(path.read_bytes())
    content[2 * len(content) // 3] ^= 1
    path.write_bytes(content)


def scribble(path: Path) -> None:
    path.write_bytes(np.random.default_rng(1).bytes(path.stat().st_size))


def exchange(path: Path) -> None:
    """The file of the other kernel in its place."""
    (donor,) = path.parent.glob("so3.quaternion_exp-*.kernel")
    shutil.copyfile(donor, path)


@pytest.mark.parametrize("damage", [cut, empty, flip, scribble, exchange, os.unlink])
def test_a_damaged_entry_is_compiled_and_written_anew(
    filled: Path, tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    cache = tmp_path / "kernels"
    shutil.copytree(filled, cache)
    (entry,) = cache.rglob("so3.quaternion_product-*.kernel")
    damage(entry)
    assert call(cache) == [0, 1]  # the other kernel's entry is found
    assert call(cache) == [1, 1]


def test_entries_of_other_sources_are_not_taken(filled: Path, tmp_path: Path) -> None:
    """An entry under the name of another version's, as a copied cache may have it."""
    cache = tmp_path / "kernels"
    shutil.copytree(PACKAGE, tmp_path / "flexmbd", symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    changed = tmp_path / "flexmbd" / "multibody" / "kernels" / "algebra" / "so3.py"
    text = changed.read_text()
    assert "def quaternion_product(p, q):" in text
    changed.write_text(text.replace("def quaternion_product(p, q):", "def quaternion_product(p, q, w=1):"))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}

    def hits() -> list[int]:
        done = subprocess.run(
            [sys.executable, "-c", CALLS], capture_output=True, text=True, check=True, cwd=tmp_path, env=environment
        )
        return list(json.loads(done.stdout)[2])

    assert hits() == [0, 0]
    (ours,) = filled.rglob("so3.quaternion_product-*.kernel")
    (theirs,) = (path for path in cache.rglob("so3.quaternion_product-*.kernel") if path.name != ours.name)
    shutil.copyfile(ours, theirs)
    assert hits() == [0, 1]
    assert hits() == [1, 1]


# A kernel that is given named numbers, and one that it calls.
NAMED = """
import sys
from typing import NamedTuple
import numpy as np
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

class Parts(NamedTuple):
    {fields}

@kernel
def write(parts):
    parts.first[0] = 1.0

@entry_kernel
def enter(parts):
    write(parts)
    parts.last[0] = 2.0

parts = Parts(**dict((name, np.zeros(1)) for name in Parts._fields))
enter(parts)
assert (parts.first[0], parts.last[0]) == (1.0, 2.0), parts
"""


def test_named_numbers_in_another_order_are_other_arguments(tmp_path: Path) -> None:
    """As a later version may have them: machine code of the old order would write into the wrong array."""
    fields = "first: np.ndarray", "middle: np.ndarray", "last: np.ndarray"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    for order in (fields, fields[::-1], (fields[1], fields[0], fields[2])):
        (tmp_path / "named.py").write_text(NAMED.format(fields="\n    ".join(order)))
        done = subprocess.run(
            [sys.executable, "-B", "-c", "import named"], capture_output=True, text=True, cwd=tmp_path, env=environment
        )
        assert done.returncode == 0, done.stderr
