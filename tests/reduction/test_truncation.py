"""How many modes: by number, below a frequency, by a tolerance; and the estimate against the unreduced model."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from bracket import bracket, transformation
from full_model import FullModel
from slender_beam import UnreducedBeam, bending, slender_beam

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.coupling import Coupling
from flexmbd.errors import ReductionError
from flexmbd.forms import solid_linear, solid_mixed
from flexmbd.reduction import Truncation, craig_bampton, guyan, truncation_errors
from flexmbd.reduction.modes import mode_count, truncation

# Relative errors of a beam's first frequencies by its number n of fixed-interface modes, Craig-Bampton against the
# unreduced beam, of Hermite elements after Euler and Bernoulli.
FREE = {
    0: (1.993e-1, 4.861e-1),
    1: (3.600e-3, 4.861e-1, 6.852e-1),
    2: (3.600e-3, 4.388e-3, 6.852e-1, 8.355e-1),
    3: (4.105e-4, 4.388e-3, 4.273e-3, 8.355e-1, 9.499e-1),
    4: (4.105e-4, 9.188e-4, 4.273e-3, 3.889e-3, 9.499e-1),
    6: (8.635e-5, 2.645e-4, 1.294e-3, 1.505e-3, 3.485e-3),
    8: (2.591e-5, 9.581e-5, 4.644e-4, 6.357e-4, 1.603e-3),
    10: (9.748e-6, 4.081e-5, 1.941e-4, 2.974e-4, 7.655e-4),
}
CANTILEVER = {
    0: (4.754e-3, 5.797e-1),
    1: (3.470e-4, 4.175e-3, 8.971e-1),
    2: (5.838e-5, 1.091e-3, 3.698e-3, 1.077),
    4: (5.410e-6, 1.400e-4, 7.096e-4, 1.633e-3, 2.449e-3),
    6: (1.075e-6, 3.163e-5, 1.855e-4, 5.122e-4, 9.742e-4),
    8: (3.174e-7, 9.958e-6, 6.290e-5, 1.898e-4, 3.997e-4),
}

# What is left of the lowest eigenvalues' digits where the largest one is 1e9 times as large.
ROUND_OFF = 5e-8


@pytest.fixture(scope="module")
def beam():
    return slender_beam(comm=MPI.COMM_SELF)


@pytest.fixture(scope="module")
def unreduced(beam):
    return UnreducedBeam(beam)


@pytest.mark.parametrize(("clamped", "table"), [((), FREE), ((0,), CANTILEVER)])
def test_table_of_a_slender_beam(beam, unreduced, clamped, table):
    """A beam of solids does as the beam of beam theory: each figure within 3 %."""
    _, along = unreduced.modes(20, clamped=(0, 1))
    bent = np.flatnonzero(along > 0.8)
    values, along = unreduced.modes(16, clamped=clamped)
    exact = np.sqrt(values[along > 0.8]) / (2 * np.pi)
    for n, errors in table.items():
        body = craig_bampton(beam, modes=int(bent[n - 1]) + 1 if n > 0 else 0, frame="x_min", geometric_stiffness=False)
        found = bending(body, clamped=bool(clamped))[: len(errors)]
        assert found / exact[: len(errors)] - 1.0 == pytest.approx(errors, rel=0.03, abs=ROUND_OFF)


@pytest.mark.parametrize("held", [False, True])
def test_estimate_is_above_the_true_error_and_close_to_it(beam, unreduced, held):
    """Of the ten lowest frequencies, by Guyan's reduction and with up to 40 modes."""
    exact, _ = unreduced.modes(10, clamped=(0,) if held else ())
    numbers = range(41)
    found = truncation_errors(beam, numbers, frame="x_min", count=10, held=held)
    assert found.modes == tuple(numbers)
    # lower bounds, and close
    assert (found.frequencies <= (1.0 + ROUND_OFF) * np.sqrt(exact) / (2 * np.pi)).all()
    assert found.frequencies == pytest.approx(np.sqrt(exact) / (2 * np.pi), rel=1e-5)
    for n in (0, 1, 2, 3, 5, 8, 13, 21, 40):
        body = craig_bampton(beam, modes=n, frame="x_min", geometric_stiffness=False)
        reduced = (2 * np.pi * body.frequencies(["x_min"] if held else ())[:10]) ** 2
        error = reduced / exact[: len(reduced)] - 1.0
        assert (found.errors[n, : len(reduced)] >= error - ROUND_OFF).all()
        assert (found.errors[n, : len(reduced)] <= 1.1 * error + ROUND_OFF).all()
        assert np.isinf(found.errors[n, len(reduced) :]).all()


