"""SID_FEM: a body moves by nothing but its blocks as it does here, and comes back from them."""

import dataclasses
import re

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar
from mutations import survive
from sid_reader import SidBody, fly

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export.sid_files.taylor_blocks import BLOCKS

GRAVITY = np.array([0.0, 0.0, -9.81])


def plain(body):
    """Without stiffening by load."""
    return dataclasses.replace(body, stretch=None, geometric=None)


def slow(body, n, *, stiffer=1.0):
    """The body with its n slowest modes alone, so that few steps follow them."""
    frames = tuple(dataclasses.replace(one, modes=one.modes[:, :n]) for one in body.interfaces)
    return fm.ReducedBody(
        gram=body.gram[: 4 + 3 * n, : 4 + 3 * n],
        stiffness=stiffer * body.stiffness[:n],
        damping=body.damping[:n, :n],
        interfaces=frames,
        frame=body.frame,
        partition=np.eye(n),
        partition_names=body.partition_names[:n],
    )


def flight(body, t, *, w, held):
    """Places of the interfaces (nt, 2, 3), and how far the second is bent away."""
    scene = fm.System(gravity=GRAVITY)
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    joint = scene.connect(fm.joint.Spherical() if held else fm.joint.Free(), scene.ground.frame(), bar.frame("x_min"))
    joint.velocity = w if held else [0.1, 0.2, 0.3, *w]
    method = fm.ExplicitRungeKutta(pair=fm.Pair.DORMAND_PRINCE_8)
    run = scene.simulate(t[-1], rtol=1e-11, integrator=method)
    places = np.stack([run.position(bar.frame(name), t=t) for name in ("x_min", "x_max")], axis=1)
    return places, np.linalg.norm(run.q(bar) @ body.interface("x_max").modes[:3].T, axis=1).max()


def by_blocks(path, body, t, *, w, held, second_order):
    assert fm.export.sid(body, path) == ()
    v = (0.0, 0.0, 0.0) if held else (0.1, 0.2, 0.3)
    return fly(SidBody(path), t, w=w, v=v, gravity=GRAVITY, second_order=second_order, held=held)


@pytest.mark.parametrize(("held", "w", "bent"), [(True, [3.0, 2.0, -4.0], 0.025), (False, [12.0, 9.0, -10.0], 0.008)])
def test_a_spin_in_space(tmp_path, held, w, bent):
    """All blocks at once, with the second order of J that follows from Gr: the same motion as here."""
    body, t = slow(plain(soft_bar()), 8), np.linspace(0.0, 0.2, 4)
    ours, deflection = flight(body, t, w=w, held=held)
    assert deflection > bent
    theirs = by_blocks(tmp_path / "bar.SID_FEM", body, t, w=w, held=held, second_order=True)
    np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=1e-9)


def test_the_first_order_is_off_by_the_square_of_the_deformation(tmp_path):
    """What a program computes that takes J as the standard has it."""
    t, w = np.linspace(0.0, 0.07, 3), [3.0, 2.0, -4.0]
    apart, bent = [], []
    for stiffer in (30.0, 90.0):
        body = slow(plain(soft_bar()), 4, stiffer=stiffer)
        ours, deflection = flight(body, t, w=w, held=True)
        theirs = by_blocks(tmp_path / "bar.SID_FEM", body, t, w=w, held=True, second_order=False)
        apart.append(np.abs(theirs - ours).max())
        bent.append(deflection)
    assert apart[0] < 1e-7
    assert apart[0] / apart[1] == pytest.approx((bent[0] / bent[1]) ** 2, rel=0.25)


