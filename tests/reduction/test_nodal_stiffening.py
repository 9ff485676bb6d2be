"""Stiffening of bodies with nodal interfaces: a beam that spins in closed form, and bodies without the interface."""

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NodalInterface
from flexmbd.forms import solid_linear
from flexmbd.reduction import InterfaceModes, craig_bampton

pytestmark = pytest.mark.mpi

# of metres, and of millimetres, tonnes and seconds; no lateral contraction that a clamp would hinder
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.0, rho=7850.0)
IN_MM = solid_linear.Parameters(E=2.1e5, nu=0.0, rho=7.85e-9)
# What the square of a beam's angular velocity adds to that of its bending frequency, clamped on the axis (Southwell):
# int (1 - x^2) / 2 w'^2 / int w^2 of the first two modes w(x) of a cantilever of length one, out of the plane.
SOUTHWELL = 1.193336, 6.478225


def part(*interfaces, size=(0.8, 0.02, 0.01), divisions=(16, 3, 2), unit=1.0):
    mesh = meshes.block(*(unit * one for one in size), divisions=divisions)
    return ContinuumModel(mesh, solid_linear, STEEL if unit == 1.0 else IN_MM, degree=2, interfaces=interfaces)


def added(body, *, axis):
    """What a spin adds to each eigenvalue over its square, by load and by stretch; "x" is 0."""
    load = body.geometric.loads.index(f"angular velocity {'xyz'[axis] * 2}")
    force = sum(body.gram[1 + a, 4 + a :: 3] for a in range(3) if a != axis)
    response = body.stretch.strain @ (force / body.stiffness)
    return np.diag(body.geometric.K[load]), np.einsum("m,mii->i", response, body.stretch.P)


@pytest.mark.parametrize(("choice", "unit"), [(None, 1.0), (None, 1e3), (InterfaceModes(9), 1.0)])
def test_a_beam_that_spins(choice, unit):
    """The nodes of its tip, 105 dofs or what interface modes leave of them, stiffen nothing by themselves."""
    model = part(Interface("x_min"), NodalInterface("x_max"), unit=unit)
    body = craig_bampton(model, modes=8, frame="x_min", interface_modes=choice)
    for found in added(body, axis=2):
        # the first and the third mode bend the thin way, along the axis of the spin
        assert found[[0, 2]] == pytest.approx(SOUTHWELL, rel=2e-3)
    assert len(body.stretch.strain) < 16
    assert body.provenance["geometric stiffness"].endswith(f"of {body.n_modes}, those that are resolved")


def test_a_body_without_modes_says_that_nothing_completes_its_tension():
    """It is uniform between interfaces, and a beam that spins is stiffened too much; one mode is enough."""
    ends = Interface("x_min"), Interface("x_max")
    for modes, agrees in (0, False), (1, True):
        body = craig_bampton(part(*ends), modes=modes, frame="x_min")
        by_stretch = added(body, axis=2)[1][0]
        assert bool(abs(by_stretch / SOUTHWELL[0] - 1.0) < 2e-3) is agrees
        assert body.provenance["stretch modes"].startswith("none") is not agrees


def test_waves_of_a_seam():
    """The long seam of a thin plate bends: as in the plate without an interface there, whose modes are many."""
    size, divisions = (0.3, 0.2, 0.004), (5, 4, 1)
    plain = craig_bampton(part(Interface("x_min"), size=size, divisions=divisions), modes=40, frame="x_min")
    seam = part(Interface("x_min"), NodalInterface("x_max"), size=size, divisions=divisions)
    body = craig_bampton(seam, modes=12, frame="x_min")
    assert body.stiffness[:6] == pytest.approx(plain.stiffness[:6], rel=1e-3)
    for axis in (1, 2):
        for found, expected in zip(added(body, axis=axis), added(plain, axis=axis), strict=True):
            assert found[:6] == pytest.approx(expected[:6], rel=5e-3)


def test_a_free_body():
    """Held nowhere, nodes at both ends carry its rigid motions; beside a body without interfaces."""
    ends = NodalInterface("x_min"), NodalInterface("x_max")
    size, divisions = (0.8, 0.02, 0.01), (16, 2, 1)
    body = craig_bampton(part(*ends, size=size, divisions=divisions), modes=12)
    plain = craig_bampton(part(size=size, divisions=divisions), modes=40)
    for axis in (1, 2):
        for found, expected in zip(added(body, axis=axis), added(plain, axis=axis), strict=True):
            assert found[:4] == pytest.approx(expected[:4], rel=5e-3)