def true_errors(model, body, exact, count):
    """Of the eigenvalues of the free body and of that held at its frame."""
    found = [body.frequencies(clamped)[:count] for clamped in ((), [body.frame])]
    return max(((f / e[:count]) ** 2 - 1.0).max() for f, e in zip(found, exact, strict=True))


@pytest.fixture(scope="module")
def model():
    return bracket(comm=MPI.COMM_SELF)


@pytest.fixture(scope="module")
def exact(model):
    """Elastic frequencies of the unreduced bracket with rigid interfaces: free, held at its root, at all; dense."""
    full = FullModel(model)
    t = transformation(full, axes=np.eye(3))
    k, m = (t.T @ full.K @ t).toarray(), (t.T @ full.M @ t).toarray()
    root = 6 * [one.name for one in model.interfaces].index("root")
    held = np.setdiff1d(np.arange(len(k)), np.arange(root, root + 6))
    spectra = []
    for some, rigid in ((np.arange(len(k)), 6), (held, 0), (np.arange(18, len(k)), 0)):
        values = scipy.linalg.eigh(k[np.ix_(some, some)], m[np.ix_(some, some)], eigvals_only=True)
        spectra.append(np.sqrt(values[rigid:]) / (2 * np.pi))
    return spectra


@pytest.mark.parametrize("tol", [0.3, 1e-2, 1e-3, 1e-5])
def test_tolerance_is_kept_with_as_few_modes_as_can_be(model, exact, tol):
    body = craig_bampton(model, modes=Truncation(tol=tol), frame="root", geometric_stiffness=False)
    error = true_errors(model, body, exact[:2], truncation.LOWEST)
    assert error <= tol
    estimate = float(body.provenance["estimated error of eigenvalues"])
    assert error < estimate < 2.0 * error
    n = int(body.provenance["fixed-interface modes"])
    assert n > 0
    worse = craig_bampton(model, modes=n - 1, frame="root", geometric_stiffness=False)
    # as far as the estimate is close
    assert true_errors(model, worse, exact[:2], truncation.LOWEST) > 0.9 * tol
    by_number = craig_bampton(model, modes=n, frame="root", geometric_stiffness=False)
    assert body.stiffness == pytest.approx(by_number.stiffness, rel=1e-10)


@pytest.mark.parametrize("range_of", [1, 5, 12])
def test_tolerance_below_a_frequency(model, exact, range_of):
    """The frequencies below it and no others; of the free and of the held body."""
    below = 0.5 * (exact[0][range_of - 1] + exact[0][range_of])
    body = craig_bampton(model, modes=Truncation(tol=1e-3, below_hz=below), frame="root", geometric_stiffness=False)
    assert body.provenance["tolerance of eigenvalues"] == f"0.001 of the frequencies below {below:g} Hz"
    for clamped, spectrum in zip(((), ["root"]), exact, strict=False):
        inside = spectrum[spectrum < below]
        assert ((body.frequencies(clamped)[: len(inside)] / inside) ** 2 - 1.0).max(initial=0.0) <= 1e-3
    by_number = craig_bampton(model, modes=Truncation(tol=1e-3), frame="root", geometric_stiffness=False)
    assert (body.n_modes > by_number.n_modes) == (range_of > truncation.LOWEST)


def test_tolerance_where_only_the_held_body_has_frequencies(model, exact):
    """Three of them below the free body's first; with Guyan's reduction the third is far off."""
    below = 0.95 * exact[0][0]
    inside = exact[1][exact[1] < below]
    assert len(inside) == 3
    body = craig_bampton(model, modes=Truncation(tol=3e-3, below_hz=below), frame="root", geometric_stiffness=False)
    error = ((body.frequencies(["root"])[:3] / inside) ** 2 - 1.0).max()
    assert error <= 3e-3
    assert error < float(body.provenance["estimated error of eigenvalues"]) < 1.1 * error
    coarse = guyan(model, frame="root", geometric_stiffness=False).frequencies(["root"])[:3]
    assert ((coarse / inside) ** 2 - 1.0).max() > 3e-3