@pytest.mark.parametrize("block", ["Gr", "Ge", "Oe", "Cr", "Ct", "J", "mdCM", "Ke"])
def test_every_block_takes_part(tmp_path, block):
    """Without one block's entries, or their part linear in q, the accelerations are others."""
    path, random = tmp_path / "bar.SID_FEM", np.random.default_rng(1)
    fm.export.sid(slow(plain(soft_bar()), 6), path)
    q, rate, w = 0.01 * random.standard_normal(6), random.standard_normal(6), np.array([12.0, 9.0, -10.0])
    whole, lame = (SidBody(path) for _ in range(2))
    right, wrong = [], []
    for part in ("m0", "slopes"):
        right.append(getattr(whole.blocks[block], part).any())
        setattr(lame.blocks[block], part, 0.0 * getattr(lame.blocks[block], part))
        one, other = (file.accelerations(q, rate, w, GRAVITY, second_order=False, held=False) for file in (whole, lame))
        wrong.append(np.abs(one - other).max() > 1e-6 * np.abs(one).max())
        lame = SidBody(path)
    assert wrong == right


def rotating(path, body, spin):
    """Lowest frequencies (Hz) about the stretched shape, in a frame that turns about z at spin (rad/s)."""
    fm.export.sid(body, path)
    blocks, n = SidBody(path).blocks, body.n_modes
    products = np.array([0.0, 0.0, spin**2, 0.0, 0.0, 0.0])
    K = blocks["Ke"].m0 + np.einsum("lkc,c->lk", blocks["Oe"].m1, products)
    gyroscopic = blocks["Ge"].m0.reshape(n, n, 3)[:, :, 2] * spin
    values = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -gyroscopic]]))
    return np.sort(values.imag[values.imag > 0.0])[:2] / (2.0 * np.pi)


def test_spinning_stiffens_by_the_blocks_as_it_does_here(tmp_path):
    """Against the machine's linear equations about the steady spin, and Southwell's 0.193 in the plane of rotation."""
    body, spin, path = soft_bar(), 6.0, tmp_path / "bar.SID_FEM"
    scene = fm.System()
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bar.frame("x_min"))
    hub.prescribe(fm.Motion(*map(fm.compiled, (lambda t: 6.0 * t, lambda t: 6.0, lambda t: 0.0))))
    here = np.sort(scene.linearize(about=scene.equilibrium()).frequencies())[:2]
    found = rotating(path, body, spin)
    np.testing.assert_allclose(found, here, rtol=2e-4)
    still = body.frequencies(["x_min"])
    assert found[0] == pytest.approx(np.hypot(still[0], np.sqrt(0.193) * spin / (2.0 * np.pi)), rel=2e-3)
    assert found[1] == pytest.approx(np.hypot(still[1], np.sqrt(1.193) * spin / (2.0 * np.pi)), rel=2e-3)
    assert rotating(path, plain(body), spin)[0] < 0.7 * still[0]


@pytest.mark.parametrize("along", [-9.81, 9.81])
def test_weight_along_a_clamped_bar(tmp_path, along):
    """Hanging and standing, by m1 of Ct with the acceleration less gravity, against the machine's linear equations."""
    body, path = soft_bar(), tmp_path / "bar.SID_FEM"
    scene = fm.System(gravity=(along, 0.0, 0.0))
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
    here = np.sort(scene.linearize(about=scene.equilibrium()).frequencies())[:2]
    fm.export.sid(body, path)
    blocks = SidBody(path).blocks
    squares = np.linalg.eigvalsh(blocks["Ke"].m0 - along * blocks["Ct"].m1[:, :, 0])
    np.testing.assert_allclose(np.sqrt(squares[:2]) / (2.0 * np.pi), here, rtol=2e-3)
    assert (here[0] > body.frequencies(["x_min"])[0]) == (along > 0.0)


@pytest.mark.parametrize("force", [-20.0, 20.0])
def test_a_force_along_a_clamped_bar(tmp_path, force):
    """Pushed at more than half of Euler's load, or pulled, by m1 of phi, against the machine's linear equations."""
    body, path = soft_bar(), tmp_path / "bar.SID_FEM"
    scene = fm.System()
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
    scene.add_force(fm.force.FrameForce(bar.frame("x_max"), force=(force, 0.0, 0.0)))
    here = np.sort(scene.linearize(about=scene.equilibrium()).frequencies())[:2]
    fm.export.sid(body, path)
    file = SidBody(path)
    squares = np.linalg.eigvalsh(file.blocks["Ke"].m0 - force * file.nodes[1]["phi"].m1[0])
    np.testing.assert_allclose(np.sqrt(squares[:2]) / (2.0 * np.pi), here, rtol=2e-3)
    assert (here[0] > 1.2 * body.frequencies(["x_min"])[0]) == (force > 0.0)


