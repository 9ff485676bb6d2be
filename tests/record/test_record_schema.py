"""The file of a reduced body: what docs/record.md says is what is there, and all of it comes back bit for bit."""

import dataclasses
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from particles import of_unit_mass
from scipy.spatial.transform import Rotation

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import read_tree, write_tree
from flexmbd.record.file_kind import RECORD
from flexmbd.record.reduced_body import (
    ContactPatches,
    DistributedLoads,
    FurtherUnknowns,
    GeometricStiffness,
    Gyroscopic,
    Heat,
    InterfaceFrame,
    ModalStretch,
    NodalInterfaces,
    NodalModes,
    NonlinearStiffness,
    Ports,
    ReducedBody,
    StressModes,
    Surface,
)

PAGE = (Path(__file__).parents[2] / "docs" / "record.md").read_text()

# no two sizes alike, so that no shape can be taken for another
SIZE = {"n": 5, "b": 2, "k": 7, "s": 11, "v": 8, "t": 9, "g": 13, "d": 1, "h": 3, "u": 17, "c": 4, "w": 6}
SIZE |= {"p3": 35, "p4": 70, "r": 3, "j": 10, "m": 12, "f": 14, "e": 4, "a": 15}
TYPES = {"f8": "<f8", "i8": "<i8", "text": "|O"}


PORT_TEXTS = "port", "effort", "unit", "flow", "other unit"


def port_numbers(rng, n):
    half = rng.normal(size=(15, 20))
    return rng.normal(size=(15, n)), half @ half.T


def symmetric(matrices):
    return matrices + matrices.swapaxes(1, 2)


def full_record():
    """A record with every group but `nonlinear`, whose numbers use all their bits."""
    rng = np.random.default_rng(7)
    n, k, s, v, t, g = (SIZE[size] for size in "nksvtg")
    fields = rng.normal(size=(40, 4 + 3 * n))
    fields[:, 0] = 1.0
    shapes = of_unit_mass(fields[:, 4:].reshape(40, n, 3).swapaxes(1, 2), np.ones(40))
    fields[:, 4:] = shapes.swapaxes(1, 2).reshape(40, 3 * n)
    half = rng.normal(size=(n, n))
    turn = lambda: Rotation.from_rotvec(rng.normal(size=3)).as_matrix()  # noqa: E731
    residual = rng.normal(size=(36, 40))
    return ReducedBody(
        gram=fields.T @ fields,
        stiffness=np.sort(rng.uniform(1, 2, n)),
        damping=half @ half.T,
        interfaces=tuple(
            InterfaceFrame(name, rng.normal(size=3), turn(), rng.normal(size=(6, n)))
            for name in ("root", "tip")
        ),
        frame="root",
        partition=rng.normal(size=(n, n)),
        partition_names=tuple(f"tip.{i}" for i in range(n)),
        provenance={"form": "by hand", "ganz oben": "two\nlines \u00e4"},
        p_MB_M=rng.normal(size=3),
        R_MB=turn(),
        unknowns=FurtherUnknowns(np.arange(SIZE["u"]) ** 2, rng.normal(size=(SIZE["u"], n))),
        modes=NodalModes(np.arange(k) ** 3, rng.normal(size=(k, 3)), rng.normal(size=(k, 3, n))),
        nodal=NodalInterfaces(
            tuple("abcd"), np.arange(6) ** 2, rng.normal(size=(6, 3)), np.arange(6) % 4, rng.normal(size=(6, 3, n))
        ),
        surface=Surface(rng.normal(size=(v, 3)), rng.integers(0, v, (t, 3)), rng.normal(size=(v, 3, n))),
        geometric=GeometricStiffness(tuple(f"load {i}" for i in range(g)), symmetric(rng.normal(size=(g, n, n)))),
        stretch=ModalStretch(rng.normal(size=(3, n)), symmetric(rng.normal(size=(3, n, n)))),
        gyroscopic=Gyroscopic(rng.normal(size=3), rng.normal(size=(3, n)), half - half.T),
        loads=DistributedLoads(("gas",), rng.normal(size=(1, 3)), rng.normal(size=(1, 3)), rng.normal(size=(1, n))),
        ports=Ports(*(tuple(f"{what} {i}" for i in range(15)) for what in PORT_TEXTS), *port_numbers(rng, n)),
        heat=Heat(("warm", "hot", "cold"), np.arange(7), rng.normal(size=(3, 7))),
        stress=StressModes(
            np.arange(s) + 2**40, rng.normal(size=(s, 3)), rng.integers(-1, 2, s), rng.normal(size=(s, 6, n))
        ),
        contact=ContactPatches(
            names=tuple("abcdefghij"),
            surface=rng.integers(0, 10, 12),
            x=rng.normal(size=(12, 3)),
            axes=np.array([turn() for _ in range(12)]),
            area=rng.uniform(1, 2, 12),
            phi=rng.normal(size=(12, 3, n)),
            G=residual @ residual.T,
            facet=rng.integers(0, 2**40, (14, 4)),
            patch=rng.integers(0, 12, 14),
        ),
    )


