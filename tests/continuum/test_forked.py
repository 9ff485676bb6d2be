"""Processes that are forked after MPI's start: what one process does works there, what needs other ranks is refused."""

from multiprocessing import get_context

from mpi4py import MPI

import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.parallel import MpiTeam, refuse_absent_ranks
from flexmbd.errors import FlexmbdError
from flexmbd.forms import solid_linear
from flexmbd.reduction import guyan

pytestmark = pytest.mark.mpi


def first_frequency(comm):
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.block(0.2, 0.05, 0.04, divisions=(4, 1, 1), comm=comm)
    ends = [Interface("x_min"), Interface("x_max")]
    return guyan(ContinuumModel(mesh, solid_linear, steel, degree=1, interfaces=ends), frame="x_min").frequencies()[0]


def tried(function, told):
    try:
        told.send(function())
    except FlexmbdError as error:
        told.send(str(error))


def forked(function):
    """What a function gives, or its error says, in a forked process that ends as those of multiprocessing do."""
    context = get_context("fork")
    heard, told = context.Pipe(duplex=False)
    child = context.Process(target=tried, args=(function, told))
    child.start()
    assert heard.poll(60.0)
    found = heard.recv()
    child.join(60.0)
    assert child.exitcode == 0
    return found


def test_one_process_reduces_and_other_ranks_are_refused():
    here = first_frequency(MPI.COMM_SELF)
    assert forked(lambda: first_frequency(MPI.COMM_SELF)) == here
    refuse_absent_ranks(MPI.COMM_WORLD)  # a rank itself
    if MPI.COMM_WORLD.size > 1:
        assert "forked from rank" in forked(lambda: first_frequency(MPI.COMM_WORLD))
        assert "forked from rank" in forked(lambda: MpiTeam(MPI.COMM_WORLD).fail(None))
    assert first_frequency(MPI.COMM_WORLD) == pytest.approx(here, rel=1e-9)  # the ranks go on
