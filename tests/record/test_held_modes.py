"""Modes of a free body and of held ones: closed forms of beams, and damping that no choice of the frame changes."""

import numpy as np
import pytest
from particles import particle_body
from two_crosses_body import MASS_A, MASS_B, SPRING, TORSION, TURN_A, TURN_B, two_crosses

from flexmbd.beams import DiscreteFrame, Lumping, discrete_body
from flexmbd.forms import beam_timoshenko
from flexmbd.record.held_modes import held_modes
from flexmbd.record.summary import damping_ratios

SIZE = {"width": 0.01, "height": 0.012, "orientation": (0.0, 1.0, 0.0)}
SECTION = beam_timoshenko.Parameters.rectangle(2.1e11, 0.3, 7850.0, **SIZE)


def rod(divisions, **more):
    ends = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    return DiscreteFrame(ends, {"rod": [("root", "tip")]}, {"rod": SECTION}, divisions=divisions, **more)


@pytest.mark.parametrize(
    ("held", "stiffer"),
    [
        ((), [TORSION * (1 / TURN_A + 1 / TURN_B), SPRING * (1 / MASS_A + 1 / MASS_B)]),
        (("A",), [TORSION / TURN_B, SPRING / MASS_B]),
        (("B",), [TORSION / TURN_A, SPRING / MASS_A]),
        (("A", "B"), []),
    ],
)
def test_two_masses_on_a_spring(held, stiffer):
    body = two_crosses()
    modes = held_modes(body.gram, body.stiffness, [body.interface(name) for name in held])
    assert modes.frequencies == pytest.approx(np.sqrt(np.sort(stiffer)) / 2.0 / np.pi, rel=1e-13)
    assert modes.ratios(modes.damping(np.array(0.3))) == pytest.approx(0.3, rel=1e-13)


@pytest.mark.parametrize("held", [(), ("root",), ("tip",)])
def test_the_mass_of_the_deformation_is_that_of_its_motion(held):
    """Of particles: kinetic energy with the body's own motion that leaves no momentum, or the interface at rest."""
    part = particle_body(5, modes=4)
    body = part.record
    S = held_modes(body.gram, body.stiffness, [body.interface(name) for name in held]).mass()
    rates = np.random.default_rng(0).standard_normal(4)
    moved = part.phi @ rates
    rigid = np.concatenate([np.tile(np.eye(3), (len(part.x), 1, 1)), -np.cross(part.x[:, None], np.eye(3))], axis=1)
    if held:
        face = body.interface(held[0])
        w = -face.modes[3:] @ rates
        moved += -face.modes[:3] @ rates - np.cross(w, face.p_BI_B) + np.cross(w, part.x)
    else:
        weight = np.sqrt(part.mass)[:, None, None]
        columns = (weight * rigid).swapaxes(1, 2).reshape(-1, 6)
        v = np.linalg.lstsq(columns, -(weight[:, :, 0] * moved).ravel(), rcond=None)[0]
        moved += np.einsum("kja,j->ka", rigid, v)
    assert rates @ S @ rates == pytest.approx(part.mass @ np.sum(moved**2, axis=1), rel=1e-12)


@pytest.mark.parametrize("held", [(), ("root",), ("tip", "root")])
def test_damping_does_not_see_what_carries_the_frame(held):
    first, *others = (
        discrete_body(rod(4), interfaces=["root", "tip"], frame=frame, damping_ratio=0.05, damping_held=held)
        for frame in ("root", "tip", None)
    )
    ratios = damping_ratios(first)
    assert held or ratios[""] == pytest.approx(0.05, rel=1e-6)
    assert held != ("root",) or ratios["root"] == pytest.approx(0.05, rel=1e-6)
    for other in others:
        for state, found in damping_ratios(other).items():
            np.testing.assert_allclose(found, ratios[state], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("frame", ["root", "tip"])
def test_a_line_of_points_has_no_inertia_about_itself(frame):
    """Nor have turns of its first node: what has no mass vibrates with no period, and is damped by nothing."""
    body = discrete_body(
        rod(4, lumping=Lumping.POINTS), interfaces=["root", "tip"], frame=frame, damping_ratio=0.05
    )
    modes = held_modes(body.gram, body.stiffness)
    massless = modes.period == 0.0
    assert massless.any()
    assert damping_ratios(body)[""][~massless] == pytest.approx(0.05, rel=1e-6)
    assert not damping_ratios(body)[""][massless].any()



def test_a_free_beam_that_is_damped_and_clamped():
    """Along itself: 4 / pi^2 of the ratio, by what the free modes cos(n pi x) have of the clamped sin(pi x / 2).

    In bending and in the second mode the figures of docs/damping.md.
    """
    body = discrete_body(rod(40), interfaces=["root", "tip"], frame="root", modes=60, damping_ratio=0.05)
    hertz = held_modes(body.gram, body.stiffness, [body.interface("root")]).frequencies
    ratios = damping_ratios(body)["root"]
    along = abs(hertz - np.sqrt(2.1e11 / 7850.0) / 4.0).argmin()
    assert ratios[along] == pytest.approx(0.05 * 4.0 / np.pi**2, rel=0.01)
    assert ratios[[0, 2, 4]] == pytest.approx([0.0036, 0.033, 0.040], rel=0.02)
