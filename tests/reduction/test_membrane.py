"""What counts as a membrane field, and what follows: no dependence on the basis, whole pairs of equal frequencies."""

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ModesWarning
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import Truncation, craig_bampton
from flexmbd.reduction.stiffening.membrane import membrane_fields


def square_beam(*, ratio=1.0, length=2.5):
    section = beam_timoshenko.Parameters(
        E=1e6, nu=0.3, rho=1.0, A=1.0, Iy=1e-3, Iz=ratio * 1e-3, J=2e-3, ky=1.0, kz=1.0, orientation=(0, 1.0, 0)
    )
    line = meshes.line(length, divisions=8, comm=MPI.COMM_SELF)
    ends = [Interface("start"), Interface("end")]
    return ContinuumModel(line, beam_timoshenko, section, degree=2, interfaces=ends)


def string_and_bends(n, m):
    """T of m strings that n bends stretch, with a noise of the size of a strain."""
    rng = np.random.default_rng(5)
    T = 1e-3 * rng.standard_normal((n + m, n + m, n + m))
    T[n:, :n, :n] += rng.standard_normal((m, n, n))
    return T + T.transpose(0, 2, 1)


def test_what_is_stretched_and_not_what_turns():
    fields = membrane_fields(string_and_bends(5, 3))
    assert fields.shape == (8, 3)
    assert fields.T @ fields == pytest.approx(np.eye(3), abs=1e-14)
    assert abs(fields[:5]).max() < 1e-2


def test_any_basis_has_the_same_fields():
    T = string_and_bends(5, 3)
    turn = np.linalg.qr(np.random.default_rng(6).standard_normal((8, 8)))[0]
    turned = np.einsum("ak,bi,cj,kij->abc", turn, turn, turn, T)
    first, second = turn @ membrane_fields(T), membrane_fields(turned)
    assert second @ second.T == pytest.approx(first @ first.T, abs=1e-12)


def test_nothing_is_stretched_where_there_is_no_second_order():
    assert membrane_fields(np.zeros((4, 4, 4))).shape == (4, 0)
    assert membrane_fields(np.zeros((0, 0, 0))).shape == (0, 0)


def test_directions_of_a_square_beam_are_alike():
    """Bent the same way in any plane it is stretched the same, however the pairs of modes lie."""
    body = craig_bampton(square_beam(), modes=4, frame="start")
    rows = body.interface("end").modes
    size = []
    for angle in np.linspace(0.0, np.pi, 7):
        q = (np.cos(angle) * rows[1] + np.sin(angle) * rows[2]) / body.stiffness
        size.append(np.linalg.norm(np.einsum("i,mij,j->m", q, body.stretch.P, q)))
    assert size == pytest.approx([size[0]] * len(size), rel=1e-8)


@pytest.mark.parametrize(("asked", "kept"), [(3, 4), (4, 4)])
def test_a_pair_is_kept_whole(asked, kept):
    if asked < kept:
        with pytest.warns(ModesWarning, match="1 more than asked for: those at .* Hz have equal frequencies") as told:
            body = craig_bampton(square_beam(), modes=asked, frame="start")
        assert told[0].filename == __file__
        assert body.provenance["equal frequencies"].startswith("4 fixed-interface modes, 1 more than asked for")
    else:
        body = craig_bampton(square_beam(), modes=asked, frame="start")
        assert "equal frequencies" not in body.provenance
    assert body.provenance["fixed-interface modes"] == str(kept)


def test_modes_that_are_no_pair_are_as_many_as_asked_for():
    body = craig_bampton(square_beam(ratio=0.9), modes=3, frame="start")
    assert body.provenance["fixed-interface modes"] == "3"


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # the pair is kept whole
@pytest.mark.parametrize("many", [{"below_hz": None}, {"tol": 0.05}])
def test_a_pair_is_kept_whole_below_a_frequency_and_by_a_tolerance(many):
    """Of a beam whose pairs are a little apart, a bound in the middle of one."""
    model = square_beam(ratio=1.0 - 5e-5)
    four = craig_bampton(model, modes=4, frame="start")
    if "below_hz" in many:
        # clamped at both ends
        third, fourth = (f for f in four.frequencies(["start", "end"])[2:4])
        assert 0.0 < fourth - third < 1e-4 * third
        many = {"below_hz": (third + fourth) / 2}
    body = craig_bampton(model, modes=Truncation(**many), frame="start")
    assert int(body.provenance["fixed-interface modes"]) % 2 == 0
