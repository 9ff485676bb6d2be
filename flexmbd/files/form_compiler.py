"""The C compiler by which FFCx makes forms: Python's own, else another that is there, else what to install.

cffi takes the compiler that Python itself was built with, unless CC names one; a Python from elsewhere may name one
that this computer does not have.
"""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

#: Those that are looked for, the first first.
_COMPILERS = ("gcc", "cc", "clang")


def choose_compiler() -> None:
    """Name another compiler by CC where Python's own is not there; not collective.

    Nothing changes where CC names one already, or where there is none.
    """
    compiler = form_compiler()
    if compiler and not os.environ.get("CC") and compiler != _of_python():
        os.environ["CC"] = compiler


def form_compiler() -> str:
    """The command that compiles forms; empty where there is none. Not collective.

    The one that CC names; without CC that of Python, gcc, cc, clang, or that of the package ziglang.
    """
    named = os.environ.get("CC")
    for command in (named,) if named else (_of_python(), *_COMPILERS):
        if shutil.which(next(iter(shlex.split(command)), "")):
            return command
    if named or importlib.util.find_spec("ziglang") is None:
        return ""
    return shlex.join([sys.executable, "-m", "ziglang", "cc"])


def lacking_for_forms() -> str:
    """The tool missing for compiling a new form, with the remedy; empty: none. Not collective."""
    if not form_compiler():
        if named := os.environ.get("CC"):
            return f"forms are compiled by {named}, as CC says, which is not on the PATH"
        return (
            "forms are compiled by a C compiler, and there is none on the PATH: install gcc (apt install gcc), or "
            "ziglang (pip install ziglang)"
        )
    folder = sysconfig.get_path("include")
    if not Path(folder, "Python.h").is_file():
        return (
            f"forms are compiled with Python's headers, and there is no {folder}/Python.h: install them (apt install "
            "python3-dev, dnf install python3-devel)"
        )
    return ""


def _of_python() -> str:
    return sysconfig.get_config_var("CC") or ""