@pytest.mark.parametrize("count", [1, 2, 9, 30])
def test_all_modes_below_a_frequency(model, exact, count):
    """As many as the unreduced body has with all interfaces fixed."""
    below = 0.5 * (exact[2][count - 1] + exact[2][count])
    body = craig_bampton(model, modes=Truncation(below_hz=below), frame="root", geometric_stiffness=False)
    assert body.provenance["fixed-interface modes"] == str(count)
    assert body.provenance["modes below"] == f"{below:g} Hz"
    by_number = craig_bampton(model, modes=count, frame="root", geometric_stiffness=False)
    assert body.stiffness == pytest.approx(by_number.stiffness, rel=1e-10)


def square_bar(comm, *interfaces, divisions=(8, 2, 2)):
    """A bar of square section, whose bending frequencies come in pairs."""
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=divisions, comm=comm)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    return ContinuumModel(mesh, solid_linear, steel, degree=1, interfaces=list(interfaces))


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [1.01, 4.0, 9.0])
def test_equal_frequencies_are_all_found(factor):
    """Counted by the signs of a dense factorisation of K - sigma M (Sylvester)."""
    model = square_bar(MPI.COMM_WORLD, Interface("x_min"))
    full = FullModel(model)
    free = np.repeat(full.x[:, 0] > 1e-9, 3)
    k, m = (matrix[free][:, free].toarray() for matrix in (full.K, full.M))
    below = factor * np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=(0, 0))[0]) / (2 * np.pi)
    _, d, _ = scipy.linalg.ldl(k - (2 * np.pi * below) ** 2 * m)
    inertia = int(np.sum(np.linalg.eigvalsh(d) < 0.0))
    body = craig_bampton(model, modes=Truncation(below_hz=below), frame="x_min", geometric_stiffness=False)
    assert body.n_modes == inertia > 1
    assert body.stiffness[0] == pytest.approx(body.stiffness[1], rel=1e-10)


BODIES = {
    "attached": ([Interface("x_min"), Interface("x_max")], "x_min"),
    "floating": ([Interface("x_min"), Interface("x_max")], None),
    "averaged": ([Interface("x_min"), Interface("x_max", coupling=Coupling.AVERAGED)], "x_min"),
    "averages alone": ([Interface(end, coupling=Coupling.AVERAGED) for end in ("x_min", "x_max")], "x_max"),
    "one interface": ([Interface("x_min")], "x_min"),
    "no interface": ([], None),
}


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # of very many
@pytest.mark.mpi
@pytest.mark.parametrize("name", BODIES)
def test_tolerance_of_every_kind_of_body(name):
    """Against the same body with very many modes; the same on any number of ranks."""
    interfaces, frame = BODIES[name]
    model = square_bar(MPI.COMM_WORLD, *interfaces)
    body = craig_bampton(model, modes=Truncation(tol=1e-3), frame=frame, geometric_stiffness=False)
    fine = craig_bampton(model, modes=150, frame=frame, geometric_stiffness=False)
    reduced, better = body.frequencies()[:6], fine.frequencies()[:6]
    error = ((reduced / better) ** 2 - 1.0).max()
    estimate = float(body.provenance["estimated error of eigenvalues"])
    assert -1e-11 < error <= estimate <= 1e-3
    if frame is None:
        # nothing but the free body was estimated; without interfaces nothing is left out
        assert estimate < 2.0 * error + 2e-12
    serial = square_bar(MPI.COMM_SELF, *interfaces)
    alone = craig_bampton(serial, modes=Truncation(tol=1e-3), frame=frame, geometric_stiffness=False)
    assert alone.stiffness == pytest.approx(body.stiffness, rel=1e-10)


