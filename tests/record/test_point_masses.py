"""Fictitious point masses: every mass integral of the body from its points, for real and degenerate bodies."""

import dataclasses

import numpy as np
import pytest
from particles import of_unit_mass
from two_crosses_body import two_crosses

from flexmbd.errors import RecordError
from flexmbd.record.point_masses import point_masses
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody


def body_of(points, masses, phi=None):
    """The record of real point masses (k,), at points (k, 3), with modes phi (k, 3, n)."""
    phi = np.zeros((len(points), 3, 0)) if phi is None else of_unit_mass(phi, masses)
    n = phi.shape[2]
    fields = np.concatenate([np.ones((len(points), 1)), points, phi.swapaxes(1, 2).reshape(len(points), 3 * n)], axis=1)
    return ReducedBody(
        gram=(fields * masses[:, None]).T @ fields,
        stiffness=np.arange(1.0, n + 1.0),
        damping=np.zeros((n, n)),
        interfaces=(InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, n))),),
        frame="A",
        partition=np.eye(n),
        partition_names=tuple(map(str, range(n))),
    )


def error(body, found):
    """The largest error of a mass integral, relative to what the two fields' own sizes allow."""
    r, n = len(found.mass), body.n_modes
    assert found.x.shape == (r, 3)
    assert found.phi.shape == (r, 3, n)
    gram = np.zeros((4 + 3 * n, 4 + 3 * n))
    for mass, x, phi in zip(found.mass, found.x, found.phi, strict=True):
        fields = np.concatenate([[1.0], x, phi.T.reshape(-1)])
        gram += mass * np.outer(fields, fields)
    squares = np.diag(body.gram)
    size = np.sqrt(np.concatenate([squares[:1], np.repeat(squares[1:].reshape(-1, 3).sum(axis=1), 3)]))
    size[size == 0.0] = 1.0
    return (abs(gram - body.gram) / np.outer(size, size)).max()


@pytest.fixture(scope="module")
def rod():
    """A connecting rod off any axis of its mesh, reduced."""
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    turn = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [-0.4, 1.0, 0.5], [0.1, -0.3, 1.0]]))[0]
    turn *= np.linalg.det(turn)
    ends = [Interface("big_end", axes=turn), Interface("small_end")]
    model = ContinuumModel(
        meshes.connecting_rod(length=0.3, h=20e-3), solid_linear, steel, degree=2, interfaces=ends
    )
    return craig_bampton(model, modes=8, frame="big_end")


def test_real_part(rod):
    found = point_masses(rod)
    assert len(found.mass) == 4 + 3 * rod.n_modes
    assert np.ptp(found.mass) == 0.0
    assert found.mass.min() > 0.0
    assert found.mass.sum() == pytest.approx(rod.mass, rel=1e-14)
    assert error(rod, found) < 1e-13
    # inside the box that holds the rod, whatever its radius of gyration along some direction is
    reach = np.sqrt(np.diag(rod.gram)[1:4] / rod.mass - rod.com**2)
    assert (abs(found.x - rod.com)[:, 0] <= 1.0001 * np.sqrt(2.0) * reach[0]).all()
    assert (abs(found.x - rod.com) <= np.sqrt(2.0 * 3.0) * reach).all()


def test_kinetic_energy_of_the_moving_deformed_part(rod):
    """Velocity of each point by hand, against the mass matrix and the record's own deformed inertia."""
    rng = np.random.default_rng(2)
    found = point_masses(rod)
    v, w, qd = rng.normal(size=3), rng.normal(size=3), 0.1 * rng.normal(size=rod.n_modes)
    velocity = v + np.cross(w, found.x) + found.phi @ qd
    energy = 0.5 * found.mass @ np.sum(velocity**2, axis=1)
    xi = np.concatenate([v, w, qd])
    assert energy == pytest.approx(0.5 * xi @ rod.mass_matrix() @ xi, rel=1e-12)


def test_points_without_any_symmetry():
    rng = np.random.default_rng(0)
    body = body_of(rng.normal(size=(40, 3)) + np.array([5.0, 0, 0]), rng.uniform(1, 2, 40), rng.normal(size=(40, 3, 5)))
    found = point_masses(body)
    assert len(found.mass) == 19
    assert error(body, found) < 1e-13


LINE = np.array([[0.0, 0, 0], [1.0, 2.0, -1.0], [3.0, 6.0, -3.0], [-2.0, -4.0, 2.0]])
DISC = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(5.0)])
SOLID = np.vstack([DISC, DISC + np.array([0.0, 0.5, 2.0])])


@pytest.mark.parametrize(
    ("points", "rank"),
    [
        (SOLID, 4),
        (DISC, 3),
        (DISC + np.array([0.0, 0.0, 7.0]), 3),
        (LINE, 2),
        (LINE + np.array([0.0, 3.0, 1e3]), 2),
        (np.full((3, 3), 0.7), 1),
        (np.zeros((3, 3)), 1),
        (1e-9 * SOLID, 4),
    ],
    ids=["solid", "disc", "disc beside", "bar", "bar far away", "point", "point at B", "nanometres"],
)
def test_rigid_bodies_of_every_rank(points, rank):
    body = body_of(points, np.linspace(1.0, 3.0, len(points)))
    found = point_masses(body)
    assert len(found.mass) == rank
    assert error(body, found) < 1e-13


def test_planar_body_with_planar_modes():
    """Nothing moves along z: neither the positions nor the modes give it a point."""
    rng = np.random.default_rng(1)
    phi = rng.normal(size=(5, 3, 2)) * np.array([1.0, 1.0, 0.0])[:, None]
    # of five points the fields 1, x, y, phi_1x, phi_1y, phi_2x, phi_2y can have rank 5 at most
    body = body_of(DISC, np.ones(5), phi)
    found = point_masses(body)
    assert len(found.mass) == 5
    assert abs(found.x[:, 2]).max() < 1e-12
    assert abs(found.phi[:, 2]).max() < 1e-12
    assert error(body, found) < 1e-13


def test_rigid_part_with_crosses_that_move():
    """Ten fields with dependencies among them: a mode along x, another that turns about x."""
    body = two_crosses()
    found = point_masses(body)
    assert len(found.mass) == np.linalg.matrix_rank(body.gram, tol=1e-12) < 10
    assert error(body, found) < 1e-13


def test_points_are_those_of_the_record_not_of_the_eigensolver():
    """Far fewer digits in, nearly the same points out: the factor is unique."""
    rng = np.random.default_rng(3)
    body = body_of(rng.normal(size=(40, 3)), rng.uniform(1, 2, 40), rng.normal(size=(40, 3, 2)))
    noise = 1e-9 * rng.normal(size=body.gram.shape)
    other = dataclasses.replace(body, gram=body.gram + noise + noise.T)
    assert abs(point_masses(body).phi - point_masses(other).phi).max() < 1e-6


@pytest.mark.parametrize(
    ("gram", "message"),
    [
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "mass is -1.0 kg"),
        (np.zeros((4, 4)), "mass is 0.0 kg"),
        (np.diag([1.0, 1.0, 1.0, -0.5]), "not that of a mass distribution: .* eigenvalue -3"),
    ],
)
def test_what_is_no_mass_distribution(gram, message):
    with pytest.raises(RecordError, match=message):
        point_masses(dataclasses.replace(body_of(np.zeros((1, 3)), np.ones(1)), gram=gram))