def nonlinear_record():
    """One with `nonlinear` in the place of what it replaces."""
    rng = np.random.default_rng(8)
    group = NonlinearStiffness(
        rng.normal(size=35),
        rng.normal(size=70),
        rng.normal(size=(2, 6, 5)),
        energy=np.array([0.7]),
        tolerance=np.array([1e-3]),
        compared=rng.normal(size=(5, 3)),
    )
    return dataclasses.replace(full_record(), geometric=None, stretch=None, stress=None, nonlinear=group)


GROUPS = (
    "modes", "nodal", "unknowns", "surface", "geometric", "stretch", "gyroscopic", "loads", "ports", "heat",
    "stress", "contact",
)  # fmt: skip


def assert_same(one, other):
    """Every field of two records or groups, to the bit."""
    for item in dataclasses.fields(one):
        mine, theirs = getattr(one, item.name), getattr(other, item.name)
        assert type(mine) is type(theirs), item.name
        if isinstance(mine, np.ndarray):
            assert (mine.dtype, mine.shape, mine.tobytes()) == (theirs.dtype, theirs.shape, theirs.tobytes())
        elif dataclasses.is_dataclass(mine):
            assert_same(mine, theirs)
        elif item.name == "interfaces":
            for left, right in zip(mine, theirs, strict=True):
                assert_same(left, right)
        else:
            assert dict(mine) == dict(theirs) if item.name == "provenance" else mine == theirs


@pytest.mark.parametrize("absent", [(), *((name,) for name in GROUPS), GROUPS])
def test_all_groups_come_back_bit_for_bit(tmp_path, absent):
    come_back(tmp_path, dataclasses.replace(full_record(), **dict.fromkeys(absent)))


def test_the_page_s_example(tmp_path, monkeypatch):
    """A steel bar of 0.4 m x 0.05 m x 0.02 m whose frames lie on its ends."""
    monkeypatch.chdir(tmp_path)
    found = {}
    exec(re.search(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)[1], found)
    assert found["bar"].mass == pytest.approx(7850.0 * 0.4 * 0.05 * 0.02)
    np.testing.assert_allclose(found["bar"].interface("x_max").p_BI_B, [0.4, 0.0, 0.0], atol=1e-12)


def test_a_nonlinear_record_comes_back_bit_for_bit(tmp_path):
    come_back(tmp_path, nonlinear_record())


def come_back(tmp_path, body):
    body.save(tmp_path / "a.h5")
    loaded = ReducedBody.load(tmp_path / "a.h5")
    assert_same(body, loaded)
    loaded.save(tmp_path / "b.h5")
    assert_same(body, ReducedBody.load(tmp_path / "b.h5"))


def documented():
    """(type, shape) by dataset, as the page's tables have them."""
    rows = re.findall(r"^\| `([a-z_A-Z/*]+)` \| (f8|i8|text) \| \(([^)]*)\) \|", PAGE, flags=re.MULTILINE)
    found = {}
    for name, kind, shape in rows:
        # 3 n is a product
        entries = [re.sub(r"(\d) ([a-z])", r"\1 * \2", entry) for entry in shape.split(",") if entry.strip()]
        found[name] = (TYPES[kind], tuple(eval(entry, {}, SIZE) for entry in entries))
    return found


def test_the_page_lists_every_dataset_with_its_type_and_shape(tmp_path):
    there = {}
    for record in (full_record(), nonlinear_record()):
        record.save(tmp_path / "a.h5")
        with h5py.File(tmp_path / "a.h5") as file:
            assert dict(file.attrs) == {"format": RECORD.format, "version": RECORD.version}
            file.visititems(
                lambda name, item: (
                    there.update({name: (item.dtype.str, item.shape)}) if isinstance(item, h5py.Dataset) else None
                )
            )
    for key in ("form", "ganz oben"):
        assert there.pop(f"provenance/{key}") == ("|O", ())
    there["provenance/*"] = ("|O", ())
    assert there == documented()


def test_the_page_names_the_version():
    assert f"`version` = {RECORD.version}" in PAGE
    assert f"`flexmbd record, version {RECORD.version}`" in PAGE


@pytest.mark.parametrize("extra", [{"prestress": np.zeros(3)}, {"other": {"a": "b"}}])
def test_what_the_page_does_not_list_is_refused(tmp_path, extra):
    full_record().save(tmp_path / "a.h5")
    write_tree(tmp_path / "a.h5", {**read_tree(tmp_path / "a.h5", kind=RECORD), **extra}, kind=RECORD)
    with pytest.raises(RecordError, match=rf"a\.h5 is .*it holds {next(iter(extra))}, which this flexmbd"):
        ReducedBody.load(tmp_path / "a.h5")


