"""The superelement of a body: free, with the body's mass and frequencies, and back to a body that moves alike."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from particles import of_unit_mass

import flexmbd as fm
from flexmbd.errors import ExportError, InterfaceError
from flexmbd.export.gram_completion import completed_gram
from flexmbd.export.superelements.superelement_body import reduced_body
from flexmbd.record.point_masses import point_masses

BODIES = [soft_bar, damped_rod, floating_bar, small_body]


def frequencies(K, M):
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True).clip(min=0.0)) / (2.0 * np.pi)


def assert_same(found, expected):
    """Frequencies, as far as eigenvalues are told from round-off of the largest."""
    blur = np.finfo(float).eps * expected.max() ** 2
    np.testing.assert_allclose(found**2, expected**2, rtol=1e-10, atol=4.0 * blur)


@pytest.fixture(params=BODIES, ids=lambda make: make.__name__)
def body(request):
    return request.param()


def test_rigid_motions_cost_nothing_and_have_the_mass_of_the_body(body):
    element = fm.export.superelement(body)
    motions = element.rigid_motions(np.zeros(3))
    for matrix in (element.K, element.D):
        assert abs(matrix @ motions).max() <= 1e-14 * abs(matrix).max()
    rigid = body.mass_matrix()[:6, :6]
    np.testing.assert_allclose(motions.T @ element.M @ motions, rigid, rtol=0.0, atol=1e-13 * abs(rigid).max())


def test_frequencies_are_those_of_the_body(body):
    element = fm.export.superelement(body)
    names, n = element.names, len(element.K)
    assert_same(frequencies(element.K, element.M)[6:], body.frequencies())
    for i, name in enumerate(names):
        rest = [row for row in range(n) if row // 6 != i]
        held = np.ix_(rest, rest)
        assert_same(frequencies(element.K[held], element.M[held]), body.frequencies([name]))
    inside = np.diag(element.K)[6 * len(names) :]
    assert_same(np.sqrt(inside) / (2.0 * np.pi), body.frequencies(names))


def test_modes_are_of_unit_mass_and_apart_from_the_interfaces_in_stiffness(body):
    element = fm.export.superelement(body)
    b = 6 * len(element.names)
    assert not np.any(element.K[:b, b:])
    np.testing.assert_allclose(element.M[b:, b:], np.eye(element.n_modes), rtol=0.0, atol=1e-10)


def test_coordinates_are_the_craig_bampton_ones_of_the_reduction():
    """The frame's motion, the partition's static coordinates relative to it, and its modes up to their signs."""
    body = soft_bar()
    element = fm.export.superelement(body)
    K_cb = np.linalg.inv(body.partition.T) @ np.diag(body.stiffness) @ np.linalg.inv(body.partition)
    assert body.partition_names[0] == "x_max.x"
    np.testing.assert_allclose(element.K[6:12, 6:12], K_cb[:6, :6], rtol=0.0, atol=1e-9 * abs(K_cb[:6, :6]).max())
    M_cb = np.linalg.inv(body.partition.T) @ np.linalg.inv(body.partition)
    static = element.M[6:12, 6:12]
    np.testing.assert_allclose(static, M_cb[:6, :6], rtol=0.0, atol=1e-10 * abs(static).max())


def test_interfaces_that_are_not_named_are_left_free():
    body = soft_bar()
    element = fm.export.superelement(body, interfaces=["x_max"])
    assert element.K.shape == (6 + body.n_modes, 6 + body.n_modes)
    np.testing.assert_allclose(frequencies(element.K, element.M)[6:], body.frequencies(), rtol=1e-9)
    inside = np.sqrt(np.diag(element.K)[6:]) / (2.0 * np.pi)
    np.testing.assert_allclose(inside, body.frequencies(["x_max"]), rtol=1e-9)
    with pytest.raises(InterfaceError, match="no interface 'nose'"):
        fm.export.superelement(body, interfaces=["nose"])


def test_bodies_without_a_superelement_are_refused():
    few = dataclasses.replace(small_body(), frame=None, interfaces=())
    with pytest.raises(ExportError, match="no interface frame"):
        fm.export.superelement(few)
    bar = soft_bar()
    stuck = dataclasses.replace(bar.interface("x_max"), modes=0.0 * bar.interface("x_max").modes)
    with pytest.raises(ExportError, match="do not move its interfaces"):
        fm.export.superelement(dataclasses.replace(bar, interfaces=(bar.interfaces[0], stuck)))


def test_back_to_a_body_with_the_same_small_motions(body):
    element = fm.export.superelement(body)
    back = reduced_body(element, source="here")
    again = fm.export.superelement(back)
    frame = body.frame
    # B's axes are now those of its interface, and where B is the origin
    turn = np.eye(3) if frame is None else body.interface(frame).R_BI
    whole = scipy.linalg.block_diag(*[turn] * (2 * len(element.names)), np.eye(element.n_modes))
    for found, wanted in ((again.K, element.K), (again.M, element.M), (again.D, element.D)):
        wanted = whole.T @ wanted @ whole
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * abs(wanted).max())
    np.testing.assert_allclose(back.stiffness, body.stiffness, rtol=1e-10)
    np.testing.assert_allclose(back.modal_mass(), np.eye(body.n_modes), rtol=0.0, atol=1e-9)
    assert (back.frame, back.partition_names[:1]) == (frame, body.partition_names[:1])


def test_the_completed_gram_matrix_is_one_of_a_mass_distribution(body):
    back = reduced_body(fm.export.superelement(body), source="here")
    size = np.sqrt(np.diag(back.gram))
    assert np.linalg.eigvalsh(back.gram / np.outer(size, size))[0] > -1e-13
    assert abs(point_masses(back).mass.sum() / body.mass - 1.0) < 1e-12


@pytest.mark.parametrize("n", [0, 1, 7])
def test_completion_gives_back_any_mass_matrix(n):
    """Of random fields of point masses: mass matrix alike, Gram matrix positive semidefinite and least in one sense."""
    random = np.random.default_rng(n)
    mass, x = random.uniform(1.0, 2.0, 40), random.normal(size=(40, 3))
    phi = of_unit_mass(random.normal(size=(40, 3, n)), mass)
    fields = np.concatenate([np.ones((40, 1)), x, np.swapaxes(phi, 1, 2).reshape(40, 3 * n)], axis=1)
    gram = fields.T @ (mass[:, None] * fields)
    parts = dict(damping=np.zeros((n, n)), interfaces=(), frame=None, partition=np.eye(n), stiffness=np.ones(n))
    names = tuple(map(str, range(n)))
    body = fm.ReducedBody(gram=gram, partition_names=names, **parts)
    M = body.mass_matrix()
    found = completed_gram(M)
    again = fm.ReducedBody(gram=found, partition_names=names, **parts)
    np.testing.assert_allclose(again.mass_matrix(), M, rtol=0.0, atol=1e-12 * abs(M).max())
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > 0.0


def test_rigid_fields_are_completed_exactly():
    """Modes that are rigid motions, as far as they go: nothing is left to choose."""
    random = np.random.default_rng(3)
    mass, x = random.uniform(1.0, 2.0, 20), random.normal(size=(20, 3))
    motions = [random.normal(size=(2, 3)) for _ in range(3)]
    phi = of_unit_mass(np.stack([shift + np.cross(turn, x) for shift, turn in motions], axis=2), mass)
    fields = np.concatenate([np.ones((20, 1)), x, np.swapaxes(phi, 1, 2).reshape(20, 9)], axis=1)
    gram = fields.T @ (mass[:, None] * fields)
    parts = dict(damping=np.zeros((3, 3)), interfaces=(), frame=None, partition=np.eye(3), stiffness=np.ones(3))
    body = fm.ReducedBody(gram=gram, partition_names=("a", "b", "c"), **parts)
    np.testing.assert_allclose(completed_gram(body.mass_matrix()), gram, rtol=0.0, atol=1e-12 * abs(gram).max())


def refused(match, **changes):
    element = dataclasses.replace(fm.export.superelement(damped_rod()), **changes)
    with pytest.raises(ExportError, match=match):
        reduced_body(element, source="part.x")


def test_matrices_of_no_free_body_are_refused():
    element = fm.export.superelement(damped_rod())
    n = len(element.K)
    refused(r"part\.x: .*stiffness resists rigid motions", K=element.K + np.diag([1e9] * 3 + [0.0] * (n - 3)))
    refused("not that of a free body|resists rigid motions", p=element.p + np.array([[0.0], [0.01]]))
    refused("damping resists rigid motions", D=element.D + 0.1 * element.M)
    refused("matrix K is not symmetric", K=element.K + np.triu(element.K, 7) + np.triu(np.ones((n, n)), 17) * 1e9)
    refused("its mass is 0 kg", M=np.zeros((n, n)))
    refused("not that of a free body", M=element.M + np.diag([1.0] + [0.0] * (n - 1)))
    refused("not positive", K=0.0 * element.K)
    refused("not positive|no elastic body", M=element.M - np.diag([0.0] * 12 + [2.0] * (n - 12)))