@pytest.mark.parametrize("make", [soft_bar, damped_rod])
def test_a_body_comes_back_with_its_stiffening(tmp_path, make):
    body = make()
    path = tmp_path / "bödy.SID_FEM"
    told = fm.export.sid(body, path)
    assert any("stretch" in one for one in told)
    back = fm.export.read_sid(path)
    assert back.frame == body.frame
    np.testing.assert_allclose(back.gram, body.gram, rtol=0.0, atol=1e-14 * np.abs(body.gram).max())
    np.testing.assert_array_equal(back.damping, body.damping)
    assert back.geometric.loads == body.geometric.loads
    for found, wanted in zip(back.geometric.K, body.geometric.K, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-11 * max(1.0, np.abs(wanted).max()))
    for found, wanted in zip(back.interfaces, body.interfaces, strict=True):
        assert found.name == wanted.name
        for part in ("p_BI_B", "R_BI", "modes"):
            np.testing.assert_array_equal(getattr(found, part), getattr(wanted, part))
    assert fm.export.sid(back, tmp_path / "again.SID_FEM") == ()


def without(text, block, entry):
    """The text without the entries m0 or m1 of a block."""
    start, end = text.index(f"\n    {block}\n"), text.index(f"    end {block}\n")
    inside = re.sub(rf"^ *{entry}\(.*\n", "", text[start:end], flags=re.MULTILINE)
    if entry == "m1":
        inside = re.sub(r"(order +=) +1", r"\1 0", inside)
    return text[:start] + inside + text[end:]


def leave_out(text, block):
    start, end = text.index(f"    {block}\n"), text.index(f"    end {block}\n")
    return text[:start] + text[end + len(f"    end {block}\n") :]


SHORTER = {
    "as most programs write it": lambda text: without(text, "Gr", "m1"),
    "no Gr": lambda text: leave_out(text, "Gr"),
    "no Ge": lambda text: leave_out(without(text, "Gr", "m1"), "Ge"),
    "no Oe": lambda text: leave_out(text, "Oe"),
    "no De, no ksigma": lambda text: leave_out(leave_out(text, "De"), "ksigma"),
    "E": lambda text: text.replace("D+", "E+").replace("D-", "e-"),
    "no letter": lambda text: re.sub(r"D([+-])(\d\d)\b", r"\g<1>0\2", text),
}


@pytest.mark.parametrize("change", SHORTER.values(), ids=SHORTER.keys())
def test_the_integrals_follow_from_what_other_programs_write(tmp_path, change):
    body, path = plain(soft_bar()), tmp_path / "bar.SID_FEM"
    fm.export.sid(body, path)
    path.write_text(change(path.read_text()))
    back = fm.export.read_sid(path)
    np.testing.assert_allclose(back.gram, body.gram, rtol=0.0, atol=1e-13 * np.abs(body.gram).max())


@pytest.mark.parametrize("whole", [True, False])
def test_columns_axis_by_axis(tmp_path, whole):
    """As SIMPACK has them; a reader sees from Cr which order holds."""
    body, path = plain(soft_bar()), tmp_path / "bar.SID_FEM"
    n = body.n_modes
    fm.export.sid(body, path)
    before = SidBody(path).blocks
    fm.export.sid(body, path, columns=fm.export.SidColumns.BY_AXIS)
    after = SidBody(path).blocks
    for mode in (0, 3, n - 1):
        for axis in range(3):
            for block in ("Gr", "Ge"):
                here, there = before[block].m0[:, 3 * mode + axis], after[block].m0[:, n * axis + mode]
                np.testing.assert_array_equal(here, there)
            np.testing.assert_array_equal(before["Gr"].m1[:, :, 3 * mode + axis], after["Gr"].m1[:, :, n * axis + mode])
    if not whole:
        path.write_text(without(path.read_text(), "Gr", "m1"))
    back = fm.export.read_sid(path)
    np.testing.assert_allclose(back.gram, body.gram, rtol=0.0, atol=1e-13 * np.abs(body.gram).max())