@pytest.mark.mpi
def test_tolerance_of_an_incompressible_body():
    """An indefinite stiffness, and pressures without mass; against many more modes."""
    mesh = meshes.block(1.0, 0.1, 0.15, divisions=(4, 1, 1), cell="tetrahedron")
    rubber = solid_mixed.Parameters(E=1e7, nu=0.5, rho=1000.0)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_mixed, rubber, degree=2, interfaces=ends)
    body = craig_bampton(model, modes=Truncation(tol=1e-2), frame="x_min", geometric_stiffness=False)
    fine = craig_bampton(model, modes=120, frame="x_min", geometric_stiffness=False)
    error = ((body.frequencies()[:6] / fine.frequencies()[:6]) ** 2 - 1.0).max()
    assert 0.0 < error <= float(body.provenance["estimated error of eigenvalues"]) <= 1e-2


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "exactly one of modes .*, below_hz .* and tol .*, got none of them"),
        ({"modes": 3, "below_hz": 100.0}, "got modes and below_hz"),
        ({"modes": 3, "tol": 1e-3}, "got modes and tol"),
        ({"modes": 3, "tol": 1e-3, "below_hz": 100.0}, "got modes and below_hz and tol"),
        ({"below_hz": 0.0}, "below_hz must be a positive frequency in Hz, got 0.0"),
        ({"below_hz": float("nan")}, "below_hz must be a finite number or None, got nan"),
        ({"below_hz": "100"}, "below_hz must be a finite number or None, got '100'"),
        ({"tol": 0.0}, "tol must be a relative error between 1e-12, .*, and 1, got 0.0"),
        ({"tol": 1.0}, "and 1, got 1.0"),
        ({"tol": 1e-3, "below_hz": -1.0}, "below_hz must be a positive frequency in Hz, got -1.0"),
        ({"below_hz": 50.0}, r"no mode with all interfaces fixed lies below 50 Hz: the first has 666.317 Hz; raise"),
        ({"tol": 0.1, "below_hz": 50.0}, r"no elastic frequency below 50 Hz, .*: the first has 107.41 Hz"),
    ],
)
def test_what_cannot_be_is_refused_on_all_ranks(arguments, message):
    model = square_bar(MPI.COMM_WORLD, Interface("x_min"), Interface("x_max"))
    with pytest.raises(ReductionError, match=message):
        craig_bampton(model, modes=Truncation(**arguments), frame="x_min")
    # and the model is as good as before
    assert guyan(model, frame="x_min").n_modes == 6


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tol": 1e-9}, r"no number of modes up to 40 brings the error of the 6 lowest .* up to [1-9]\.\d\de-0[3-8];"),
        ({"below_hz": 1e5, "complete": False}, r"more than 40 modes below 100000 Hz"),
        ({"tol": 1e-3, "below_hz": 1e5}, r"more than 40 modes below 141421 Hz"),
    ],
)
def test_more_modes_than_one_may_want(monkeypatch, arguments, message):
    monkeypatch.setattr(mode_count, "MOST", 40)
    model = square_bar(MPI.COMM_WORLD, Interface("x_min"), Interface("x_max"))
    with pytest.raises(ReductionError, match=message):
        craig_bampton(model, modes=Truncation(**arguments), frame="x_min", geometric_stiffness=False)


@pytest.mark.mpi
def test_all_modes_fulfil_any_tolerance():
    """Of a body so small that nothing is left out."""
    model = square_bar(MPI.COMM_WORLD, Interface("x_min"), Interface("x_max"), divisions=(3, 1, 1))
    body = craig_bampton(model, modes=Truncation(tol=1e-9), frame="x_min", geometric_stiffness=False)
    assert int(body.provenance["fixed-interface modes"]) <= 24
    assert float(body.provenance["estimated error of eigenvalues"]) < 1e-9


@pytest.mark.mpi
def test_different_numbers_on_different_ranks():
    comm = MPI.COMM_WORLD
    if comm.size == 1:
        pytest.skip("takes two ranks")
    model = square_bar(comm, Interface("x_min"))
    with pytest.raises(ReductionError, match=r"modes is 3 on rank 0 and 4 on rank 1; give the same"):
        craig_bampton(model, modes=3 + comm.rank, frame="x_min")
    one_bad = -1 if comm.rank == 1 else 3
    with pytest.raises(ReductionError, match=r"modes is 3 on rank 0 and -1 on rank 1"):
        craig_bampton(model, modes=one_bad, frame="x_min")


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"modes": [2, -1]}, "from 0 on, got -1"),
        ({"modes": [2, 10_000]}, "10000 fixed-interface modes were asked for"),
        ({"count": 0}, "count must be a whole number from 1 on, got 0"),
        ({"frame": None, "held": True}, "the body cannot be held in a frame that floats"),
    ],
)
def test_estimates_that_cannot_be_had(arguments, message):
    model = square_bar(MPI.COMM_WORLD, Interface("x_min"))
    with pytest.raises(ReductionError, match=message):
        truncation_errors(model, **{"modes": [1], "frame": "x_min", **arguments})
