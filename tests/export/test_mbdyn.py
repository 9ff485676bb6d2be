"""MBDyn's data file says of the body what the body says of itself, by a reader that knows only the layout."""

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError, InterfaceError
from flexmbd.record.reduced_body import InterfaceFrame

BODIES = [soft_bar, damped_rod]


@cache
def floating_bar():
    """A bar whose body frame floats on the mean axis, at rest in the middle."""
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    rubber = solid_linear.Parameters(E=4.4e7, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.04, 0.06, divisions=(10, 1, 1))
    model = ContinuumModel(mesh, solid_linear, rubber, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    return craig_bampton(model, modes=4, frame=None, geometric_stiffness=False)


def as_mbdyn_reads(path):
    """Groups and labels as MBDyn's scanner takes them: heading lines with a comma, then numbers by count.

    Written from the layout alone, so that a fault of writer and reader together would be seen.
    """
    lines = path.read_text().split("\n")
    assert all(len(line) < 8192 for line in lines)
    heads = [at for at, line in enumerate(lines) if re.match(r"\*\* RECORD GROUP \d+,", line)]
    groups = {
        int(lines[at][16:].split(",")[0]): lines[at + 1 : end]
        for at, end in zip(heads, [*heads[1:], len(lines)], strict=True)
    }
    assert list(groups) == sorted(groups)
    revision, *counts = groups[1][1].split()
    assert revision.startswith("REV")
    k, n, *others = map(int, counts)
    assert others == [0, 0, 0]

    def words(group, count):
        found = " ".join(line for line in groups[group] if not line.startswith("**")).split()
        assert len(found) == count, group
        return found

    def numbers(group, *shape):
        return np.array(words(group, int(np.prod(shape))), dtype=float).reshape(shape)

    # each mode begins with a line of its own, and a line a node follows
    blocks = groups[8]
    assert len(blocks) == n * (k + 1)
    assert all(blocks[mode * (k + 1)].startswith("**") for mode in range(n))
    return {
        "labels": words(2, k),
        "start": np.array([numbers(3, n), numbers(4, n)]),
        "x": np.array([numbers(5, k), numbers(6, k), numbers(7, k)]).T,
        "shapes": numbers(8, n, k, 6),
        "M": numbers(9, n, n),
        "K": numbers(10, n, n),
        "m": numbers(11, k, 6),
        "D": numbers(13, n, n) if 13 in groups else None,
        "groups": sorted(groups),
    }


@pytest.mark.parametrize("make", [*BODIES, floating_bar])
def test_mass_centre_inertia_and_modal_mass(tmp_path, make):
    """What `mbdyn -P` compares, and the invariants that MBDyn computes of nodes, to 1e-12."""
    body = make()
    fm.export.mbdyn(body, tmp_path / "body.fem")
    file = as_mbdyn_reads(tmp_path / "body.fem")
    m, x, phi = file["m"][:, 0], file["x"], np.moveaxis(file["shapes"][:, :, :3], 0, -1)
    assert np.array_equal(file["m"][:, :3], np.tile(m[:, None], 3))
    assert not file["m"][:, 3:].any()
    assert m.sum() == pytest.approx(body.mass, rel=1e-12)
    centre = m @ x / m.sum()
    size = np.sqrt(np.trace(body.inertia) / body.mass)
    np.testing.assert_allclose(centre, body.com, rtol=0.0, atol=1e-12 * size)
    arms = x - centre
    second = arms.T @ (m[:, None] * arms)
    inertia = np.trace(second) * np.eye(3) - second
    np.testing.assert_allclose(inertia, body.inertia, rtol=0.0, atol=1e-12 * np.abs(body.inertia).max())
    modal = np.einsum("k,kai,kaj->ij", m, phi, phi)
    # the reduction's own round-off is not in group 9: MBDyn warns of it in each run
    assert np.array_equal(file["M"], np.eye(body.n_modes))
    np.testing.assert_allclose(modal, body.modal_mass(), rtol=0.0, atol=1e-12)
    # invariants 3, 4, 5, 8 and 9 are blocks of the Gram matrix
    fields = np.concatenate([np.ones((len(m), 1)), x, phi.swapaxes(1, 2).reshape(len(m), -1)], axis=1)
    squares = np.diag(body.gram)
    scale = np.sqrt(np.concatenate([squares[:1], np.repeat(squares[1:].reshape(-1, 3).sum(axis=1), 3)]))
    apart = (fields.T @ (m[:, None] * fields) - body.gram) / np.outer(scale, scale)
    assert np.abs(apart).max() < 1e-12
    assert np.array_equal(file["K"], np.diag(body.stiffness))
    assert not file["start"].any()


@pytest.mark.parametrize("make", BODIES)
def test_interfaces_are_nodes_without_mass(tmp_path, make):
    body = make()
    fm.export.mbdyn(body, tmp_path / "body.fem")
    file = as_mbdyn_reads(tmp_path / "body.fem")
    massless = [label for label, m in zip(file["labels"], file["m"][:, 0], strict=True) if m == 0.0]
    assert massless == [frame.name for frame in body.interfaces]
    for frame in body.interfaces:
        row = file["labels"].index(frame.name)
        assert np.array_equal(file["x"][row], frame.p_BI_B)
        assert np.array_equal(file["shapes"][:, row], frame.modes.T)
    if body.damping.any():
        assert np.array_equal(file["D"], body.damping)
    else:
        assert file["groups"] == list(range(1, 12))


@pytest.mark.parametrize("make", [*BODIES, floating_bar])
def test_comes_back(tmp_path, make):
    body = make()
    fm.export.mbdyn(body, tmp_path / "bödy.fem")
    back = fm.export.read_mbdyn(tmp_path / "bödy.fem")
    assert back.frame == body.frame
    assert back.modes is None
    for what in ("stiffness", "damping", "p_MB_M", "R_MB"):
        assert np.array_equal(getattr(back, what), getattr(body, what)), what
    for there, here in zip(back.interfaces, body.interfaces, strict=True):
        assert there.name == here.name
        for what in ("p_BI_B", "R_BI", "modes"):
            assert np.array_equal(getattr(there, what), getattr(here, what)), what
    np.testing.assert_allclose(back.frequencies(), body.frequencies(), rtol=1e-9)


def test_a_file_of_nodes_with_moments_of_inertia(tmp_path):
    """A dumbbell of two nodes on a rotating mode: mass, inertia and modal mass by hand."""
    node = "REV0 2 1 0 0 0"
    text = f"""** any comment
** RECORD GROUP 1, HEADER
a line of comment without asterisks
 {node}
** RECORD GROUP 2,
 17 4
** RECORD GROUP 5
 -1.0
 2.0
** RECORD GROUP 6, Y
0 0
** RECORD GROUP 7, Z
0 0
** RECORD GROUP 8, shapes
** mode 1
0 0.5 0 0 0 -0.5
0 -0.25 0 0.1 0 1.0
** RECORD GROUP 9, mass
3.8425
** RECORD GROUP 10, stiffness
 8e2
** RECORD GROUP 11, masses
2 2 2 3 4 5
4 4 4 1.25 1.5 2.33
** END OF FILE
** RECORD GROUP 9, ignored
"""
    path = tmp_path / "dumbbell.fem"
    path.write_text(text)
    with pytest.raises(ExportError, match=r"group 9 and that of the nodes' masses in group 11 are .* apart"):
        fm.export.read_mbdyn(path)
    modal = 2 * 0.5**2 + 4 * 0.25**2 + 5 * 0.25 + 1.25 * 0.1**2 + 2.33
    path.write_text(text.replace("3.8425", repr(modal)))
    body = fm.export.read_mbdyn(path, interfaces=["4"])
    assert body.mass == pytest.approx(6.0, rel=1e-15)
    np.testing.assert_allclose(body.com, (1.0, 0.0, 0.0), atol=1e-15)
    inertia = np.diag([4.25, 5.5 + 2 * 4 + 4 * 1, 7.33 + 2 * 4 + 4 * 1])
    np.testing.assert_allclose(body.inertia, inertia, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(body.stiffness, 800.0 / modal, rtol=1e-14)
    np.testing.assert_allclose(body.modal_mass(), [[1.0]], rtol=1e-14)
    # the mode's angular momentum about the origin: that of the masses, and of the nodes' own rotations
    spin = np.array([0.1 * 1.25, 0.0, 2 * -1 * 0.5 + 4 * 2 * -0.25 + 5 * -0.5 + 2.33]) / np.sqrt(modal)
    np.testing.assert_allclose(body.mass_matrix()[3:6, 6], spin, rtol=0.0, atol=1e-14)
    (frame,) = body.interfaces
    assert frame.name == "4"
    np.testing.assert_allclose(frame.modes[:, 0] * np.sqrt(modal), [0, -0.25, 0, 0.1, 0, 1], atol=1e-15)
    assert body.frame is None
    assert list(body.modes.node) == [4, 17]
    with pytest.raises(ExportError, match=r"has no node 'hub'; its nodes begin with 17, 4"):
        fm.export.read_mbdyn(path, interfaces=["hub"])


def renamed(body, name):
    frame = replace(body.interfaces[1], name=name)
    return replace(body, interfaces=(body.interfaces[0], frame))


@pytest.mark.parametrize("name", ["big end", "", "lager_ä", "x" * 81, "12", "point-3", "**", 'a"b', "a,b", "a;", "a\n"])
def test_names_that_are_no_labels(tmp_path, name):
    body = renamed(damped_rod(), name)
    for write in (
        lambda: fm.export.mbdyn(body, tmp_path / "x.fem"),
        lambda: fm.export.mbdyn_deck(body, tmp_path / "x.fem", tmp_path / "x.mbd"),
    ):
        with pytest.raises(ExportError, match=re.escape(repr(name)) + " is not a node label for MBDyn: give it up"):
            write()
    assert not list(tmp_path.iterdir())


def test_losses_are_told(tmp_path):
    assert fm.export.mbdyn(soft_bar(), tmp_path / "x.fem") == (
        "stiffening by load and by spinning", "the modes at the mesh's nodes",
    )  # fmt: skip


def test_a_rigid_body_is_refused(tmp_path):
    body = soft_bar()
    frames = tuple(InterfaceFrame(f.name, f.p_BI_B, f.R_BI, np.zeros((6, 0))) for f in body.interfaces)
    rigid = fm.ReducedBody(
        gram=body.gram[:4, :4], stiffness=[], damping=np.zeros((0, 0)), interfaces=frames, frame="x_min",
        partition=np.zeros((0, 0)), partition_names=(),
    )  # fmt: skip
    with pytest.raises(ExportError, match=r"this body has 0 modes and 2.64 kg: make a `body` element"):
        fm.export.mbdyn(rigid, tmp_path / "rigid.fem")


def edited(text, group, change):
    """The file with other lines in a group; None takes the group out."""
    at = text.index(f"** RECORD GROUP {group},")
    start = text.index("\n", at) + 1
    end = text.index("** RECORD GROUP" if "** RECORD GROUP" in text[start:] else "** END", start)
    return text[:at] + text[end:] if change is None else text[:start] + change(text[start:end]) + text[end:]


@pytest.mark.parametrize(
    ("group", "change", "says"),
    [
        (1, lambda block: block.replace("REV0 42 12", "REV0 999999999 12"), "group 2, node labels, has 42 labels"),
        (1, lambda block: block.replace("REV0 42 12", "REV0 42 99999"), "claims 42 nodes and 99999 modes"),
        (1, lambda block: block.replace("REV0 42 12", "REV0 42 13"), "group 8, mode shapes, has 3024 numbers"),
        (1, lambda block: block.replace("0 0 0", "0 0 2"), "2 rejected modes"),
        (1, lambda block: block.replace("42", "4" * 5000), "expected a revision and five numbers"),
        (1, lambda block: "", "lacks record groups 2"),
        (1, None, "its first record group is 2, not 1"),
        (11, None, "has neither group 11, nodal masses, nor group 12"),
        (9, None, "lacks record groups 9"),
        (2, lambda block: block.replace("point-2\n", "point-1\n"), "two nodes share a label"),
        (5, lambda block: "nan " + block.split(" ", 1)[1], "group 5, X coordinates, holds values that are not finite"),
        (5, lambda block: "x " + block.split(" ", 1)[1], "could not convert string to float"),
        (7, lambda block: block + "1.0\n", "group 7, Z coordinates, has 43 numbers, expected 42"),
        (10, lambda block: block.replace(block.split()[0], "-1.0", 1), "rigid motions"),
        (11, lambda block: "-" + block, "differ from axis to axis, or negative"),
        (11, lambda block: "1e200 1e200 1e200 0 0 0\n" + block.split("\n", 1)[1], "apart|does not hold"),
        (9, lambda block: block.replace("0.0", "1e-3", 1), "1.0e-03 apart"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told(tmp_path, group, change, says):
    path = tmp_path / "wröng.fem"
    fm.export.mbdyn(damped_rod(), path)
    path.write_text(edited(path.read_text(), group, change))
    with pytest.raises(ExportError, match=says) as caught:
        fm.export.read_mbdyn(path)
    assert "wröng.fem" in str(caught.value)


def test_a_group_that_is_there_twice(tmp_path):
    path = tmp_path / "twice.fem"
    fm.export.mbdyn(damped_rod(), path)
    text = path.read_text()
    path.write_text(text.replace("** END OF FILE", "** RECORD GROUP 9, again\n** END OF FILE"))
    with pytest.raises(ExportError, match="has record group 9 twice"):
        fm.export.read_mbdyn(path)


def test_damaged_files(tmp_path):
    fm.export.mbdyn(damped_rod(), tmp_path / "rod.fem")
    data = (tmp_path / "rod.fem").read_bytes()
    assert survive(fm.export.read_mbdyn, tmp_path / "x.fem", data, count=2000) < 1000


def statements(text):
    """The deck's statements without comments and line breaks."""
    text = re.sub(r"#.*", "", text)
    return [" ".join(part.split()) for part in text.split(";") if part.strip()]


def test_the_deck_is_complete(tmp_path):
    """Blocks in order, nodes and joints as announced, states that fit, the file where it is named."""
    body = damped_rod()
    (tmp_path / "models").mkdir()
    fem, deck = tmp_path / "models" / "rod.fem", tmp_path / "rod.mbd"
    fm.export.mbdyn(body, fem)
    pendulum = fm.export.mbdyn_deck(body, fem, deck, axis=(0, 0, 2.0), rate=3.0, end=0.5, step=2e-4)
    parts = statements(deck.read_text())
    blocks = [part for part in parts if part.startswith(("begin:", "end:"))]
    names = ["data", "initial value", "control data", "nodes", "elements"]
    assert blocks == [f"{word}: {name}" for name in names for word in ("begin", "end")]
    assert "derivatives coefficient: auto" in parts
    assert "time step: 0.0002" in parts
    assert "output precision: 16" in parts
    nodes = [part.split(", ", 1) for part in parts if part.startswith("structural:")]
    assert f"structural nodes: {len(nodes)}" in parts
    assert [node for node, _ in nodes] == ["structural: 1", "structural: 2"]
    assert pendulum.nodes == {"big_end": 1, "small_end": 2}
    kind, *rest = nodes[1][1].split(", eye, ")
    place, motion = kind.removeprefix("static, "), rest[0]
    p = np.array(place.split(", "), dtype=float)
    v, w = np.array(motion.split(", "), dtype=float).reshape(2, 3)
    assert np.array_equal(p, body.interface("small_end").p_BI_B)
    assert np.array_equal(w, [0.0, 0.0, 3.0])
    np.testing.assert_allclose(v, np.cross(w, p), rtol=1e-15)
    joints = [part for part in parts if part.startswith("joint:")]
    assert f"joints: {len(joints)}" in parts
    assert joints[0] == (
        'joint: 10, modal, 1, 12, from file, damping from file, "models/rod.fem", '
        '1, "small_end", 2, null, use invariant 9'
    )
    frame = "position, null, orientation, 3, 0.0, 0.0, 1.0, 2, 0.0, 1.0, 0.0"
    at_rest = frame.replace("null", "0.0, 0.0, 0.0")
    assert joints[1] == f"joint: 20, revolute pin, 1, {frame}, {at_rest}"
    (weight,) = (part for part in parts if part.startswith("gravity:"))
    numbers = re.findall(r"-?\d[\d.e-]*", weight)
    down = np.array(numbers[:3], dtype=float)
    assert float(numbers[3]) == pytest.approx(9.81, rel=1e-14)
    np.testing.assert_allclose(down, body.com * (1, 1, 0) / np.hypot(*body.com[:2]), atol=1e-15)
    assert (tmp_path / re.search(r'"(.*?)"', joints[0])[1]).samefile(fem)


@pytest.mark.parametrize("end", ["x_min", "x_max"])
def test_a_floating_body_hangs_at_an_interface(tmp_path, end):
    """The states of the deck are one rigid rotation about the hinge, which holds the interface's node where that is."""
    body, number = floating_bar(), r"-?\d[\d.e-]*"
    pendulum = fm.export.mbdyn_deck(body, tmp_path / "x.fem", tmp_path / "x.mbd", hinge=end, axis=(0, 1, 1), rate=3.0)
    assert pendulum.hinge == end
    assert pendulum.nodes == {"x_min": 2, "x_max": 3}
    parts = statements((tmp_path / "x.mbd").read_text())
    states = {
        int(part.split(",")[0].split()[-1]): part.split(", ", 2)[2] for part in parts if part.startswith("structural:")
    }
    places = {1: np.zeros(3)} | {pendulum.nodes[one.name]: one.p_BI_B for one in body.interfaces}
    hinge, spin = body.interface(end).p_BI_B, 3.0 * np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
    for label, place in places.items():
        where, motion = states[label].replace("null", "0, 0, 0").split(", eye, ")
        assert np.array_equal(np.array(where.split(", "), dtype=float), place)
        v, w = np.array(motion.split(", "), dtype=float).reshape(2, 3)
        np.testing.assert_allclose(v, np.cross(spin, place - hinge), rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(w, spin, rtol=1e-15)
    joint, pin = (part for part in parts if part.startswith("joint:"))
    assert '2, "x_min", 2, null, "x_max", 3, null, use invariant 9' in joint
    at_node, in_world = pin.removeprefix(f"joint: 20, revolute pin, {pendulum.nodes[end]}, ").split(", position, ")
    assert at_node.startswith("position, null, orientation, 3,")
    assert np.array_equal(np.array(re.findall(number, in_world)[:3], dtype=float), hinge)
    # gravity along the arm from the hinge to the centre of mass, whose part along the axis does not count
    arm = body.com - hinge
    assert np.abs(np.cross(pendulum.gravity, arm - spin * (spin @ arm) / 9.0)).max() < 1e-12
    assert pendulum.gravity @ arm > 0.0


@pytest.mark.parametrize(
    ("make", "options", "says"),
    [
        (lambda: replace(floating_bar(), interfaces=()), {}, "hangs at an interface, and this body has none"),
        (floating_bar, {"hinge": "hub"}, "hub"),
        (soft_bar, {"axis": (0, 0, 0)}, "has no direction"),
        (soft_bar, {"axis": (1, 0, 0)}, "runs through the centre of mass"),
        (soft_bar, {"step": 0.0}, "step 0.0"),
        (soft_bar, {"end": np.inf}, "end inf"),
        (soft_bar, {"rate": np.nan}, "rate nan"),
    ],
)
def test_no_pendulum(tmp_path, make, options, says):
    with pytest.raises((ExportError, InterfaceError), match=says):
        fm.export.mbdyn_deck(make(), tmp_path / "x.fem", tmp_path / "x.mbd", **options)


def test_the_page_is_true(tmp_path, monkeypatch):
    """The snippet of docs/export/mbdyn.md."""
    monkeypatch.chdir(tmp_path)
    floating_bar().save("bar.h5")
    page = (Path(__file__).parents[2] / "docs" / "export" / "mbdyn.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(block, {})
    (joint,) = re.findall(r"joint: 10, .*;", page)
    assert statements(joint)[0] in statements((tmp_path / "bar.mbd").read_text())


def our_pendulum(body, pendulum, *, end):
    """Trajectory of the deck's pendulum here, and the bar's end."""
    scene = fm.System(gravity=tuple(pendulum.gravity))
    bar = scene.add(fm.FlexibleBody(replace(body, stretch=None, geometric=None)), name="bar")
    place = scene.ground.frame(p=body.interface(pendulum.hinge).p_BI_B)
    hinge = scene.connect(fm.joint.Revolute(tuple(pendulum.axis)), place, bar.frame(pendulum.hinge))
    hinge.velocity = pendulum.rate
    run = scene.simulate(end, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    return run, bar.frame("x_max")


@pytest.mark.parametrize("make", [soft_bar, floating_bar])
def test_the_deck_hangs_in_equilibrium(tmp_path, make):
    """Without an angular velocity the deck's pendulum stays where it is but for its own stretch."""
    body = make()
    pendulum = fm.export.mbdyn_deck(body, tmp_path / "x.fem", tmp_path / "x.mbd", rate=0.0)
    run, tip = our_pendulum(body, pendulum, end=0.2)
    place = run.position(tip)
    assert np.abs(place[:, 1:]).max() < 1e-12
    assert np.abs(place[:, 0] - body.interface("x_max").p_BI_B[0]).max() < 1e-3


@pytest.mark.skipif(shutil.which("mbdyn") is None, reason="MBDyn is not installed: no `mbdyn` on the PATH")
@pytest.mark.parametrize("make", [soft_bar, floating_bar])
def test_mbdyn_moves_as_we_do(tmp_path, make):
    body, end = make(), 0.5
    fm.export.mbdyn(body, tmp_path / "bar.fem")
    found = []
    for step in (2e-4, 1e-4):
        pendulum = fm.export.mbdyn_deck(body, tmp_path / "bar.fem", tmp_path / "bar.mbd", rate=4.0, end=end, step=step)
        command = ["mbdyn", "-s", "-f", "bar.mbd", "-o", "out"]
        subprocess.run(command, cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
        rows = np.loadtxt(tmp_path / "out.mov")
        rows = rows[rows[:, 0] == pendulum.nodes["x_max"], 1:4]
        stride = round(0.05 / step)
        found.append(rows[::stride])
    run, tip = our_pendulum(body, pendulum, end=end)
    right = run.position(tip, t=0.05 * np.arange(len(found[0])))
    errors = [np.abs(rows - right).max() for rows in found]
    assert errors[1] < errors[0]
    # its start, without accelerations, shifts the vibration along the bar by a part of a step: 1e-4 m at 50 Hz
    assert np.abs((4.0 * found[1] - found[0]) / 3.0 - right).max() < 2e-5