#: Masses of 2 kg at (1, 0, 0) and of 3 kg at (0, 2, 0); the one mode moves them by (0, 0.5, 0) and (0, 0, 1). Me is
#: 2 0.25 + 3 = 3.5, Ke 14: a frequency of 2 rad/s. Entries as in the equations of taylor_blocks, by hand.
TWO_MASSES = """    1   1    :No. nodes, No. modes: two masses on springs
 part
      new modal                                 =
           refmod
                mass                            = 5.0D+00
                nelastq                         =     1
                ielastq (   1)                  = Eigen Mode    1 :        0.318 Hz
           end refmod
           frame
                new node                        =    6022
                     rframe                     =    body ref
                     origin
                          order = 1
                          nrow = 3
                          ncol = 1
                          nq = 1
                          nqn = 0
                          structure = 3
                          m0( 1, 1)             = 1.00000000000D+00
                          m1( 2, 1, 1)          = 5.0E-01
                     end origin
                end node
           end frame
           mdCM
{head:1 3 1}  m0( 1, 1) = 2.0
  m0( 2, 1) = 6.0
  m1( 2, 1, 1) = 1.0
  m1( 3, 1, 1) = 3.0
           end mdCM
           J
{head:1 6 1}  m0( 1, 1) = 12.0
  m0( 2, 1) = 2.0
  m0( 3, 1) = 14.0
  m1( 4, 1, 1) = -1.0
  m1( 6, 1, 1) = -6.0
           end J
           Ct
{head:0 1 3}  m0( 1, 2) = 1.0
  m0( 1, 3) = 3.0
           end Ct
           Cr
{head:0 1 3}  m0( 1, 1) = 6.0
  m0( 1, 3) = 1.0
           end Cr
           Me
{head:0 1 1}  m0( 1, 1) = 3.5D0
           end Me
           Gr
{head:0 3 3}  m0( 2, 1) = -2.0
  m0( 3, 2) = -12.0
           end Gr
           Ge
{head:0 1 3}           end Ge
           Oe
{head:1 1 6}  m0( 1, 4) = 1.0
  m0( 1, 5) = 6.0
  m1( 1, 1, 1) = -3.5
  m1( 1, 1, 2) = -3.0
  m1( 1, 1, 3) = -0.5
           end Oe
           Ke
{head:0 1 1}  m0( 1, 1) = 14.0
           end Ke
      end modal
 end part
"""


def heads(text):
    pattern = r"\{head:(\d) (\d) (\d)\}"
    return re.sub(pattern, r"order = \1\nnrow = \2\nncol = \3\nnq = 1\nnqn = 0\nstructure = 3\n", text)


def test_a_file_of_another_program(tmp_path):
    path = tmp_path / "two.SID_FEM"
    path.write_text(heads(TWO_MASSES))
    body = fm.export.read_sid(path)
    scale = 1.0 / np.sqrt(3.5)
    fields = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.5 * scale, 0.0], [1.0, 0.0, 2.0, 0.0, 0.0, 0.0, scale]])
    np.testing.assert_allclose(body.gram, fields.T @ np.diag([2.0, 3.0]) @ fields, rtol=0.0, atol=1e-14)
    assert body.stiffness == pytest.approx([4.0], rel=1e-14)
    np.testing.assert_array_equal(body.damping, [[0.0]])
    (frame,) = body.interfaces
    assert (frame.name, body.frame, body.geometric) == ("node_6022", None, None)
    np.testing.assert_allclose(frame.modes[:, 0], [0.0, 0.5 * scale, 0.0, 0.0, 0.0, 0.0], rtol=1e-14)
    np.testing.assert_allclose(body.partition, [[scale]], rtol=1e-14)


