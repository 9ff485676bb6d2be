"""The geometrically exact beam: rolled up, bent far in a plane and in space, turned as a whole."""

import dataclasses

import numpy as np
import pytest
from cantilever import Cantilever
from scipy.spatial.transform import Rotation

from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.errors import ConvergenceError, FormulationError
from flexmbd.forms import beam_exact


@pytest.mark.parametrize(("degree", "n"), [(2, 8), (1, 8)])
def test_a_moment_rolls_a_cantilever_up_twice(degree, n):
    """A circle at every load, of radius E I / M but for the rule's error: a cell's chord is the mean of the tangent at
    its Gauss points, while the angles are exact.
    """
    p = beam_exact.Parameters.rectangle(30e6, 0.0, 1.0, width=1.0, height=1.0, orientation=(0, 1, 0))
    rod, seen = Cantilever(p, length=12.0, n=n, degree=degree), []
    turns = 4 * np.pi
    moment = turns * p.E * p.Iz / 12.0
    rod.load([0, 0, 0, 0, 0, moment], steps=16, at=lambda t, u: seen.append((turns * t, u.copy())))
    for angle, u in seen:
        assert u[5] == pytest.approx(angle, rel=1e-8)
        half = angle / n / 2
        by_rule = np.cos(half / np.sqrt(3)) if degree == 2 else 1.0
        radius = 12.0 / angle * by_rule / (np.sin(half) / half)
        circle = radius * np.array([np.sin(angle), 1 - np.cos(angle)])
        assert u[:2] + np.array([12.0, 0.0]) == pytest.approx(circle, abs=1e-7)
        assert abs(u[[2, 3, 4]]).max() < 1e-9


NACHBAGAUER = beam_exact.Parameters.rectangle(2.07e11, 0.3, 1.0, width=0.5, height=0.1, orientation=(0, 1, 0))


@pytest.mark.parametrize(
    ("factor", "exact"),
    [
        (NACHBAGAUER.ky, (0.15097114424, 0.71056859785)),
        (5 / 6, (0.151159069, 0.711118975)),
        (1.0, (0.149529375, 0.706350848)),
    ],
)
def test_a_short_cantilever_with_shear(factor, exact):
    """Nachbagauer and others 2011: tip of a Reissner beam under a dead force, from its boundary value problem."""
    p = dataclasses.replace(NACHBAGAUER, ky=factor)
    u = Cantilever(p, length=2.0, n=16).load([0, -6.25e7, 0, 0, 0, 0], steps=4)
    assert -u[:2] == pytest.approx(exact, rel=4e-7)


def test_a_short_cantilever_under_a_small_force():
    u = Cantilever(NACHBAGAUER, length=2.0, n=16).load([0, -6.25e4, 0, 0, 0, 0], steps=1)
    assert -u[:2] == pytest.approx((1.888492e-7, 8.09903253977e-4), rel=1e-6)


def test_an_extensible_cantilever_without_shear():
    """F = 3 E I / L^2: the tip of Euler and Bernoulli's beam, shear taken away by extrapolation."""
    p = beam_exact.Parameters.rectangle(2.07e11, 0.0, 1.0, width=0.1, height=0.1, orientation=(0, 1, 0))
    force = -3 * p.E * p.Iz / 4
    tips = [
        Cantilever(dataclasses.replace(p, ky=k), length=2.0, n=16).load([0, force, 0, 0, 0, 0], steps=10)
        for k in (50.0, 100.0)
    ]
    assert (2 * tips[1] - tips[0])[:2] == pytest.approx((-0.508537304326, -1.207239854550), rel=5e-7)


PRINCETON = beam_exact.Parameters.rectangle(
    71.7e9, 0.31, 2700.0, width=12.3777e-3, height=3.2024e-3, orientation=(0, 1, 0)
)


def test_a_bent_beam_may_turn_as_often_as_it_likes():
    """Its energy stays, its internal forces and moments turn with it; 2.5 rad a step, to ten."""
    rod = Cantilever(PRINCETON, length=0.508, n=8)
    rod.load([0, -8.0, 9.0, 0, 0, 0.2], steps=4)
    body, dofs = rod.body, rod.body.displacement_dofs
    rest = np.zeros(body.layout.n_local)
    energy, force = body.energies()["elastic"], body.force(rest)
    vector = 2.5 * np.array([0.48, -0.6, 0.64])
    turn = Rotation.from_rotvec(vector)
    for step in range(1, 5):
        increment = rest.copy()
        increment[dofs] = turn.apply(body.node_x) - body.node_x
        increment[dofs + 3] = vector
        body.force(increment)
        body.commit(increment)
        whole = Rotation.from_rotvec(step * vector)
        found = body.force(rest)
        for part in (dofs, dofs + 3):
            expected = whole.apply(force[part])
            assert abs(found[part] - expected).max() < 1e-7 * abs(force[part]).max()
        assert body.energies()["elastic"] == pytest.approx(energy, rel=1e-9)


def test_resultants_of_a_loaded_cantilever():
    """In the section's axes at rest of the clamp, where nothing has turned: the force, and its arm at the tip."""
    rod = Cantilever(PRINCETON, length=0.508, n=16)
    force = np.array([0.0, -6.0, 7.0])
    tip = rod.load([*force, 0, 0, 0], steps=4)[:3] + np.array([0.508, 0, 0])
    # at the points of the first cell, and back to its start
    first, second = rod.body.stress()[0][0]
    share = (1 / np.sqrt(3) - 1) / 2 / (1 / np.sqrt(3))
    clamp = first + share * (second - first)
    assert clamp[:3] == pytest.approx(force, abs=0.05)
    assert clamp[3:] == pytest.approx(np.cross(tip, force), rel=2e-3, abs=2e-3)


def test_a_step_of_more_than_half_a_turn_is_refused():
    body = Cantilever(PRINCETON, length=1.0, n=2).body
    for angle in (3.1, 3.2):
        increment = np.zeros(body.layout.n_local)
        increment[body.displacement_dofs[:, 0] + 3] = angle
        if angle < np.pi:
            body.commit(increment)
            continue
        with pytest.raises(ConvergenceError, match="not finite; take a smaller step"):
            body.commit(increment)
    assert body.displacement[body.displacement_dofs[:, 0] + 3] == pytest.approx(3.1)


def test_bodies_that_move_do_not_take_it():
    body = Cantilever(PRINCETON, length=1.0, n=2).body
    for make in (BondedNodes, NodalMotion):
        with pytest.raises(FormulationError, match=r"unknowns besides the displacement that turn .* load it slowly"):
            make(body)
