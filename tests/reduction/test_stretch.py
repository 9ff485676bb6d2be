"""Stretch of a body by its modes' rotations: closed forms of beams, and what is added to the modes for it."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from bracket import bracket

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton, guyan

LENGTH, SIDE = 1.0, 0.02
MATERIAL = solid_linear.Parameters(E=2.0e9, nu=0.0, rho=1000.0)


@pytest.fixture(scope="module")
def model():
    mesh = meshes.block(
        LENGTH, SIDE, SIDE, divisions=(20, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    return ContinuumModel(
        mesh, solid_linear, MATERIAL, degree=2, interfaces=[Interface("x_min"), Interface("x_max")]
    )


@pytest.fixture(scope="module")
def beam(model):
    return craig_bampton(model, modes=13, frame="x_min")


def strains(body, q):
    """(m,) the membrane strains of q, to second order."""
    return body.stretch.strain @ q + 0.5 * np.einsum("i,mij,j->m", q, body.stretch.P, q)


def forces_of(body, q):
    """(m,) the membrane forces of linear statics."""
    return body.stretch.strain @ q


def change(body, q):
    """(n, n) what the membrane forces of linear statics add to the stiffness."""
    return np.tensordot(forces_of(body, q), body.stretch.P, 1)


def bent(body, deflection):
    """q of a cantilever under a tip force, with this deflection."""
    rows = body.interface("x_max").modes
    q = rows[1] / body.stiffness
    return q * deflection / (rows[1] @ q)


@pytest.mark.parametrize(("deflection", "within"), [(1e-4, 1e-4), (0.1, 2e-3), (0.3, 2e-2)])
def test_a_bent_beam_is_as_long_as_before(beam, deflection, within):
    """Where no membrane is stretched the tip has come nearer by the integral of 1 - cos of the angle.

    To second order exactly; what follows is as good as the few strains along the beam.
    """
    q = bent(beam, deflection)
    start = forces_of(beam, q)
    for _ in range(60):
        q += ((start - strains(beam, q)) @ beam.stretch.strain) / beam.stiffness
    tip = beam.interface("x_max").modes[0] @ q
    # slope of a cantilever under a force at the tip, the sine of the angle, by Gauss's rule
    points, weights = np.polynomial.legendre.leggauss(12)
    s = (points + 1) / 2
    slope = 1.5 * deflection / LENGTH * (2 * s - s**2)
    expected = LENGTH / 2 * weights @ (np.sqrt(1 - slope**2) - 1)
    assert tip == pytest.approx(expected, rel=within)
    assert strains(beam, q) == pytest.approx(start, rel=1e-9, abs=1e-12)


def test_spinning_beam_by_the_modes(beam):
    """Southwell's 1.193 for the clamped mode, from the centrifugal force on the modes and their stretch alone."""
    n = beam.n_modes
    # rho (w^2 r) along x for a spin about the axis across the bending
    load = beam.gram[1, 4:].reshape(n, 3)[:, 0]
    q = load / beam.stiffness
    assert change(beam, q)[0, 0] == pytest.approx(1.193, rel=2e-3)


def test_buckling_by_the_modes(beam):
    """Euler's load of a cantilever, with the strain energy's own second derivative under a tip force."""
    rows = beam.interface("x_max").modes
    q = -rows[0] / beam.stiffness
    loads = scipy.linalg.eigh(-change(beam, q), np.diag(beam.stiffness), eigvals_only=True)
    bending = LENGTH**3 / (3 * ((rows / beam.stiffness) @ rows.T)[1, 1])
    assert 1.0 / loads[-1] == pytest.approx(np.pi**2 * bending / (4 * LENGTH**2), rel=2e-3)


def test_stretch_modes_are_there_for_the_tension_of_a_spin(model, beam):
    """Two more modes along the beam; with them its elongation by a spin is exact, without it lacks a sixth."""
    added = [name for name in beam.partition_names if name.startswith("stretch")]
    assert 1 <= len(added) <= 4
    assert beam.provenance["stretch modes"] == str(len(added))
    plain = craig_bampton(model, modes=13, frame="x_min", geometric_stiffness=False)
    assert plain.n_modes == beam.n_modes - len(added)
    assert plain.stretch is None
    # energy of the elongation: the integral of N^2 / 2 E A with N = rho A (L^2 - x^2) / 2
    exact = (MATERIAL.rho * SIDE**2) ** 2 / (MATERIAL.E * SIDE**2) * LENGTH**5 / 15
    energy = {}
    for name, body in (("plain", plain), ("beam", beam)):
        load = body.gram[1, 4:].reshape(body.n_modes, 3)[:, 0]
        energy[name] = 0.5 * np.sum(load**2 / body.stiffness)
    assert energy["beam"] == pytest.approx(exact, rel=2e-4)
    assert energy["plain"] == pytest.approx(exact * (1 - 1 / 6), rel=0.02)


def test_none_are_added_to_all_modes_there_are():
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(3, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, MATERIAL, degree=1, interfaces=ends)
    # eight nodes are not on the ends
    body = craig_bampton(model, modes=24, frame="x_min")
    assert body.n_modes == 6 + 24
    assert body.provenance["stretch modes"] == "0"


def test_guyan_has_no_further_modes(model):
    assert guyan(model, frame="x_min").n_modes == 6


@pytest.mark.mpi
@pytest.mark.parametrize("frame", ["root", None])
def test_any_number_of_ranks(frame):
    world, alone = (
        craig_bampton(bracket(comm=comm, degree=1), modes=3, frame=frame)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    assert world.partition_names == alone.partition_names
    # a basis of membrane fields is as good as another
    found, expected = (np.einsum("mk,mij->kij", body.stretch.strain, body.stretch.P) for body in (world, alone))
    assert abs(found - expected).max() < 1e-8 * abs(expected).max()
    assert len(set(MPI.COMM_WORLD.allgather(world.fingerprint()))) == 1