def test_blocks_of_different_lumpings(tmp_path):
    """Those that make the linear motion are believed, where the caller lets the others differ."""
    path = tmp_path / "two.SID_FEM"
    path.write_text(heads(TWO_MASSES))
    right = fm.export.read_sid(path)
    path.write_text(
        heads(TWO_MASSES).replace("= -12.0", "= -11.0").replace("m1( 1, 1, 2) = -3.0", "m1( 1, 1, 2) = -2.5")
    )
    with pytest.raises(ExportError, match="Gr and Cr contradict each other"):
        fm.export.read_sid(path)
    body = fm.export.read_sid(path, tolerance=0.2)
    np.testing.assert_allclose(body.mass_matrix(), right.mass_matrix(), rtol=0.0, atol=1e-14)
    assert body.geometric is None


def test_names_that_hold_keywords(tmp_path):
    """Lines are told by the keywords found in them: SidBody refuses a first line that holds one."""
    names = ("J frame Ct ksigma", "Öse 2%\n")
    body = soft_bar()
    frames = tuple(dataclasses.replace(one, name=name) for one, name in zip(body.interfaces, names, strict=True))
    body = dataclasses.replace(plain(body), interfaces=frames, frame=names[0])
    fm.export.sid(body, tmp_path / "bar.SID_FEM")
    assert SidBody(tmp_path / "bar.SID_FEM").n_nodes == 2
    back = fm.export.read_sid(tmp_path / "bar.SID_FEM")
    assert tuple(one.name for one in back.interfaces) == names


def test_names_that_are_too_long_are_told(tmp_path):
    body = plain(soft_bar())
    frames = tuple(dataclasses.replace(one, name=one.name * 60) for one in body.interfaces)
    body = dataclasses.replace(body, interfaces=frames, frame=frames[0].name)
    (told,) = (one for one in fm.export.sid(body, tmp_path / "bar.SID_FEM") if "names" in one)
    assert told == "the names of the interfaces, which are the nodes 1 to 2"
    assert [one.name for one in fm.export.read_sid(tmp_path / "bar.SID_FEM").interfaces] == ["node_1", "node_2"]


def test_nodes_of_the_mesh(tmp_path):
    body, path = soft_bar(), tmp_path / "bar.SID_FEM"
    chosen = [3, 17, 100]
    told = fm.export.sid(body, path, nodes=chosen)
    assert "the modes at the mesh's nodes" in told
    file, back = SidBody(path), fm.export.read_sid(path)
    assert [node["id"] for node in file.nodes] == [1, 2, 3, 4, 5]
    assert len(back.interfaces) == 2
    np.testing.assert_array_equal(back.modes.phi, body.modes.phi[chosen])
    there = [node["origin"].m0[:, 0] for node in file.nodes[2:]]
    np.testing.assert_allclose(there, body.modes.x[chosen], rtol=0.0, atol=1e-15)
    assert "the modes at the mesh's nodes" not in fm.export.sid(body, path, nodes=body.modes.node)
    with pytest.raises(ExportError, match=r"no mesh node 5000; its 189"):
        fm.export.sid(body, path, nodes=[5000])
    with pytest.raises(ExportError, match=r"keep=Keep\(modes=True\)"):
        fm.export.sid(damped_rod(), path, nodes=[1])


