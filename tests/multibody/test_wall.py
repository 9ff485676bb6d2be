"""A rigid scene runs in a fresh process without the continuum side, pictures or plots."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import types

from flexmbd.multibody.kernels.algebra import so3
from flexmbd.multibody.kernels.base import compiling

SCENE = """
import sys
from pathlib import Path
import flexmbd as fm

scene = fm.System(gravity=(0.0, -9.81, 0.0))
arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.5, 0.0, 0.0)), name="arm")
scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
run = scene.simulate(0.1)
assert run.t[-1] == 0.1 and run.position(arm.frame(p=(1, 0, 0))).shape == (len(run.t), 3)
run.energy(), scene.explain()
loaded = set(sys.modules) - {"numba._helperlib"}  # functions in C that kernels call, without the package around them
print("loaded:", *sorted({name.split(".")[0] for name in loaded}))
"""

BEYOND_THE_WALL = {
    "dolfinx", "petsc4py", "slepc4py", "mpi4py", "ufl", "basix", "gmsh", "pyvista", "vtkmodules",
    "matplotlib", "h5py", "tqdm",
}  # fmt: skip


def test_a_rigid_scene_loads_only_numpy_scipy_llvmlite():
    """And numba where something is to be compiled, as in a first process may be."""
    for beyond in (BEYOND_THE_WALL, {*BEYOND_THE_WALL, "numba"}):
        done = subprocess.run([sys.executable, "-c", SCENE], capture_output=True, text=True, check=True)
        loaded = set(done.stdout.split("loaded:")[1].split())
        assert {"flexmbd", "numpy", "scipy", "llvmlite"} <= loaded
        assert not loaded & beyond


def test_compilation_is_announced_before_it_begins(tmp_path):
    """A process with an empty cache says what it compiles for, at once."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", SCENE], stderr=subprocess.PIPE, text=True, env=environment) as process:
        said = process.stderr.readline()
        process.kill()
    assert said.startswith("flexmbd: compiling the kernels of the start, once for this machine")
    assert str(tmp_path) in said


def test_what_is_compiled_is_not_announced_again():
    said = [
        subprocess.run([sys.executable, "-c", SCENE], capture_output=True, text=True, check=True).stderr for _ in "12"
    ]
    assert said[1] == ""


def test_each_purpose_is_announced_until_it_is_compiled(tmp_path):
    """Once in a process, again in the next one, and not where it has been compiled to the end."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    compiling_twice = (
        "from flexmbd.multibody.kernels.base.compiling import announce_compilation, mark_compiled\n"
        "print(announce_compilation('a'), announce_compilation('a'), announce_compilation('b'))\nmark_compiled('b')"
    )
    said = [
        subprocess.run(
            [sys.executable, "-c", compiling_twice], capture_output=True, text=True, check=True, env=environment
        ).stdout
        for _ in range(2)
    ]
    assert said == ["True False True\n", "True False False\n"]


def test_a_kernel_without_a_way_in_refuses_python():
    """Python would step to the address 0 otherwise; being compiled for other kernels opens no way either."""
    for _ in range(2):
        with pytest.raises(TypeError, match="scale3 is called by kernels alone"):
            so3.scale3(2.0, (1.0, 2.0, 3.0))
        so3.scale3._translated.compile((types.float64, types.UniTuple(types.float64, 3)))  # type: ignore[attr-defined]


def test_kernels_of_equal_sources_are_shared(tmp_path):
    """Another installation of the same sources finds what this one compiled."""
    package = Path(compiling.__file__).parents[3]
    shutil.copytree(package, tmp_path / "flexmbd", symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    place = (
        "from flexmbd.multibody.kernels.algebra import so3\nfrom flexmbd.multibody.kernels.base import kernel_store\n"
        "known = kernel_store.stamp(so3.rotation_vector.py_func, so3.rotation_vector.entry_options)\n"
        "print(so3.__file__, *kernel_store.place_of(so3.rotation_vector.py_func, known))"
    )
    here, there = (
        subprocess.run(
            [sys.executable, "-c", place], capture_output=True, text=True, check=True, cwd=folder
        ).stdout.split()
        for folder in (package.parent, tmp_path)
    )
    assert Path(there[0]).is_relative_to(tmp_path)
    assert here[0] != there[0]
    assert here[1:] == there[1:]
