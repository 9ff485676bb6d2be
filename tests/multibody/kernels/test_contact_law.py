"""The variation of a contact's wrench and of how it slides against differences; the bristle's return mapping."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact import signed_distance as kinds
from flexmbd.multibody.kernels.contact.bristle import slide, stretch
from flexmbd.multibody.kernels.contact.contact_law import contact, contact_energy, contact_variation
from flexmbd.multibody.kernels.contact.normal_force import EXPONENT, STIFFNESS, normal_force
from flexmbd.multibody.kernels.contact.resistance import resist, resist_variation

SHAPES = {
    "sphere": ([kinds.SPHERE, 0.5, 0.0, 0.0], (0.3, -0.2, 0.4)),
    "hollow sphere": ([kinds.HOLLOW_SPHERE, 1.0, 0.0, 0.0], (0.7, 0.3, -0.55)),
    "capsule, its side": ([kinds.CAPSULE, 0.5, 0.7, 0.0], (0.4, -0.35, 0.2)),
    "capsule, its end": ([kinds.CAPSULE, 0.5, 0.7, 0.0], (0.3, -0.2, 1.05)),
    "cylinder": ([kinds.CYLINDER, 0.5, 0.0, 0.0], (0.4, -0.35, 2.0)),
    "bore": ([kinds.HOLLOW_CYLINDER, 1.0, 0.0, 0.0], (0.7, 0.6, -0.2)),
    "box, a face": ([kinds.BOX, 0.5, 0.4, 0.3], (0.1, 0.05, 0.36)),
    "box, an edge": ([kinds.BOX, 0.5, 0.4, 0.3], (0.53, 0.1, 0.34)),
    "box, a corner": ([kinds.BOX, 0.5, 0.4, 0.3], (-0.53, 0.42, 0.33)),
    "disc, its side": ([kinds.DISC, 0.45, 0.25, 0.05], (0.42, -0.37, 0.1)),
    "disc, a face": ([kinds.DISC, 0.45, 0.25, 0.05], (0.1, 0.05, -0.36)),
    "disc, its edge": ([kinds.DISC, 0.45, 0.25, 0.05], (0.3, 0.4, 0.33)),
    "disc, inside its side": ([kinds.DISC, 0.45, 0.25, 0.05], (0.3, 0.3, 0.1)),
    "half space": ([kinds.HALF_SPACE, *(np.array([1.0, 2.0, 2.0]) / 3.0)], (0.02, 0.03, 0.0)),
}
RADIUS = 0.1


SLIDING = 0.2  # where it slides they are those of a stretch that is shortened: for Newton's iteration, not for results
STEP = 1e-2  # s, from what is remembered to now
BRISTLE, DAMPING = 3e4, 40.0


@entry_kernel
def ask(data, rough, memory, y, d, rate, spin, out):
    way = memory, 0, STEP, (y[0], y[1], y[2])
    contact(
        data, 0, rough, way, (d[0], d[1], d[2]), (rate[0], rate[1], rate[2]), (spin[0], spin[1], spin[2]), out
    )  # fmt: skip


@entry_kernel
def vary(data, rough, memory, motion, change, out):
    m, c = motion, change
    way = memory, 0, STEP, (m[9], m[10], m[11])
    contact_variation(
        data, 0, rough, way, ((m[0], m[1], m[2]), (m[3], m[4], m[5]), (m[6], m[7], m[8])),
        ((c[0], c[1], c[2]), (c[3], c[4], c[5]), (c[6], c[7], c[8]), (c[9], c[10], c[11])), out,
    )  # fmt: skip


@entry_kernel
def stored(data, memory, d, out):
    out[0] = contact_energy(data, 0, False, (memory, 0, 0.0, (0.0, 0.0, 0.0)), (d[0], d[1], d[2]))


@entry_kernel
def lead(memory, data, path, depth, out):
    """The stretch after a second on a way in the xy plane; 1 m/N is how far it goes before it slides."""
    zero = 0.0, 0.0, 0.0
    way = (path[0, 0], path[0, 1], path[0, 2]), (path[2, 0], path[2, 1], path[2, 2])
    law = data, 0, 0.0, 1.0, 0.0, normal_force(data, 0, 0.0, depth[0], depth[1])[0], 0.0
    end, _, _, _ = stretch(
        (memory, 0, 1.0, 0, True), (0.0, 0.0, 1.0), way, (zero, zero), law, (depth[0], depth[1]), (0.0, 0.0)
    )
    out[0], out[1], out[2] = end


@entry_kernel
def march(z, moves, limits):
    for k in range(moves.shape[0]):
        length = 0.0
        for c in range(3):
            z[c] += moves[k, c]
            length += z[c] * z[c]
        length = length**0.5
        if length > limits[k]:
            for c in range(3):
                z[c] *= limits[k] / length


def numbers(shape, *, D=0.05, mu=0.4, static=0.6):
    return np.array([*shape, RADIUS, 1e4, 1.5, D, mu, static, 0.7, BRISTLE, DAMPING, *np.zeros(6)])


def remembered(z=(0.0, 0.0, 0.0), rate=(0.0, 0.0, 0.0), depth=(0.0, 0.0)):
    """Of time 0, where nothing had slid yet."""
    return np.array([0.0, 0.0, 0.0, 0.0, *z, 0.0, 0.0, 0.0, *rate, *depth, 0.0])


def wrench(data, motion, memory=None):
    rough = memory is not None
    out = np.zeros(9 if rough else 6)
    kept = np.zeros(0) if memory is None else memory
    ask(data, rough, kept, motion[9:].copy(), motion[:3].copy(), motion[3:6].copy(), motion[6:9].copy(), out)
    return out


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("slid", [None, 1e-7, 1e-5, 3e-3, 5e-2])  # smooth; it sticks; it slides, ever farther
def test_variations_are_those_of_differences(name, slid):
    shape, place = SHAPES[name]
    data = numbers(shape)
    rng = np.random.default_rng(7)
    motion = np.concatenate([place, rng.normal(size=6), np.zeros(3)])
    memory = None
    if slid is not None:
        n = wrench(data, motion)[:3]
        n /= np.linalg.norm(n)
        slide = np.cross(n, [0.6, -0.5, 0.4])
        memory = remembered(1e-6 * np.cross(n, slide), slid / STEP * slide, (0.03, 0.2))
        motion[9:] = slid * (slide + 0.3 * np.cross(n, slide))
        sliding = slid / STEP * (slide + 0.6 * np.cross(n, slide))  # as of a way that bends by as much
        motion[3:6] = sliding + 0.3 * n + np.cross(motion[6:9], RADIUS * n)
    assert np.abs(wrench(data, motion, memory)[:3]).max() > 1.0  # it touches
    for _ in range(4):
        change = rng.normal(size=12)
        if slid is not None:
            change[9:] -= (n @ change[9:]) * n
            change[9:] *= min(1.0, 30.0 * slid)
        h = 1e-6 if slid is None else min(1e-6, 1e-2 * slid)
        found = np.zeros(6 if slid is None else 9)
        vary(data, slid is not None, np.zeros(0) if memory is None else memory, motion, change, found)
        expected = (wrench(data, motion + h * change, memory) - wrench(data, motion - h * change, memory)) / (2.0 * h)
        near = 2e-5 if slid is None or slid < 1e-3 else SLIDING
        assert found == pytest.approx(expected, rel=near, abs=near * np.abs(expected).max())


@entry_kernel
def turn(data, memory, y, motion, out):
    m = motion
    way = memory, 0, STEP, (y[0], y[1], y[2])
    moment, _ = resist(data, 0, way, (m[0], m[1], m[2]), (m[3], m[4], m[5]), (m[6], m[7], m[8]), out[3:])
    out[0], out[1], out[2] = moment


@entry_kernel
def vary_turn(data, memory, y, motion, change, out):
    m, c = motion, change
    way = memory, 0, STEP, (y[0], y[1], y[2])
    out[0], out[1], out[2] = resist_variation(
        data, 0, way, ((m[0], m[1], m[2]), (m[3], m[4], m[5]), (m[6], m[7], m[8])),
        ((c[0], c[1], c[2]), (c[3], c[4], c[5]), (c[6], c[7], c[8]), (c[9], c[10], c[11])), out[3:],
    )  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("size", [1e-7, 1e-3])  # both stick; both slide
def test_variations_of_rolling_resistance_are_those_of_differences(name, size):
    shape, place = SHAPES[name]
    data = np.concatenate([numbers(shape), [2e-2, 3e-2, RADIUS]])
    rng = np.random.default_rng(5)
    motion = np.concatenate([place, 0.1 * rng.normal(size=3), size / STEP / RADIUS * rng.normal(size=3)])
    memory = np.concatenate([remembered(depth=(0.03, 0.0)), 0.1 * size * rng.normal(size=9), np.zeros(2)])
    y = memory[19:22] + STEP * RADIUS * motion[6:]

    def asked(at):
        out = np.zeros(6)
        turn(data, memory, y + at[9:], motion + at[:9], out)
        return out

    for _ in range(4):
        change = rng.normal(size=12)
        change[9:] *= size
        change[6:9] *= size / STEP
        change[:3] *= 1.0 if size < 1e-5 else 0.0  # what slides is not varied to first order as its normal turns
        h = 1e-5
        found = np.zeros(6)
        vary_turn(data, memory, y, motion, change, found)
        expected = (asked(h * change) - asked(-h * change)) / (2.0 * h)
        near = 2e-5 if size < 1e-5 else SLIDING
        assert found == pytest.approx(expected, rel=near, abs=near * np.abs(expected[:3]).max())


@pytest.mark.parametrize("name", SHAPES)
def test_the_force_at_rest_is_the_derivative_of_the_energy(name):
    shape, place = SHAPES[name]
    data = numbers(shape, D=0.0)
    force = wrench(data, np.array([*place, *np.zeros(9)]))[:3]

    def energy(p):
        out = np.zeros(1)
        stored(data, np.zeros(0), p, out)
        return out[0]

    slope = [(energy(np.array(place) + 1e-6 * e) - energy(np.array(place) - 1e-6 * e)) / 2e-6 for e in np.eye(3)]
    assert force == pytest.approx(-np.array(slope), rel=1e-6, abs=1e-6 * np.abs(force).max())


def test_friction_never_exceeds_coulomb_s():
    shape, place = SHAPES["half space"]
    data = numbers(shape)
    n = np.array(shape[1:])
    rng = np.random.default_rng(3)
    for _ in range(200):
        motion = np.concatenate([place, rng.normal(size=9) * 10.0 ** rng.uniform(-4, 1)])
        z = rng.normal(size=3) * 10.0 ** rng.uniform(-6, 0)
        force = wrench(data, motion, remembered(z, rng.normal(size=3), 0.1 * rng.normal(size=2)))[:3]
        normal = force @ n
        assert np.linalg.norm(force - normal * n) <= 0.6 * normal * (1.0 + 1e-12)


def cubic(path, t):
    """The place at a share t of the way, from its begin; rows of ``path``: its end, the rates at both ends."""
    whole, first, last = path
    return np.outer(t, first) + np.outer(t**2, 3.0 * whole - 2.0 * first - last) + np.outer(
        t**3, first + last - 2.0 * whole
    )  # fmt: skip


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e6])  # of the way, over the stretch
@pytest.mark.parametrize("seed", range(6))
def test_a_way_takes_the_bristle_where_a_million_pieces_do(seed, size):
    """Ways that bend, and that turn back within the step."""
    rng = np.random.default_rng(seed)
    path = np.zeros((3, 3))
    path[:, :2] = size * rng.normal(size=(3, 2))
    if seed >= 3:  # to and fro along a line
        path = np.outer([0.3, 2.0, -1.0] if seed < 5 else [1e-7, 1.0, -1.0], size * rng.normal(size=3))
        path[:, 2] = 0.0
    z = np.array([0.3, -0.2, 0.0])
    deep = np.array([1.0, 0.5 + rng.uniform()]), np.array([0.5, -0.4])  # at both ends, and the rates
    found = np.zeros(3)
    law = np.zeros(20)
    law[[STIFFNESS, EXPONENT]] = 1.0
    lead(remembered(z, path[1], (deep[0][0], deep[1][0])), law, path, np.array([deep[0][1], deep[1][1]]), found)
    ends = np.linspace(0.0, 1.0, 400001)
    ends = np.concatenate([ends, 1.0 - np.geomspace(1e-5, 1e-14, 100000)]) if size > 1.0 else ends
    ends = np.sort(ends)
    rise = np.array([[deep[0][1] - deep[0][0], 0.0, 0.0], [deep[1][0], 0.0, 0.0], [deep[1][1], 0.0, 0.0]])
    march(z, np.diff(cubic(path, ends), axis=0), deep[0][0] + cubic(rise, ends[1:])[:, 0])
    assert found == pytest.approx(z, abs=2e-2 if size == 1.0 else 2e-4)


@entry_kernel
def slid(z, move, s, out):
    """Where a bristle that slides along z comes to on a straight way."""
    none = (0.0, 0.0, 0.0)
    end, _, _ = slide((z[0], z[1], z[2]), none, (move[0], move[1], move[2]), none, s, s, 0.0)
    out[0], out[1], out[2] = end


@pytest.mark.parametrize("longer", [1e-12, 1e-15, 0.0, -1e-15, -1e-12])
@pytest.mark.parametrize("lengths", [2.5, 30.0, 360.0, 1e6])
def test_a_bristle_that_slides_turns_round_on_a_long_way_back(longer, lengths):
    """Whatever the round-off of its length, and however long the way is beside it."""
    rng, found = np.random.default_rng(1), np.zeros(3)
    for _ in range(50):
        angle, s = rng.uniform(0.0, 2.0 * np.pi), 10.0 ** rng.uniform(-9.0, 0.0)
        e = np.array([np.cos(angle), np.sin(angle), 0.0])
        slid(s * (1.0 + longer) * e, -lengths * s * e, s, found)
        assert found == pytest.approx(-s * e, abs=1e-7 * s)