REFUSED = {
    "cut short": (lambda s: s[: len(s) // 2], "the file ends inside"),
    "empty": (lambda s: "", "line 0: the file ends"),
    "another file": (lambda s: "<xml>\n" + s, "line 1: a SID_FEM file begins with its numbers"),
    "NaN": (lambda s: s.replace("= 14.0", "= NaN"), r"expected m0\(row, column\)"),
    "too large": (lambda s: s.replace("= 14.0", "= 1D999"), "1D999 is not finite"),
    "nodes": (lambda s: s.replace("    1   1    :", "    7   1    :"), "says 7 nodes, and there are 1"),
    "modes": (lambda s: s.replace("    1   1    :", "    1  12    :"), "refmod says 1 modes, and the first line 12"),
    "many modes": (lambda s: s.replace("    1   1    :", "    1 99999999 :"), "2000 are the most"),
    "huge block": (lambda s: s.replace("nrow = 6", "nrow = 600000000"), "the most in all"),
    "other size": (lambda s: s.replace("nrow = 6", "nrow = 7"), r"block J is 7 x 1, expected \(6, 1\)"),
    "no place": (lambda s: s.replace("m0( 1, 6)", "m0( 1, 9)").replace("m0( 1, 5) = 6", "m0( 1, 9) = 6"), "no place"),
    "second order": (lambda s: s.replace("nqn = 0", "nqn = 2", 1), "above the first order"),
    "mass": (lambda s: s.replace("= 5.0D+00", "=-5.0D+00"), "mass must be positive"),
    "no refmod": (lambda s: re.sub(r" *refmod\n.*end refmod\n", "", s, flags=re.DOTALL), "no refmod"),
    "no Ke": (lambda s: re.sub(r" *Ke\n.*end Ke\n", "", s, flags=re.DOTALL), "no block Ke"),
    "Ke": (lambda s: s.replace("= 14.0", "= 0.0"), "not positive definite"),
    "no Oe, no m1 of Gr": (lambda s: re.sub(r" *Oe\n.*end Oe\n", "", s, flags=re.DOTALL), "neither Gr nor Oe"),
    "sign of Gr": (lambda s: s.replace("= -12.0", "= 12.0"), "Gr and Cr contradict each other"),
    "sign of Ct": (lambda s: s.replace("m0( 1, 3) = 3.0", "m0( 1, 3) = -3.0"), "Ct and m1 of mdCM contradict"),
    "stiffening": (lambda s: s.replace("m1( 1, 1, 2) = -3.0", "m1( 1, 1, 2) = -1.5"), "without geometric stiffness"),
    "no mass so": (lambda s: s.replace("m0( 1, 1) = 12.0", "m0( 1, 1) = 90.0"), "no distribution of mass"),
    "twice": (lambda s: s.replace("           Ke\n", "           Ct\n"), "is not a block of a body, or comes twice"),
    "pre-stress": (
        lambda s: s.replace(
            "           Ke\n",
            "ksigma\norder = 0\nnrow = 1\nncol = 1\nnq = 1\nnqn = 0\nstructure = 3\nm0(1,1) = 1.\nend ksigma\nKe\n",
        ),
        "ksigma is not zero",
    ),
}


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_refused(tmp_path, change, message):
    path, text = tmp_path / "x.SID_FEM", heads(TWO_MASSES)
    changed = change(text)
    assert changed != text
    path.write_text(changed)
    with pytest.raises(ExportError, match=message) as caught:
        fm.export.read_sid(path)
    assert str(path) in str(caught.value)


def test_damaged_files(tmp_path):
    path = tmp_path / "x.SID_FEM"
    assert survive(fm.export.read_sid, path, heads(TWO_MASSES).encode(), count=3000) < 1500
    fm.export.sid(slow(plain(soft_bar()), 2), path)
    assert survive(fm.export.read_sid, path, path.read_bytes(), count=300) < 200


def test_a_rigid_body(tmp_path):
    body = slow(plain(soft_bar()), 0)
    fm.export.sid(body, tmp_path / "x.SID_FEM")
    back = fm.export.read_sid(tmp_path / "x.SID_FEM")
    np.testing.assert_allclose(back.gram, body.gram, rtol=1e-14, atol=1e-15)


def test_numbers_are_whole_and_fit_narrow_readers(tmp_path):
    fm.export.sid(damped_rod(), tmp_path / "x.SID_FEM")
    text = (tmp_path / "x.SID_FEM").read_text(encoding="ascii")
    assert "E+" not in text
    assert re.findall(r"^    (\w+)$", text, re.MULTILINE) == ["refmod", "frame", *BLOCKS]
    numbers = re.findall(r"= *(-?\d\.\d+D[+-]\d\d)$", text, re.MULTILINE)
    assert len(numbers) > 1000
    assert {len(one.lstrip("-")) for one in numbers} == {22}
