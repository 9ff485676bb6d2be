"""What needs more memory than there is ends in one error that says what wanted it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import OutOfMemoryError, memory_told
from flexmbd.files.memory import available_memory
from flexmbd.given import checked

_SWARM = """
import resource
import flexmbd as fm
from flexmbd.files.memory import available_memory

def swarm(n):
    scene = fm.System(gravity=(0, -9.81, 0))
    for k in range(n):
        body = scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.02), (0.05, 0.0, 0.0)), name=f"body {k}")
        scene.connect(fm.joint.Revolute("z"), scene.ground.frame((float(k), 0.0, 0.0)), body.frame())
    return scene

swarm(2).simulate(1e-2, h=1e-3, integrator=fm.GeneralizedAlpha())
pages = int(open("/proc/self/statm").read().split()[0])
most = pages * resource.getpagesize() + 2**27
resource.setrlimit(resource.RLIMIT_AS, (most, most))
assert available_memory() <= 2**27
try:
    swarm(6000).simulate(1e-2, h=1e-3, integrator=fm.GeneralizedAlpha())
except fm.OutOfMemoryError as error:
    print(error)
"""


def test_what_a_process_has_no_room_for_is_told():
    """6000 velocities: 197 MB for a thousand rows of all of them, where 128 MB are left."""
    done = subprocess.run([sys.executable, "-c", _SWARM], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "of 6000 velocities: there is no memory for it" in done.stdout


def test_a_public_call_says_what_wanted_the_memory():
    @checked()
    def ask(n: int) -> None:
        np.empty(n)

    with pytest.raises(OutOfMemoryError, match=r"ask: there is no memory for it: Unable to allocate") as caught:
        ask(2**58)
    assert isinstance(caught.value, MemoryError | fm.FlexmbdError)
    with pytest.raises(OutOfMemoryError, match=r"^inner"), memory_told("outer"), memory_told("inner"):
        np.empty(2**58)


def test_what_is_left_is_a_number_of_bytes():
    left = available_memory()
    assert left is None or left > 2**20
