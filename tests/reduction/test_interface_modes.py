"""Characteristic constraint modes of a plate with six flanges, and free modes, against the unreduced plate."""

import numpy as np
import pytest
import scipy.linalg
from flanged_plate import PITCH, flanged_plate
from full_model import FullModel

from flexmbd import errors
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ReductionError
from flexmbd.reduction import InterfaceModes, Keep, KrylovSchur, Truncation, craig_bampton, guyan, truncation_errors

FRAME, MODES = "flange_1", 12


@pytest.fixture(scope="module")
def plate():
    return flanged_plate(2, 3)


@pytest.fixture(scope="module")
def unreduced(plate):
    """Lowest elastic eigenvalues of the plate with rigid flanges, free and held at the first."""
    full = FullModel(plate)
    frames = []
    for one in plate.interfaces:
        on = (abs(full.x[:, 2]) < 1e-9) & (abs(full.x[:, :2] - one.p[:2]) < 0.51 * PITCH).all(axis=1)
        frames.append((on, one.p))
    x = full.bound(frames)
    k, m = ((x.T @ matrix @ x).toarray() for matrix in (full.K, full.M))
    free = scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=(6, 11))
    held = scipy.linalg.eigh(k[6:, 6:], m[6:, 6:], eigvals_only=True, subset_by_index=(0, 5))
    return free, held


@pytest.fixture(scope="module")
def whole(plate):
    return craig_bampton(plate, modes=MODES, frame=FRAME, geometric_stiffness=False)


def eigenvalues(body):
    return [(2 * np.pi * body.frequencies(clamped)[:6]) ** 2 for clamped in ((), (FRAME,))]


def largest(found, expected):
    return max(float((one / other - 1.0).max()) for one, other in zip(found, expected, strict=True))


