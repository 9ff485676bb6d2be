"""Which compiler makes forms, and what is said where there is none."""

import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from flexmbd.files.form_compiler import choose_compiler, form_compiler, lacking_for_forms

COMPILE = """
from mpi4py import MPI
from flexmbd.continuum import compat
import dolfinx, ufl
mesh = dolfinx.mesh.create_unit_interval(MPI.COMM_WORLD, 2)
try:
    form = dolfinx.fem.form(dolfinx.fem.Constant(mesh, 3.0) * ufl.dx(domain=mesh))
except ImportError as error:
    print(type(error).__name__, str(error), sep=": ")
else:
    print(f"{dolfinx.fem.assemble_scalar(form):.6f}")
"""


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A folder that is the whole PATH; Python names a compiler that is not there."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    asked = sysconfig.get_config_var
    own = "x86_64-gcc -pthread"
    monkeypatch.setattr(sysconfig, "get_config_var", lambda name: own if name == "CC" else asked(name))
    return tmp_path


def install(folder, name):
    (folder / name).write_text("#!/bin/sh\n")
    (folder / name).chmod(0o755)


def test_python_s_own_compiler_stays(bench):
    for name in ("gcc", "x86_64-gcc"):
        install(bench, name)
    choose_compiler()
    assert form_compiler() == "x86_64-gcc -pthread"
    assert "CC" not in os.environ


@pytest.mark.parametrize("name", ["gcc", "cc", "clang"])
def test_another_that_is_there_is_named(bench, name):
    install(bench, name)
    choose_compiler()
    assert os.environ["CC"] == name


def test_ziglang_serves_where_there_is_none(bench, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "ziglang" or None)
    choose_compiler()
    assert os.environ["CC"] == f"{sys.executable} -m ziglang cc"


def test_what_the_user_names_is_taken_or_missed(bench, monkeypatch):
    install(bench, "gcc")
    monkeypatch.setenv("CC", "mycc -O3")
    choose_compiler()
    assert os.environ["CC"] == "mycc -O3"
    assert "by mycc -O3, as CC says, which is not on the PATH" in lacking_for_forms()
    install(bench, "mycc")
    assert lacking_for_forms() == ""


def test_headers_that_are_not_there(bench, monkeypatch):
    install(bench, "gcc")
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(bench))
    assert f"there is no {bench}/Python.h: install them (apt install python3-dev" in lacking_for_forms()
    (bench / "Python.h").touch()
    assert lacking_for_forms() == ""


def compiled(cache: Path, path: str) -> str:
    around = {name: value for name, value in os.environ.items() if name != "CC"} | {
        "PATH": path,
        "XDG_CACHE_HOME": str(cache),
    }
    done = subprocess.run([sys.executable, "-c", COMPILE], capture_output=True, text=True, env=around, check=True)
    return done.stdout.strip()


def test_a_new_form_says_what_is_lacking_and_one_compiled_before_needs_nothing(tmp_path):
    (tmp_path / "empty").mkdir()
    said = compiled(tmp_path / "cache", str(tmp_path / "empty"))
    assert said.startswith("MissingLibraryError: forms are compiled by a C compiler, and there is none on the PATH")
    assert compiled(tmp_path / "cache", os.environ["PATH"]) == "3.000000"
    assert compiled(tmp_path / "cache", str(tmp_path / "empty")) == "3.000000"
