"""Runs of bodies that yield that were killed, and go on from their last checkpoint; and on other ranks."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from half_way import TIMES, bar, run

import flexmbd as fm
from flexmbd.continuum import ExplicitRun, RegularCheckpoints, RigidPlane
from flexmbd.continuum.history.history_file import load_body, save_body
from flexmbd.errors import RecordError, SceneError
from flexmbd.forms import hencky_plasticity

SCRIPT = Path(__file__).parents[1] / "helpers" / "half_way.py"
WORLD = MPI.COMM_WORLD


def killed(kind, file):
    """Run on as many ranks as here until it is killed. Collective."""
    code = None
    if WORLD.rank == 0:
        ranks = [] if WORLD.size == 1 else ["mpirun", "-n", str(WORLD.size)]
        # that program is not part of this one's ranks
        outside = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_COMM", "PMIX_"))}
        command = [*ranks, sys.executable, str(SCRIPT), kind, str(file)]
        code = subprocess.run(command, env=outside, capture_output=True, timeout=200).returncode
    return WORLD.bcast(code)


def check_same(found, expected, *, exactly):
    """To the bit, or to 1e-9 of the largest number."""
    assert set(found) == set(expected)
    for name, there in expected.items():
        if exactly:
            np.testing.assert_array_equal(found[name], there, err_msg=name)
        else:
            off = abs(np.asarray(found[name]) - there).max(initial=0.0)
            assert off <= 1e-9 * abs(np.asarray(there)).max(initial=0.0), name


@pytest.mark.mpi
@pytest.mark.parametrize("kind", TIMES)
def test_a_killed_run_goes_on_to_the_same_end(kind, shared_path):
    """To the bit on one rank; on several to 1e-9 of what one does that was not killed."""
    file, t_end = shared_path / "run.npz", TIMES[kind][0]
    assert killed(kind, file) in (-signal.SIGKILL, 128 + signal.SIGKILL)
    with np.load(file) as kept:
        t = {"alone": "times", "static": "t"}.get(kind)
        t = fm.Checkpoint.load(file).t if t is None else kept[t].reshape(-1)[0]
    assert 0.2 * t_end < t < 0.8 * t_end
    WORLD.barrier()
    found = run(kind, WORLD, file, restart=True)
    expected = run(kind, MPI.COMM_SELF, shared_path / f"whole{WORLD.rank}.npz")
    check_same(found, expected, exactly=WORLD.size == 1)
    assert found["plastic"] > 1e-3 * found.get("kinetic", found["elastic"])
    assert found.get("contact", 1.0) != 0.0


@pytest.mark.mpi
@pytest.mark.parametrize("kind", TIMES)
def test_what_one_rank_kept_all_go_on_with_and_the_other_way_round(kind, shared_path):
    if WORLD.size == 1:
        return  # there is no other number of ranks
    mine, ours = shared_path / f"one{WORLD.rank}.npz", shared_path / "all.npz"
    expected = run(kind, MPI.COMM_SELF, mine)
    run(kind, WORLD, ours)
    WORLD.barrier()
    found = run(kind, MPI.COMM_SELF, ours, restart=True) if WORLD.rank == 0 else expected
    check_same(found, expected, exactly=False)
    WORLD.barrier()
    check_same(run(kind, WORLD, shared_path / "one0.npz", restart=True), expected, exactly=False)


def test_bad_input(tmp_path):
    file = tmp_path / "run.npz"
    wall = RigidPlane((-0.52, 0.0, 0.0), (1.0, 0.0, 0.0))
    one = ExplicitRun(bar(hencky_plasticity, MPI.COMM_SELF), planes=[wall])
    with pytest.raises(SceneError, match="every 0"):
        RegularCheckpoints(file, 0.0)
    with pytest.raises(RecordError, match="not a checkpoint that can be read"):
        one.simulate(0.01, restart=file)
    account = one.simulate(0.01, checkpoints=RegularCheckpoints(file, 0.01))
    assert list(tmp_path.iterdir()) == [file]
    # killed after its last step
    again = ExplicitRun(bar(hencky_plasticity, MPI.COMM_SELF), planes=[wall]).simulate(0.01, restart=file)
    assert again.rows == account.rows
    with pytest.raises(SceneError, match="made by another run"):
        ExplicitRun(bar(hencky_plasticity, MPI.COMM_SELF)).simulate(0.02, restart=file)
    body = bar(hencky_plasticity, MPI.COMM_SELF)
    with pytest.raises(RecordError, match="holds no body with history"):
        load_body(body, file)
    save_body(body, tmp_path / "body.npz", t=0.5)
    assert load_body(body, tmp_path / "body.npz") == 0.5
    with pytest.raises(SceneError, match="of another body"):
        load_body(bar(hencky_plasticity, MPI.COMM_SELF, yield_stress=2e4), tmp_path / "body.npz")
    with pytest.raises(RecordError, match="not a checkpoint of a body that runs by itself"):
        one.simulate(0.03, restart=tmp_path / "body.npz")
    np.savez(tmp_path / "other.npz", version=9)
    with pytest.raises(RecordError, match="not a checkpoint of a machine"):
        fm.Checkpoint.load(tmp_path / "other.npz")
    with pytest.raises(RecordError, match="cannot be written"):
        one.simulate(0.02, checkpoints=RegularCheckpoints(tmp_path / "no folder" / "run.npz", 0.005))
