"""A record that goes to its file from all ranks: the file that `ReducedBody.save` makes, whole or not at all."""

import os
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, parallel
from flexmbd.errors import RecordError
from flexmbd.record.groups import NodalModes
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import Keep, craig_bampton, guyan, record_stream, spread_groups
from flexmbd.reduction.spread_groups import SpreadGroup, SpreadRows

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
STEEL = forms.solid_linear.Parameters(E=2.0e11, nu=0.3, rho=7850.0)
ALL = Keep(modes=True, surface=True, stress=True)


@pytest.fixture
def folder(tmp_path):
    return parallel.on_root(COMM, lambda: tmp_path)


@pytest.fixture
def small_pieces(monkeypatch):
    """A piece is a few rows."""
    monkeypatch.setattr(spread_groups, "_PIECE", 1000)


def bar_of(comm, form=forms.solid_linear, parameters=STEEL):
    mesh = meshes.block(0.4, 0.1, 0.1, divisions=(4, 1, 1), comm=comm)
    ends = [Interface("x_min"), Interface("x_max")]
    return ContinuumModel(mesh, form, parameters, degree=2, interfaces=ends)


@cache
def bar():
    return bar_of(COMM)


def in_folder(folder):
    return parallel.on_root(COMM, lambda: sorted(path.name for path in folder.iterdir()))


@pytest.mark.usefixtures("small_pieces")
def test_the_file_is_the_one_that_save_makes(folder, monkeypatch):
    """To the byte, of the same groups; what is returned is the record without them."""
    seen = {}

    def both(comm, path, body, groups):
        record_stream.write_record(comm, path, body, groups)
        whole = {name: group.whole() for name, group in groups.items()}
        parallel.on_root(comm, lambda: replace(body, **whole).save(folder / "saved.h5"))
        seen.update(whole)

    monkeypatch.setattr("flexmbd.reduction.projection.write_record", both)
    body = craig_bampton(bar(), modes=3, frame="x_min", keep=ALL, stream=folder / "rod.h5")
    assert sorted(seen) == ["modes", "stress", "surface"]
    assert parallel.on_root(COMM, (folder / "rod.h5").read_bytes) == parallel.on_root(
        COMM, (folder / "saved.h5").read_bytes
    )
    assert body.modes is body.stress is body.surface is None
    loaded = ReducedBody.load(folder / "rod.h5")
    assert loaded.fingerprint() == body.fingerprint()
    assert loaded.provenance == body.provenance
    assert in_folder(folder) == ["rod.h5", "saved.h5"]


def test_it_holds_what_one_process_finds(folder):
    craig_bampton(bar(), modes=3, frame="x_min", keep=ALL, stream=str(folder / "rod.h5"))
    body = ReducedBody.load(folder / "rod.h5")
    alone = craig_bampton(bar_of(MPI.COMM_SELF), modes=3, frame="x_min", keep=ALL)
    for group, rows in (("modes", "phi"), ("surface", "phi"), ("stress", "sigma")):
        found, expected = getattr(body, group), getattr(alone, group)
        for name in ("node", "triangle", "interface"):
            if hasattr(found, name):
                assert np.array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_allclose(found.x, expected.x, rtol=0.0, atol=1e-15)  # the frame's origin is a sum over ranks
        values = getattr(expected, rows)
        np.testing.assert_allclose(getattr(found, rows), values, rtol=0.0, atol=1e-8 * abs(values).max())


def test_further_unknowns_and_guyan(folder):
    rubber = forms.solid_mixed.Parameters(E=1e6, nu=0.4999, rho=1000.0)
    model, keep = bar_of(COMM, forms.solid_mixed, rubber), Keep(modes=True)
    body = guyan(model, frame="x_min", keep=keep, stream=folder / "a.h5")
    loaded = ReducedBody.load(folder / "a.h5")
    assert body.unknowns is None
    alone = guyan(bar_of(MPI.COMM_SELF, forms.solid_mixed, rubber), frame="x_min", keep=keep).unknowns
    assert loaded.unknowns is not None
    assert alone is not None
    assert np.array_equal(loaded.unknowns.dof, alone.dof)
    np.testing.assert_allclose(loaded.unknowns.phi, alone.phi, rtol=0.0, atol=1e-7 * abs(alone.phi).max())


