"""What no body can have is refused whoever makes the record: by hand, or from a file whose checksum is right."""

import dataclasses

import numpy as np
import pytest
from particles import particle_body

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import write_tree
from flexmbd.record.file_kind import RECORD
from flexmbd.record.reduced_body import GeometricStiffness, ModalStretch, ReducedBody

BODY = particle_body(3, modes=4, damping=2.0).record
TURNED = BODY.interfaces[1].R_BI
SKEW = np.zeros((4, 4))
SKEW[0, 1], SKEW[1, 0] = 1.0, -1.0


def scaled(body, *, length, time):
    """The same body in other units of length and time; masses as they were."""
    fields = np.concatenate([[1.0], np.full(3, length), np.full(3 * body.n_modes, 1.0)])
    rows = np.array([1.0] * 3 + [length] * 3)[:, None]
    frames = (dataclasses.replace(one, p_BI_B=length * one.p_BI_B, modes=one.modes / rows) for one in body.interfaces)
    return dataclasses.replace(
        body,
        gram=body.gram * np.outer(fields, fields),
        stiffness=body.stiffness / time**2,
        damping=body.damping / time,
        interfaces=tuple(frames),
    )


def with_tip(tree, item, value):
    tree[item] = tree[item].copy()
    tree[item][1] = value


FAULTS = {
    "reflection": (lambda tree, _: tree.update(R_MB=np.diag([1.0, 1.0, -1.0])), "R_MB is no rotation"),
    "stretched axes": (lambda tree, _: with_tip(tree, "interface_R", 1.001 * TURNED), "'tip': R_BI is no rotation"),
    "huge axes": (lambda tree, _: with_tip(tree, "interface_R", 1e308 * TURNED), "'tip': R_BI is no rotation"),
    "unsymmetric damping": (
        lambda tree, time: tree.update(damping=tree["damping"] + SKEW / time), "damping is not symmetric"
    ),
    "negative damping": (
        lambda tree, time: tree.update(damping=np.diag([1.0, 1.0, 1.0, -1e-3]) / time), "damping is negative"
    ),
    "coupled beyond measure": (  # each mode is damped, a combination is not
        lambda tree, time: tree.update(damping=(np.eye(4) + 2.0 * abs(SKEW)) / time), "damping is negative"
    ),
    "far interface": (lambda tree, _: with_tip(tree, "interface_p", 1e308), "interface 'tip' is at 1e.308 m"),
    "far mesh": (lambda tree, length: tree.update(p_MB_M=np.array([0.0, 1e17, 0.0])), "p_MB_M is at 1e.17 m"),
    "heavy modes": (
        lambda tree, _: tree.update(gram=tree["gram"] * np.outer(*[np.r_[np.ones(4), np.full(12, 1.01)]] * 2)),
        "not of unit modal mass",
    ),
    "indefinite mass": (
        lambda tree, _: tree.update(gram=tree["gram"] - np.diag(np.r_[0.99 * BODY.mass, np.zeros(15)])), "is indefinite"
    ),
    "unsymmetric mass": (
        lambda tree, _: tree.update(gram=tree["gram"] + np.outer(np.eye(16)[0], np.eye(16)[5])), "gram is not symmetric"
    ),
    "no coordinates": (lambda tree, _: tree.update(partition=np.zeros((4, 4))), "partition is singular"),
    "one coordinate twice": (
        lambda tree, _: tree.update(partition=np.eye(4)[[0, 1, 2, 2]] * np.array([1e-8, 1.0, 1e9, 1.0])),
        "partition is singular",
    ),
    "boundless shapes": (lambda tree, _: with_tip(tree, "interface_modes", 1e200), "numbers beyond all bounds"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_what_no_body_can_have_is_refused(name, unit, tmp_path):
    """In metres and seconds, and in other units; as it is made and as it is read."""
    change, message = FAULTS[name]
    tree = scaled(BODY, length=1.0, time=unit).tree()
    change(tree, unit)
    with pytest.raises(RecordError, match=message):
        ReducedBody.from_tree(tree)
    write_tree(tmp_path / "a.h5", tree, kind=RECORD)
    with pytest.raises(RecordError, match=rf"a\.h5 is .*{message}"):
        ReducedBody.load(tmp_path / "a.h5")


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("time", [1e-6, 1.0, 1e6])
def test_a_right_body_is_one_in_any_units(length, time):
    assert scaled(BODY, length=length, time=time).n_modes == 4


def test_eight_digits_are_enough():
    """As files of other programs have them."""
    def cut(array):
        with np.errstate(divide="ignore"):
            digits = 10.0 ** (7 - np.floor(np.log10(np.where(array == 0.0, 1.0, abs(array)))))
        return np.round(array * digits) / digits

    singular = np.ones((4, 4))  # one that damps a single motion: round-off makes it indefinite
    body = dataclasses.replace(BODY, damping=singular)
    tree = {name: cut(item) if isinstance(item, np.ndarray) else item for name, item in body.tree().items()}
    assert ReducedBody.from_tree(tree).interfaces[1].name == "tip"


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (GeometricStiffness(("gas",), SKEW[None]), "GeometricStiffness: K is not symmetric"),
        (ModalStretch(np.ones((1, 4)), SKEW[None]), "ModalStretch: P is not symmetric"),
    ],
)
def test_stiffnesses_are_symmetric(group, message):
    with pytest.raises(RecordError, match=message):
        dataclasses.replace(BODY, **{"geometric" if isinstance(group, GeometricStiffness) else "stretch": group})
