"""Warnings reach whoever runs a script, whatever DOLFINx's form compiler does to them."""

import subprocess
import sys

import pytest

HELLO = "import warnings\nwarnings.warn('hello')\n"


def stderr_of(script):
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd="/", check=True)
    return done.stderr


@pytest.mark.parametrize("before", ["", "import ffcx\n"])
def test_warnings_are_shown_beside_dolfinx(before):
    assert "hello" not in stderr_of("import ffcx\n" + HELLO)  # else nothing is to be mended any more
    assert "UserWarning: hello" in stderr_of(before + "import flexmbd.continuum\n" + HELLO)


def test_who_asked_for_a_log_keeps_it():
    script = "import logging\nlogging.captureWarnings(True)\nlogging.basicConfig(format='log: %(message)s')\n"
    for load in ("", "import ffcx\n"):
        assert "log: " in stderr_of(script + load + "import flexmbd.continuum\n" + HELLO)