def test_a_group_with_a_further_array_is_refused(tmp_path):
    full_record().save(tmp_path / "a.h5")
    tree = read_tree(tmp_path / "a.h5", kind=RECORD)
    tree["stress"]["mask"] = np.zeros(3)
    write_tree(tmp_path / "a.h5", tree, kind=RECORD)
    with pytest.raises(RecordError, match=r"a\.h5 is .*mask"):
        ReducedBody.load(tmp_path / "a.h5")


@pytest.mark.parametrize("change", [
    {"gram": full_record().gram + np.diag([1.0] + [0.0] * 18)}, {"stiffness": np.ones(5)}, {"damping": np.eye(5)},
    {"partition": np.eye(5)},
    {"frame": None}, {"geometric": None}, {"loads": None}, {"contact": None},
    {"interfaces": full_record().interfaces[::-1]},
    {"interfaces": tuple(dataclasses.replace(one, p_BI_B=np.zeros(3)) for one in full_record().interfaces)},
    {"interfaces": tuple(dataclasses.replace(one, R_BI=np.eye(3)) for one in full_record().interfaces)},
])  # fmt: skip
def test_the_fingerprint_sees_all_of_the_mechanics(change):
    assert dataclasses.replace(full_record(), **change).fingerprint() != full_record().fingerprint()


def test_the_fingerprint_sees_nonlinear_stiffness():
    record = nonlinear_record()
    for item in dataclasses.fields(NonlinearStiffness):
        other = dataclasses.replace(record.nonlinear, **{item.name: 2.0 * getattr(record.nonlinear, item.name)})
        assert dataclasses.replace(record, nonlinear=other).fingerprint() != record.fingerprint()


def test_nonlinear_stiffness_stands_alone_and_fits():
    record = nonlinear_record()
    with pytest.raises(RecordError, match="it has geometric and stretch beside nonlinear"):
        dataclasses.replace(full_record(), nonlinear=record.nonlinear)
    faults = {
        "cubic": (np.zeros(34), r"cubic \(34,\), expected \(35,\)"),
        "quartic": (np.zeros(35), r"quartic \(35,\), expected \(70,\)"),
        "face_strain": (np.zeros((1, 6, 5)), "1 faces for 2 interfaces"),
        "energy": (np.array([-1.0]), r"an energy of -1\.0 J"),
        "tolerance": (np.zeros(1), r"a tolerance of 0\.0"),
        "compared": (np.zeros((3, 5)), r"compared \(3, 5\), expected \(5, 3\)"),
    }
    for name, (value, message) in faults.items():
        with pytest.raises(RecordError, match=message):
            dataclasses.replace(record, nonlinear=dataclasses.replace(record.nonlinear, **{name: value}))


NAN = np.full((3, 3), np.nan)


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (Surface(np.zeros((3, 3)), np.array([[0, 1, 3]]), np.zeros((3, 3, 5))), "vertices 0 to 3 .* and 3 vertices"),
        (Surface(np.zeros((3, 3)), np.array([[0, -1, 2]]), np.zeros((3, 3, 5))), "vertices -1 to 2"),
        (Surface(NAN, np.array([[0, 1, 2]]), np.zeros((3, 3, 5))), "Surface: x holds values that are not finite"),
        (Surface(np.zeros((3, 3)), np.arange(3), np.zeros((3, 3, 5))), r"triangle \(3,\), expected \(3, 3\)"),
        (NodalModes(np.arange(4), np.zeros((3, 3)), np.zeros((4, 3, 5))), r"x \(3, 3\), expected \(4, 3\)"),
        (GeometricStiffness(("a",), np.zeros((2, 5, 5))), r"K \(2, 5, 5\), expected \(1, 5, 5\)"),
        (GeometricStiffness(("a", "a"), np.zeros((2, 5, 5))), "names a load twice"),
        (ModalStretch(np.zeros((2, 4)), np.zeros((2, 5, 5))), r"strain \(2, 4\), expected \(2, 5\)"),
        (ModalStretch(np.zeros((2, 5)), np.zeros((3, 5, 5))), r"P \(3, 5, 5\), expected \(2, 5, 5\)"),
        (DistributedLoads(("a",), np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((1, 5))), r"moment \(1, 2\)"),
        (
            StressModes(np.arange(2), np.zeros((2, 3)), np.zeros(2), np.zeros((2, 5, 6))),
            r"sigma \(2, 5, 6\), expected \(2, 6, 5\)",
        ),
    ],
)
def test_groups_that_do_not_fit(group, message):
    attribute = {Surface: "surface", NodalModes: "modes", GeometricStiffness: "geometric", DistributedLoads: "loads"}
    attribute[ModalStretch] = "stretch"
    with pytest.raises(RecordError, match=message):
        dataclasses.replace(full_record(), **{attribute.get(type(group), "stress"): group})