@pytest.mark.parametrize(("where", "why"), [("nowhere/a.h5", "there is no folder"), ("", "not a regular file")])
def test_a_dead_path_is_told_before_the_reduction(folder, monkeypatch, where, why):
    monkeypatch.setattr(sys.modules[craig_bampton.__module__], "craig_bampton_basis", None)
    with pytest.raises(RecordError, match=why):
        craig_bampton(bar(), modes=3, frame="x_min", stream=folder / where)


@cache
def small_body():
    return craig_bampton(bar(), modes=0, frame="x_min", geometric_stiffness=False)


def spread(n=40, bad=None):
    """A body, and modes of which each rank has every size-th node."""
    body = small_body()
    place = np.arange(COMM.rank, n, COMM.size)
    phi = np.random.default_rng(1).normal(size=(n, 3, body.n_modes))
    if bad is not None:
        phi[bad] = np.nan
    rows = SpreadRows(COMM, n, place, phi.shape[1:], lambda which: phi[place[which]])
    return body, {"modes": SpreadGroup(NodalModes, {"node": np.arange(n), "x": np.zeros((n, 3)), "phi": rows})}, phi


@pytest.mark.usefixtures("small_pieces")
def test_rows_come_to_their_places(folder):
    body, groups, phi = spread()
    record_stream.write_record(COMM, folder / "a.h5", body, groups)
    loaded = ReducedBody.load(folder / "a.h5")
    assert loaded.modes is not None
    assert np.array_equal(loaded.modes.phi, phi)
    whole = groups["modes"].whole()
    assert np.array_equal(whole.phi, phi)
    assert not whole.phi.flags.writeable


def failing(folder, groups, body, match, kind=RecordError):
    """The write fails on all ranks, and an earlier file is there still, alone."""
    parallel.on_root(COMM, lambda: (folder / "a.h5").write_text("here before"))
    with pytest.raises(kind, match=match):
        record_stream.write_record(COMM, folder / "a.h5", body, groups)
    assert parallel.on_root(COMM, (folder / "a.h5").read_text) == "here before"
    assert in_folder(folder) == ["a.h5"]


@pytest.mark.usefixtures("small_pieces")
def test_numbers_that_are_not_finite_are_refused_by_all(folder):
    body, groups, _ = spread(bad=39)
    failing(folder, groups, body, "NodalModes: phi holds values that are not finite")


@pytest.mark.parametrize("at", ["posix_fallocate", "pwrite", "fsync"])
def test_a_full_disk_is_told_to_all(folder, monkeypatch, at):
    """Where room is taken, where the last rank writes its rows, where the file takes its place."""
    body, groups, _ = spread()

    def full(*_):
        raise OSError(28, "No space left on device")

    if at != "pwrite" or COMM.rank == COMM.size - 1:
        monkeypatch.setattr(os, at, full)
    failing(folder, groups, body, "No space left on device; nothing was changed there")


def test_a_rank_that_does_not_see_the_folder_is_named(folder, monkeypatch):
    body, groups, _ = spread()
    write = record_stream._write_rows
    if COMM.rank == COMM.size - 1:
        elsewhere = Path("/nowhere/a.part")
        monkeypatch.setattr(record_stream, "_write_rows", lambda _, *rest, **more: write(elsewhere, *rest, **more))
    failing(folder, groups, body, "cannot open /nowhere/a.part, which rank 0 has made.*all ranks see")


@pytest.mark.parametrize("rank", [0, COMM.size - 1])
def test_an_interrupt_ends_it_on_all_ranks(folder, monkeypatch, rank):
    body, groups, _ = spread()

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    mine = COMM.rank == rank
    if mine:
        monkeypatch.setattr(record_stream, "_write_array", interrupted)
    kind = KeyboardInterrupt if mine else RuntimeError
    failing(folder, groups, body, None if mine else "KeyboardInterrupt while all ranks worked", kind=kind)
