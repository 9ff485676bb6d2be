"""The record of a reduced body, against a body of point masses worked out by hand."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from particles import of_unit_mass
from two_crosses_body import (
    AT_A,
    AT_B,
    CROSS,
    MASS_A,
    MASS_B,
    MASSES,
    POINTS,
    QUARTER,
    SHAPE_B,
    SPRING,
    TORSION,
    TURN_A,
    TURN_B,
    displacements,
    two_crosses,
    with_groups,
)

from flexmbd.errors import InterfaceError, RecordError
from flexmbd.files.tree_file import read_tree, write_tree
from flexmbd.record.file_kind import RECORD
from flexmbd.record.reduced_body import InterfaceFrame, NodalModes, ReducedBody


def hertz(*eigenvalues):
    return np.sort(np.sqrt(eigenvalues)) / (2 * np.pi)


def test_mass_centre_inertia():
    body = two_crosses()
    assert body.n_modes == 2
    assert body.mass == pytest.approx(10.0)
    assert body.com == pytest.approx([0.2, 0.0, 0.0])
    across = 10.0 * 0.3**2 / 2 + 8.0 * 0.2**2 + 2.0 * 0.8**2
    assert np.allclose(body.inertia, np.diag([10.0 * 0.3**2, across, across]), atol=1e-14)


def test_mass_matrix_is_that_of_the_points():
    """Velocities of the points by the generalised ones, J, and the sum of J^T m J."""
    body = two_crosses()
    jacobian = np.zeros((8, 3, 8))
    jacobian[:, :, :3] = np.eye(3)
    for axis in range(3):
        jacobian[:, :, 3 + axis] = np.cross(np.eye(3)[axis], POINTS - AT_A)
    jacobian[:, :, 6:] = displacements()[..., ::-1]
    expected = np.einsum("pia,p,pib->ab", jacobian, MASSES, jacobian)
    assert abs(body.mass_matrix() - expected).max() < 1e-14
    assert abs(body.modal_mass() - np.eye(2)).max() < 1e-15


def test_mass_matrix_of_points_without_any_symmetry():
    rng = np.random.default_rng(4)
    points, masses = rng.normal(size=(9, 3)), rng.uniform(1, 2, 9)
    phi = of_unit_mass(rng.normal(size=(9, 3, 2)), masses)
    fields = np.concatenate([np.ones((9, 1)), points, phi[..., 0], phi[..., 1]], axis=1)
    body = two_crosses(gram=(fields * masses[:, None]).T @ fields)
    jacobian = np.zeros((9, 3, 8))
    jacobian[:, :, :3] = np.eye(3)
    for axis in range(3):
        jacobian[:, :, 3 + axis] = np.cross(np.eye(3)[axis], points)
    jacobian[:, :, 6:] = phi
    expected = np.einsum("pia,p,pib->ab", jacobian, masses, jacobian)
    assert abs(body.mass_matrix() - expected).max() < 1e-13
    arm = points - masses @ points / masses.sum()
    inertia = np.einsum("p,pij->ij", masses, np.sum(arm**2, 1)[:, None, None] * np.eye(3))
    assert abs(body.inertia - (inertia - (arm.T * masses) @ arm)).max() < 1e-13


def test_free_frequencies():
    """Two masses, and two inertias, on a spring: k (1/a + 1/b)."""
    expected = hertz(SPRING * (1 / MASS_A + 1 / MASS_B), TORSION * (1 / TURN_A + 1 / TURN_B))
    assert two_crosses().frequencies() == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(
    ("clamped", "expected"),
    [
        (["A"], [SPRING / MASS_B, TORSION / TURN_B]),
        (["B"], [SPRING / MASS_A, TORSION / TURN_A]),
        (["A", "B"], []),
        ({"A": ("x",)}, [SPRING / MASS_B, TORSION * (1 / TURN_A + 1 / TURN_B)]),
        ({"A": "xyz", "B": ()}, [SPRING / MASS_B, TORSION * (1 / TURN_A + 1 / TURN_B)]),
        # in the axes of B's own frame, turned about x: x stays x
        ({"A": ("rx", "y", "z", "ry", "rz"), "B": ("x",)}, [SPRING / MASS_A, TORSION / TURN_B]),
        ({"A": ("x", "ry"), "B": ("x", "rx", "z", "y")}, [TORSION / TURN_A]),
    ],
)
def test_supported_frequencies(clamped, expected):
    assert two_crosses().frequencies(clamped) == pytest.approx(hertz(*expected), rel=1e-13)


def test_components_are_in_the_axes_of_the_interface():
    """A mode across: held along the y of B's frame, which is the body's z, or along its z."""
    across = np.zeros((6, 2))
    across[2, 0], across[3, 1] = SHAPE_B[0, 0], SHAPE_B[3, 1]
    phi = displacements()[..., [1, 0]]
    phi[4:, :, 1] = [0.0, 0.0, SHAPE_B[0, 0]]
    fields = np.concatenate([np.ones((8, 1)), POINTS - AT_A, phi[..., 0], phi[..., 1]], axis=1)
    modes = across[:, ::-1]
    body = two_crosses(
        gram=(fields * MASSES[:, None]).T @ fields,
        interfaces=(
            InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 2))),
            InterfaceFrame("B", AT_B - AT_A, QUARTER, modes),
        ),
    )
    held = {"A": ("x", "y", "z", "rx", "ry", "rz")}
    torsion, bending = TORSION / TURN_B, SPRING / MASS_B
    assert body.frequencies({**held, "B": "y"}) == pytest.approx(hertz(torsion), rel=1e-13)
    assert body.frequencies({**held, "B": "z"}) == pytest.approx(hertz(torsion, bending), rel=1e-13)


def stable_roots(total, product):
    """Both roots of x^2 - total x + product, the small one to the last digit too."""
    large = (total + np.sqrt(total**2 - 4 * product)) / 2
    return product / large, large


def test_low_frequencies_keep_their_digits_beside_stiff_modes():
    """Crosses A, B, C in a row, the spring from B to C 1e11 times as stiff as that from A to B."""
    masses = np.array([8.0, 2.0, 3.0])
    soft, stiff = 5.0e4, 5.0e15
    low, high = stable_roots((soft + stiff) / 2.0 + stiff / 3.0, soft * stiff / 6.0)
    points = np.vstack([CROSS + np.array([x, 0.0, 0.0]) for x in (0.0, 1.0, 2.0)])
    phi = np.zeros((12, 3, 2))
    for i, eigenvalue in enumerate((low, high)):
        along = np.array([0.0, 1.0 - eigenvalue * 3.0 / stiff, 1.0])
        phi[:, 0, i] = np.repeat(along / np.sqrt(masses @ along**2), 4)
    fields = np.concatenate([np.ones((12, 1)), points, phi[..., 0], phi[..., 1]], axis=1)
    body = ReducedBody(
        gram=(fields * np.repeat(masses / 4, 4)[:, None]).T @ fields,
        stiffness=np.array([low, high]),
        damping=np.zeros((2, 2)),
        interfaces=(InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 2))),),
        frame="A",
        partition=np.eye(2),
        partition_names=("one", "other"),
    )
    total = soft * (1 / 8.0 + 1 / 2.0) + stiff * (1 / 2.0 + 1 / 3.0)
    free = stable_roots(total, soft * stiff * 13.0 / 48.0)
    assert body.frequencies() == pytest.approx(hertz(*free), rel=1e-12)


def test_a_line_of_masses_has_no_inertia_about_itself():
    """Its bending has, k / 1; a turn about the line is a rigid motion like others."""
    x = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    phi = np.zeros((3, 3))
    phi[:, 2] = np.array([1.0, -2.0, 1.0]) / np.sqrt(6.0)
    fields = np.concatenate([np.ones((3, 1)), x, phi], axis=1)
    body = ReducedBody(
        gram=fields.T @ fields,
        stiffness=np.array([1e4]),
        damping=np.zeros((1, 1)),
        interfaces=(InterfaceFrame("end", np.zeros(3), np.eye(3), np.zeros((6, 1))),),
        frame="end",
        partition=np.eye(1),
        partition_names=("one",),
    )
    assert body.frequencies() == pytest.approx(hertz(1e4), rel=1e-13)
    assert body.frequencies({"end": ("x", "y", "z")}) == pytest.approx(hertz(1e4), rel=1e-12)


def test_a_deformation_that_moves_no_mass_has_no_frequency():
    """Two masses 2 m apart and a third, 0.2 m off their line, that a mode turns about it as the body turns."""
    x = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.2, 0.0]])
    phi = np.zeros((3, 3, 2))
    phi[:, 0, 0] = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
    phi[2, 2, 1] = 1.0
    fields = np.concatenate([np.ones((3, 1)), x, phi[..., 0], phi[..., 1]], axis=1)
    body = ReducedBody(
        gram=fields.T @ fields,
        stiffness=np.array([1e4, 4e4]),
        damping=np.zeros((2, 2)),
        interfaces=(InterfaceFrame("end", np.zeros(3), np.eye(3), np.zeros((6, 2))),),
        frame="end",
        partition=np.eye(2),
        partition_names=("one", "other"),
    )
    assert body.frequencies() == pytest.approx(hertz(1e4), rel=1e-12)
    assert body.frequencies(["end"]) == pytest.approx(hertz(1e4, 4e4), rel=1e-12)


def test_body_without_modes(tmp_path):
    rigid = two_crosses(
        gram=two_crosses().gram[:4, :4],
        stiffness=np.zeros(0),
        damping=np.zeros((0, 0)),
        interfaces=(InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 0))),),
        partition=np.zeros((0, 0)),
        partition_names=(),
    )
    assert rigid.mass_matrix().shape == (6, 6)
    assert rigid.frequencies().shape == rigid.frequencies(["A"]).shape == (0,)
    rigid.save(tmp_path / "body.h5")
    assert_same(rigid, ReducedBody.load(tmp_path / "body.h5"))


def test_interface_by_name():
    body = two_crosses()
    assert body.interface("B").p_BI_B == pytest.approx([1.0, 0.0, 0.0])
    with pytest.raises(InterfaceError, match="no interface 'C'; it has: 'A', 'B'"):
        body.interface("C")
    with pytest.raises(InterfaceError, match="no interface 'C'"):
        body.frequencies(["C"])
    with pytest.raises(
        InterfaceError, match="'A' has no component 'w'; choose from x, y, z, rx, ry, rz"
    ):
        body.frequencies({"A": ("x", "w")})


def assert_same(one, other):
    assert one.fingerprint() == other.fingerprint()
    assert dict(one.provenance) == dict(other.provenance)
    assert (one.frame, one.partition_names) == (other.frame, other.partition_names)
    parts = [(one, other), *zip(one.interfaces, other.interfaces, strict=True)]
    parts += [(getattr(one, group), getattr(other, group)) for group in ("modes", "surface")]
    for mine, theirs in parts:
        for item in [] if mine is None else dataclasses.fields(mine):
            a, b = getattr(mine, item.name), getattr(theirs, item.name)
            if isinstance(a, np.ndarray):
                assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


@pytest.mark.parametrize("make", [two_crosses, with_groups, lambda: two_crosses(frame=None)])
def test_save_and_load_bit_for_bit(tmp_path, make):
    body = make()
    body.save(tmp_path / "body.h5")
    loaded = ReducedBody.load(str(tmp_path / "body.h5"))
    assert_same(body, loaded)
    assert (loaded.modes is None) == (body.modes is None)


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda body: pickle.loads(pickle.dumps(body))])
def test_copy_and_pickle(twin):
    assert_same(with_groups(), twin(with_groups()))


def test_arrays_are_copies_that_cannot_be_written():
    mine = np.zeros((2, 2))
    body = two_crosses(damping=mine)
    mine[0, 0] = 7.0
    assert body.damping[0, 0] == 0.0
    for array in (
        body.gram,
        body.interfaces[1].modes,
        with_groups().modes.phi,
        with_groups().surface.x,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 1.0
    with pytest.raises(TypeError):
        body.provenance["form"] = "another"
    with pytest.raises(dataclasses.FrozenInstanceError):
        body.frame = "B"


def test_whole_numbers_become_floats():
    body = two_crosses(stiffness=np.array([1, 4]), damping=[[0, 0], [0, 0]])
    assert body.stiffness.dtype == body.damping.dtype == np.float64
    assert with_groups().modes.node.dtype == np.int64


def test_fingerprint_is_of_the_mechanics():
    assert two_crosses().fingerprint() == with_groups().fingerprint()
    assert two_crosses().fingerprint() == two_crosses(provenance={}).fingerprint()
    assert two_crosses().fingerprint() != two_crosses(damping=np.eye(2)).fingerprint()


NAN, NAN_3 = np.full((2, 2), np.nan), np.full((3, 3), np.nan)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gram": np.eye(9)}, r"gram has shape \(9, 9\), expected \(10, 10\)"),
        ({"damping": NAN}, "damping holds values that are not finite"),
        ({"partition_names": ("B.x",)}, "1 partition names for 2 modes"),
        ({"frame": "C"}, "interface 'C' is not among"),
        (
            {"interfaces": (InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 3))),)},
            r"'A' has modes \(6, 3\), expected \(6, 2\)",
        ),
        (
            {"interfaces": (InterfaceFrame("A", np.zeros(2), np.eye(3), np.zeros((6, 2))),)},
            r"'A' has p_BI_B \(2,\), expected \(3,\)",
        ),
        (
            {"interfaces": (InterfaceFrame("A", np.zeros(3), NAN_3, np.zeros((6, 2))),)},
            "'A': R_BI holds values that are not finite",
        ),
        ({"interfaces": two_crosses().interfaces[:1] * 2}, "two interfaces share a name"),
        (
            {"modes": NodalModes(np.arange(3), np.zeros((3, 3)), np.zeros((2, 3, 2)))},
            r"NodalModes has phi \(2, 3, 2\)",
        ),
    ],
)
def test_parts_that_do_not_fit(changes, message):
    with pytest.raises(RecordError, match=message):
        two_crosses(**changes)


def test_all_faults_are_listed():
    with pytest.raises(RecordError, match=r"gram has shape.*; damping holds"):
        two_crosses(gram=np.eye(9), damping=NAN)


@pytest.mark.parametrize("tree", [{}, {"gram": np.eye(4)}, {"gram": "text"}])
def test_record_of_something_else(tmp_path, tree):
    write_tree(tmp_path / "body.h5", tree, kind=RECORD)
    with pytest.raises(RecordError, match=r"body\.h5 is a record, but not of a reduced body"):
        ReducedBody.load(tmp_path / "body.h5")


def test_record_whose_parts_do_not_fit(tmp_path):
    body = two_crosses()
    body.save(tmp_path / "body.h5")
    tree = read_tree(tmp_path / "body.h5", kind=RECORD)
    write_tree(tmp_path / "body.h5", {**tree, "stiffness": np.ones(3)}, kind=RECORD)
    with pytest.raises(RecordError, match=r"body\.h5 is .*gram has shape"):
        ReducedBody.load(tmp_path / "body.h5")


def test_an_interface_is_named_by_a_text():
    with pytest.raises(InterfaceError, match="the name of an interface must be a text, got array"):
        two_crosses().interface(np.full(3, np.nan))
