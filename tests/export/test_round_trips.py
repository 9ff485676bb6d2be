"""Every format with a reader: a body that is written and read back is the same body, whatever its coordinates are.

A format is tested here by being listed in FORMATS, to the digits that it states there.
"""

import dataclasses

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar

import flexmbd as fm

READABLE = [one for one in fm.export.FORMATS if one.read is not None]


@pytest.fixture(scope="module", params=[soft_bar, damped_rod], ids=lambda make: make.__name__)
def body(request):
    return request.param()


@pytest.fixture(params=READABLE, ids=lambda one: one.name)
def trip(request, body, tmp_path):
    """(format, body, what came back)."""
    one = request.param
    path = tmp_path / f"söme body{one.suffix}"
    one.write(body, path, lossy=True)
    return one, body, one.read(path)


def close(found, wanted, *, digits):
    np.testing.assert_allclose(found, wanted, rtol=10.0**-digits, atol=10.0**-digits * np.abs(wanted).max())


def common(wanted, back):
    """Names of the interfaces that came back."""
    names = [frame.name for frame in back.interfaces]
    assert set(names) <= {frame.name for frame in wanted.interfaces}
    return names


def receptance(body, names, omega, *, rotations, damped):
    """Motion of free interfaces, in their own axes, per oscillating force on them: no matter of coordinates."""
    n = body.n_modes
    rows = []
    for frame in map(body.interface, names):
        x, y, z = frame.p_BI_B
        motion = np.zeros((6, 6 + n))
        motion[:3, :3] = motion[3:, 3:6] = np.eye(3)
        motion[:3, 3:6] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        motion[:, 6:] = frame.modes
        turned = np.kron(np.eye(2), frame.R_BI.T) @ motion
        rows.append(turned if rotations else turned[:3])
    rows = np.vstack(rows)
    dynamic = -(omega**2) * body.mass_matrix().astype(complex)
    dynamic[6:, 6:] += np.diag(body.stiffness) + (1j * omega * body.damping if damped else 0.0)
    return rows @ np.linalg.solve(dynamic, rows.T)  # type: ignore[attr-defined]


def test_mass_and_frequencies(trip):
    one, wanted, back = trip
    names = common(wanted, back)
    if one.capabilities.interfaces is None:
        assert names == [frame.name for frame in wanted.interfaces]
    close(back.mass, wanted.mass, digits=one.digits)
    close(np.linalg.eigvalsh(back.inertia), np.linalg.eigvalsh(wanted.inertia), digits=one.digits)
    close(back.frequencies(), wanted.frequencies(), digits=one.digits)
    if one.capabilities.rotations:
        close(back.frequencies(names[:1]), wanted.frequencies(names[:1]), digits=one.digits)


def test_centre_from_each_interface(trip):
    one, wanted, back = trip
    for name in common(wanted, back):
        there, here = back.interface(name), wanted.interface(name)
        found, right = there.R_BI.T @ (back.com - there.p_BI_B), here.R_BI.T @ (wanted.com - here.p_BI_B)
        np.testing.assert_allclose(found, right, rtol=0.0, atol=10.0**-one.digits * np.abs(wanted.com).max())


def test_motion_of_interfaces_under_forces(trip):
    one, wanted, back = trip
    names = common(wanted, back)
    rates = 2.0 * np.pi * wanted.frequencies()[:3]
    for omega in (0.3 * rates[0], 0.5 * (rates[0] + rates[1]), 0.5 * (rates[1] + rates[2])):
        options = dict(rotations=one.capabilities.rotations, damped=one.capabilities.damping)
        found, right = (receptance(body, names, omega, **options) for body in (back, wanted))
        # a force's work and a moment's are measured against what they do at their own frame
        size = np.sqrt(np.abs(np.diag(right)))
        np.testing.assert_allclose(
            found / np.outer(size, size), right / np.outer(size, size), rtol=0.0, atol=10.0 ** (1 - one.digits)
        )


def responses(body, names):
    """(n, k) modal coordinates of deformed shapes that do not depend on the basis: under loads on the interfaces."""
    loads = np.vstack([body.interface(name).modes for name in names]).T
    shifts = np.array([0.0, 1.0, 30.0]) * body.stiffness[0]
    return np.hstack([loads / (body.stiffness + shift)[:, None] for shift in shifts])


def test_inertia_integrals(trip):
    """All entries of the Gram matrix, seen by shapes that do not depend on the modes' signs and rotations."""
    one, wanted, back = trip
    if not one.capabilities.large_motion:
        return
    names = common(wanted, back)
    grams = []
    for body in (back, wanted):
        shapes = responses(body, names)
        fields = np.zeros((4 + 3 * body.n_modes, 4 + 3 * shapes.shape[1]))
        fields[:4, :4] = np.eye(4)
        fields[4:, 4:] = np.kron(shapes, np.eye(3))
        grams.append(fields.T @ body.gram @ fields)
    squares = np.diag(grams[1])
    triples = np.repeat(squares[1:].reshape(-1, 3).sum(axis=1), 3)
    size = np.sqrt(np.concatenate([squares[:1], np.where(triples > 0.0, triples, 1.0)]))
    found, right = (gram / np.outer(size, size) for gram in grams)
    np.testing.assert_allclose(found, right, rtol=0.0, atol=10.0**-one.digits)


def test_a_wrong_body_would_be_seen(body):
    """One integral of two modes, one mode's sign at one interface, a millimetre: each changes what is compared."""
    name = body.interfaces[1].name
    frame = body.interface(name)
    names = [one.name for one in body.interfaces]
    right = receptance(body, names, 5.0, rotations=True, damped=True)
    size = np.sqrt(np.abs(np.diag(right)))
    moved = dataclasses.replace(frame, p_BI_B=frame.p_BI_B + np.array([1e-3, 0.0, 0.0]))
    turned = dataclasses.replace(frame, modes=frame.modes * np.where(np.arange(body.n_modes) == 0, -1.0, 1.0))
    for other in (moved, turned):
        changed = dataclasses.replace(body, interfaces=(body.interfaces[0], other))
        found = receptance(changed, names, 5.0, rotations=True, damped=True)
        assert np.abs((found - right) / np.outer(size, size)).max() > 1e-4
