"""The variation of a contact's wrench and of its bristle's rates against differences, shape by shape."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact import signed_distance as kinds
from flexmbd.multibody.kernels.contact.contact_law import contact, contact_energy, contact_variation

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
    "half space": ([kinds.HALF_SPACE, *(np.array([1.0, 2.0, 2.0]) / 3.0)], (0.02, 0.03, 0.0)),
}
RADIUS = 0.1


@entry_kernel
def ask(data, z, d, rate, spin, out):
    contact(data, 0, z, (d[0], d[1], d[2]), (rate[0], rate[1], rate[2]), (spin[0], spin[1], spin[2]), out)


@entry_kernel
def vary(data, z, motion, change, out):
    m, c = motion, change
    contact_variation(
        data, 0, z, (m[0], m[1], m[2]), (m[3], m[4], m[5]), (m[6], m[7], m[8]),
        (c[0], c[1], c[2]), (c[3], c[4], c[5]), (c[6], c[7], c[8]), out,
    )  # fmt: skip


@entry_kernel
def stored(data, z, d, out):
    out[0] = contact_energy(data, 0, z, (d[0], d[1], d[2]))


def numbers(shape, *, D=0.05, mu=0.4, static=0.6):
    return np.array([*shape, RADIUS, 1e4, 1.5, D, mu, static, 0.7, 3e4, 40.0, 1e-5])


def wrench(data, z, motion):
    out = np.zeros(6 + len(z))
    ask(data, z, motion[:3].copy(), motion[3:6].copy(), motion[6:].copy(), out)
    return out


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("bristle", [None, 1e-4, 2.9e-3, 5e-2])  # smooth; it sticks; it yields; it slides
def test_variations_are_those_of_differences(name, bristle):
    shape, place = SHAPES[name]
    data = numbers(shape)
    rng = np.random.default_rng(7)
    motion = np.concatenate([place, rng.normal(size=6)])
    z = np.zeros(0) if bristle is None else bristle * np.array([0.6, -0.5, 0.4])
    assert np.abs(wrench(data, z, motion)[:3]).max() > 1.0  # it touches
    for _ in range(4):
        change = rng.normal(size=9)
        h = 1e-6
        found = np.zeros(6 + len(z))
        vary(data, z, motion, change, found)
        expected = (wrench(data, z, motion + h * change) - wrench(data, z, motion - h * change)) / (2.0 * h)
        assert found == pytest.approx(expected, rel=2e-6, abs=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", SHAPES)
def test_the_force_at_rest_is_the_derivative_of_the_energy(name):
    shape, place = SHAPES[name]
    data, none = numbers(shape, D=0.0), np.zeros(0)
    force = wrench(data, none, np.array([*place, *np.zeros(6)]))[:3]

    def energy(p):
        out = np.zeros(1)
        stored(data, none, p, out)
        return out[0]

    slope = [(energy(np.array(place) + 1e-6 * e) - energy(np.array(place) - 1e-6 * e)) / 2e-6 for e in np.eye(3)]
    assert force == pytest.approx(-np.array(slope), rel=1e-6, abs=1e-6 * np.abs(force).max())


def test_friction_never_exceeds_coulomb_s():
    shape, place = SHAPES["half space"]
    data = numbers(shape)
    n = np.array(shape[1:])
    rng = np.random.default_rng(3)
    for _ in range(200):
        motion = np.concatenate([place, rng.normal(size=6) * 10.0 ** rng.uniform(-4, 1)])
        z = rng.normal(size=3) * 10.0 ** rng.uniform(-6, 0)
        force = wrench(data, z, motion)[:3]
        normal = force @ n
        assert np.linalg.norm(force - normal * n) <= 0.6 * normal * (1.0 + 1e-12)