@pytest.mark.mpi
@pytest.mark.parametrize("tol", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("joints", [(), ("flange_6", "flange_3")])
def test_tolerance(plate, whole, unreduced, tol, joints):
    """What is added is that; with the estimate for the modes it is above the true error, and not far."""
    choice = InterfaceModes(Truncation(tol=tol), joints=joints)
    body = craig_bampton(plate, modes=MODES, frame=FRAME, geometric_stiffness=False, interface_modes=choice)
    added = largest(eigenvalues(body), eigenvalues(whole))
    assert added <= tol
    told = body.provenance["error of eigenvalues added by them"].split()[0]
    assert added == pytest.approx(float(told), rel=0.01, abs=1e-8)
    assert body.n_modes < whole.n_modes
    interior = max(truncation_errors(plate, [MODES], frame=FRAME, held=held).errors.max() for held in (False, True))
    estimate, true = (1 + interior) * (1 + added) - 1, largest(eigenvalues(body), unreduced)
    assert true <= estimate < 3 * true


@pytest.mark.mpi
def test_kept_frames_are_exact_in_statics(plate, whole):
    """Forces on joints find the flexibility of all static shapes."""
    joints = ("flange_4", "flange_6")
    choice = InterfaceModes(3, joints=joints)
    body = craig_bampton(plate, modes=2, frame=FRAME, geometric_stiffness=False, interface_modes=choice)
    assert [one.name for one in body.interfaces] == [FRAME, *joints]
    assert body.n_modes == 12 + 3 + 2
    rows, expected = (np.vstack([one.interface(name).modes for name in joints]) for one in (body, whole))
    flexibility = rows / body.stiffness @ rows.T
    assert flexibility == pytest.approx(expected / whole.stiffness @ expected.T, rel=1e-9, abs=1e-15)
    assert body.mass == pytest.approx(whole.mass, rel=1e-12)
    assert body.partition_names[12:15] == ("interface mode 1", "interface mode 2", "interface mode 3")
    assert body.provenance["interfaces without frames"] == "flange_2, flange_3, flange_5"
    motion = body.partition[:12] @ np.eye(body.n_modes)
    assert motion == pytest.approx(rows, rel=1e-12, abs=1e-12)


@pytest.mark.mpi
def test_floating_local_and_below(plate):
    floating = craig_bampton(plate, modes=MODES, interface_modes=InterfaceModes(18), geometric_stiffness=False)
    held = craig_bampton(plate, modes=MODES, frame=FRAME, interface_modes=InterfaceModes(18), geometric_stiffness=False)
    assert floating.frequencies()[:10] == pytest.approx(held.frequencies()[:10], rel=1e-8)
    local = craig_bampton(plate, modes=4, frame=FRAME, interface_modes=InterfaceModes(30, local=True))
    every = craig_bampton(plate, modes=4, frame=FRAME)
    assert local.frequencies()[:10] == pytest.approx(every.frequencies()[:10], rel=1e-8)
    # their own frequencies: Guyan's plate held at its frame
    lowest = guyan(plate, frame=FRAME, geometric_stiffness=False).frequencies([FRAME])
    limit = 0.5 * (lowest[6] + lowest[7])
    choice = InterfaceModes(Truncation(below_hz=limit))
    below = craig_bampton(plate, modes=0, frame=FRAME, geometric_stiffness=False, interface_modes=choice)
    assert below.frequencies([FRAME]) == pytest.approx(lowest[:7], rel=1e-9)


def test_stress_modes_know_nodes_of_reduced_interfaces(plate):
    kept = craig_bampton(plate, modes=2, frame="flange_2", keep=Keep(stress=True))
    body = craig_bampton(plate, modes=2, frame="flange_2", interface_modes=InterfaceModes(4), keep=Keep(stress=True))
    assert kept.interfaces[0].name == "flange_2"
    assert ((kept.stress.interface >= 0) == (body.stress.interface >= 0)).all()
    # in the record's order
    near = abs(kept.stress.x).max(axis=1) < 0.51 * PITCH
    assert (kept.stress.interface[near & (abs(kept.stress.x[:, 2]) < 1e-9)] == 0).all()


@pytest.mark.mpi
@pytest.mark.parametrize("frame", [FRAME, None])
def test_free_modes_are_exact(plate, whole, unreduced, frame):
    """As many frequencies of the free plate as modes, exactly, beside the same flexibility where it is held."""
    body = craig_bampton(plate, modes=Truncation(6, free=True), frame=frame)
    assert (2 * np.pi * body.frequencies()[:6]) ** 2 == pytest.approx(unreduced[0], rel=1e-8)
    fixed = craig_bampton(plate, modes=6, frame=frame)
    assert largest([(2 * np.pi * fixed.frequencies()[:6]) ** 2], unreduced[:1]) > 1e-4
    if frame is not None:
        rows, expected = (np.vstack([face.modes for face in one.interfaces]) for one in (body, fixed))
        expected = expected / fixed.stiffness @ expected.T
        assert rows / body.stiffness @ rows.T == pytest.approx(expected, rel=1e-8, abs=1e-15)
    assert body.partition_names[30] == "free-interface 1"
    assert body.stretch is not None


def test_free_modes_below(plate, unreduced):
    found = np.sqrt(unreduced[0]) / (2 * np.pi)
    limit = 0.5 * (found[2] + found[3])
    body = craig_bampton(plate, modes=Truncation(below_hz=limit, free=True), frame=FRAME, geometric_stiffness=False)
    assert body.n_modes == 30 + 3


@pytest.mark.mpi
def test_wrong_arguments(plate):
    def refused(what, error=ReductionError, **changed):
        given = {"modes": 2, "frame": FRAME, **changed}
        with pytest.raises(error, match=what):
            craig_bampton(plate, **given)

    refused("interface_modes must be InterfaceModes", interface_modes=4)
    refused("there are 30", interface_modes=InterfaceModes(31))
    refused("joints names 'tip'", interface_modes=InterfaceModes(2, joints=["tip"]))
    refused("twice", interface_modes=InterfaceModes(2, joints=["flange_2", "flange_2"]))
    refused("none is left", interface_modes=InterfaceModes(2, joints=[f"flange_{i}" for i in range(2, 7)]))
    refused("modes must be a whole number", interface_modes=InterfaceModes(-1))
    with pytest.raises(ReductionError, match="joints must be a list, each a text"):
        InterfaceModes(2, joints="flange_2")
    refused("the body's own modes", interface_modes=InterfaceModes(Truncation(3, free=True)))
    refused("beside free=True", modes=Truncation(tol=1e-2, free=True))
    refused("BlockMethod", modes=Truncation(2, free=True), eigensolver=KrylovSchur())
    refused("free modes were asked", modes=Truncation(5000, free=True))
    form, faces = plate.groups[0].formulation, [Interface(FRAME)]
    alone = ContinuumModel(plate.mesh, form, plate.parameters, degree=2, interfaces=faces)
    with pytest.raises(ReductionError, match="none is left"):
        craig_bampton(alone, modes=2, frame=FRAME, interface_modes=InterfaceModes(1))
    body = craig_bampton(plate, modes=2, frame=FRAME, interface_modes=InterfaceModes(3))
    with pytest.raises(errors.InterfaceError, match="no interface 'flange_2'"):
        body.interface("flange_2")
