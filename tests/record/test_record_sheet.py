"""The sheet of a record: its figures by hand, every optional group there and not there, and no noise."""

import dataclasses
import re

import numpy as np
import pytest
from two_crosses_body import MASS_A, MASS_B, SPRING, TORSION, TURN_A, TURN_B, two_crosses, with_groups

from flexmbd.record.reduced_body import (
    ContactPatches,
    DistributedLoads,
    FurtherUnknowns,
    GeometricStiffness,
    Heat,
    InterfaceFrame,
    NodalInterfaces,
    NodalModes,
    ReducedBody,
    StressModes,
    Surface,
)

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"


def line(text, beginning):
    """The only line that begins so, without its beginning."""
    found = [row.strip()[len(beginning) :] for row in text.splitlines() if row.strip().startswith(beginning)]
    assert len(found) == 1, (beginning, found)
    return found[0].strip()


def figures(text, beginning):
    return [float(number) for number in re.findall(rf"(?<![\w.]){NUMBER}", line(text, beginning))]


def mode(text, number):
    """The figures of one row of the table of modes."""
    section = next(part for part in text.split("\n\n") if part.startswith("modes:"))
    return figures(section, f"{number} ")


def stiffness(text):
    """The figures of the only interface that has a static stiffness, by direction."""
    row = next(row for row in text.splitlines() if row.strip().startswith("x "))
    return {dof: float(value) for dof, value in re.findall(rf"(\w+) ({NUMBER})", row)}


def test_mass_and_inertia():
    text = two_crosses().inspect()
    assert figures(text, "mass") == [10.0]
    assert line(text, "centre of mass") == "(0.2, 0, 0) m from B, in B's axes"
    across = 10.0 * 0.3**2 / 2 + 8.0 * 0.2**2 + 2.0 * 0.8**2
    assert figures(text, "inertia")[:3] == pytest.approx([10.0 * 0.3**2, across, across], rel=1e-5)
    assert line(text, "0.9 about") == "(1, 0, 0)"
    assert text.count("2.05 about any axis across the third") == 2
    assert line(text, "body frame B").startswith("on interface A,")
    assert line(text, "file format") == "version 1"
    assert line(text, "fingerprint") == two_crosses().fingerprint()


def test_modes_frequencies_and_shares():
    """Of a motion of A the torsion mode takes B's share of the inertia, the axial one B's share of the mass."""
    text = two_crosses().inspect()
    torsion, axial = mode(text, 1), mode(text, 2)
    free = [TORSION * (1 / TURN_A + 1 / TURN_B), SPRING * (1 / MASS_A + 1 / MASS_B)]
    held = [TORSION / TURN_B, SPRING / MASS_B]
    for row, one, other in zip((torsion, axial), free, held, strict=True):
        assert row[::2][:2] == pytest.approx(np.sqrt([one, other]) / (2 * np.pi), rel=1e-5)
        assert row[1::2][:2] == [0.0, 0.0]
    assert torsion[4:] == [0, 0, 0, pytest.approx(100 * TURN_B / (TURN_A + TURN_B)), 0, 0]
    assert axial[4:] == [pytest.approx(100 * MASS_B / (MASS_A + MASS_B)), 0, 0, 0, 0, 0]
    assert figures(text, "sum") == [20.0, 0, 0, 20.0, 0, 0]
    assert "couples" not in text
    assert "damping ratios of the first modes" not in text


def test_damping():
    """Ratios of 2 % and 5 % by the definition c = 2 zeta omega, and a coupling of a tenth.

    A spring k and a damper c between masses, or inertias, a and b: c / 2 (k b)^(1/2) where a is held, c / 2 (k a)^(1/2)
    where b is, and c / 2 (k a b / (a + b))^(1/2) where none is.
    """
    omega = np.sqrt([TORSION / TURN_B, SPRING / MASS_B])
    damping = np.diag(2 * np.array([0.02, 0.05]) * omega)
    text = two_crosses(damping=damping).inspect()
    assert [mode(text, 1)[3], mode(text, 2)[3]] == pytest.approx([0.02, 0.05])
    held = np.array([0.02, 0.05])
    a, b = np.array([TURN_A, MASS_A]), np.array([TURN_B, MASS_B])
    free, other = held * np.sqrt((a + b) / a), held * np.sqrt(b / a)
    assert [mode(text, 1)[1], mode(text, 2)[1]] == pytest.approx(free, rel=1e-3)
    for state, ratios in (("of the free body", free), ("with A held", held), ("with B held", other)):
        assert figures(text, state) == pytest.approx(ratios, rel=1e-3)
    assert "couples" not in text
    damping[0, 1] = damping[1, 0] = 0.1 * np.sqrt(damping[0, 0] * damping[1, 1])
    assert figures(two_crosses(damping=damping).inspect(), "the damping couples modes") == [0.1]


def test_interfaces_and_their_stiffness():
    text = two_crosses().inspect()
    assert line(text, "A  ") == "(0, 0, 0); B's axes"
    assert line(text, "B  ") == "(1, 0, 0); turned 90 deg about (1, 0, 0)"
    assert stiffness(text) == {"x": 5e4, "rx": 800.0}
    assert line(text, "x 50000") == "y rigid   z rigid   rx 800   ry rigid   rz rigid"


def test_stiffness_is_along_the_axes_of_the_interface():
    """The spring along B's x is along the y of a frame turned by -90 degrees about z, and half of it at 45."""
    body = two_crosses()
    for degrees, expected in ((-90.0, "x rigid   y 50000 "), (45.0, "x 100000   y 100000 ")):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        frame = dataclasses.replace(body.interfaces[1], R_BI=turned)
        text = two_crosses(interfaces=(body.interfaces[0], frame)).inspect()
        assert f"turned {abs(degrees):g} deg about (0, 0, {np.sign(degrees):g})" in text
        assert expected in text


def test_axes_of_the_interface_are_the_columns():
    """I's x, y and z along B's y, z and x."""
    body = two_crosses()
    frame = dataclasses.replace(body.interfaces[1], R_BI=np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    text = two_crosses(interfaces=(body.interfaces[0], frame)).inspect()
    assert "x rigid   y rigid   z 50000   rx rigid   ry rigid   rz 800" in text
    assert "turned 120 deg about (0.57735, 0.57735, 0.57735)" in text


def test_beam_of_solids_is_as_stiff_as_a_timoshenko_beam():
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import guyan

    length, width, E, nu = 1.0, 0.1, 2.1e11, 0.0
    mesh = meshes.beam(length, width, width, h=width / 2, cell="hexahedron", degree=1)
    part = ContinuumModel(
        mesh,
        solid_linear,
        solid_linear.Parameters(E=E, nu=nu, rho=7850.0),
        degree=2,
        interfaces=[Interface("start"), Interface("end")],
    )
    text = guyan(part, frame="start").inspect()
    area, second, shear = width**2, width**4 / 12, E / 2
    bending = 1 / (length**3 / (3 * E * second) + length / (5 / 6 * shear * area))
    values = stiffness(text)
    assert values["x"] == pytest.approx(E * area / length, rel=1e-5)
    assert [values["y"], values["z"]] == pytest.approx([bending] * 2, rel=2e-3)
    assert [values["ry"], values["rz"]] == pytest.approx([E * second / length] * 2, rel=1e-4)
    # Saint-Venant's torsion of a square; the rigid ends keep it from warping there
    assert values["rx"] == pytest.approx(0.1406 * shear * width**4 / length, rel=0.02)


def test_partition():
    text = two_crosses().inspect()
    assert line(text, "2               B.x .. ") == "B.rx (m, rad)"
    names = ("tip.x", "tip.y", "fixed-interface 9", "fixed-interface 10", "odd")
    body = ReducedBody(
        gram=np.diag([1.0] * 4 + [1.0 / 3.0] * 15),
        stiffness=np.ones(5),
        damping=np.zeros((5, 5)),
        interfaces=(),
        frame=None,
        partition=np.eye(5),
        partition_names=names,
    )
    text = body.inspect()
    assert line(text, "2               tip.x .. ") == "tip.y (m, rad)"
    assert line(text, "2               fixed-interface 9 .. ") == "fixed-interface 10"
    assert line(text, "1               odd") == ""
    names = ("tip.rx from a", "tip.rz from a", "b.rz from a", "c 1", "c 2")
    relative = dataclasses.replace(body, partition_names=names)
    text = relative.inspect()
    assert line(text, "2               tip.rx from a .. ") == "tip.rz from a (m, rad)"
    assert line(text, "1               b.rz from a") == "(m, rad)"
    assert line(text, "2               c 1 .. ") == "c 2"


def test_body_frame_in_the_mesh():
    assert line(two_crosses().inspect(), "in the mesh") == "origin of B at (0, 0, 0) m; the mesh's axes"
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    text = two_crosses(p_MB_M=np.array([0.5, -2.0, 1e-17]), R_MB=quarter).inspect()
    assert line(text, "in the mesh") == "origin of B at (0.5, -2, 0) m; turned 90 deg about (0, 0, 1)"


def test_floating_body():
    text = two_crosses(frame=None).inspect()
    assert line(text, "body frame B") == "floating on the mean axis of the undeformed body"
    # no static stiffness without a place that is held, no frequency with B held, no effective mass
    assert "rigid" not in text
    assert "held" not in text
    assert mode(text, 1) == pytest.approx([np.sqrt(TORSION * (1 / TURN_A + 1 / TURN_B)) / (2 * np.pi), 0], rel=1e-5)


def test_rigid_body():
    text = two_crosses(
        gram=two_crosses().gram[:4, :4],
        stiffness=np.zeros(0),
        damping=np.zeros((0, 0)),
        interfaces=(InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 0))),),
        partition=np.zeros((0, 0)),
        partition_names=(),
    ).inspect()
    assert "modes: none, the body is rigid" in text
    assert figures(text, "mass") == [10.0]


PHI = np.zeros((3, 3, 2))
GROUPS = {
    "modes": (NodalModes(np.arange(3), np.zeros((3, 3)), PHI), "3 nodes; "),
    "nodal": (NodalInterfaces(("weld",), np.arange(3), np.zeros((3, 3)), np.zeros(3), PHI), "3 nodes; "),
    "unknowns": (FurtherUnknowns(np.arange(4), np.zeros((4, PHI.shape[2]))), "4 dofs; "),
    "surface": (Surface(np.zeros((3, 3)), np.array([[0, 1, 2]]), PHI), "1 triangle on 3 vertices; "),
    "geometric": (
        GeometricStiffness(("angular velocity zz", "B.x"), np.array([np.diag([3e3, -50.0]), np.zeros((2, 2))])),
        "2 loads; ",
    ),
    "loads": (
        DistributedLoads(("gas",), np.array([[7.0, 0, 1e-17]]), np.array([[0, 0.5, 0]]), np.zeros((1, 2))),
        "1 load; ",
    ),
    "heat": (Heat(("warm", "hot"), np.arange(3), np.ones((2, 3))), "2 temperatures at 3 nodes; "),
    "stress": (StressModes(np.arange(3), np.zeros((3, 3)), np.zeros(3), np.zeros((3, 6, 2))), "3 nodes; "),
    "contact": (
        ContactPatches(
            ("tooth",), np.zeros(2), np.zeros((2, 3)), np.array([np.eye(3)] * 2), np.array([1.0, 2.0]),
            np.zeros((2, 3, 2)), np.diag([1.0, 2, 3, 4, 5, 6]), np.array([[0, 1, 2]]), np.zeros(1),
        ),
        "2 patches; ",
    ),
}


@pytest.mark.parametrize("name", GROUPS)
def test_optional_group_there_and_not_there(name):
    group, summary = GROUPS[name]
    for body, expected in ((two_crosses(), "absent; "), (two_crosses(**{name: group}), summary)):
        text = body.inspect()
        for other in GROUPS:
            found = line(text, f"{other}  ")
            assert found.startswith(f"{expected if other == name else 'absent; '}for ")


def test_loads_with_their_figures():
    text = two_crosses(geometric=GROUPS["geometric"][0], loads=GROUPS["loads"][0]).inspect()
    torsion, axial = TORSION / TURN_B, SPRING / MASS_B
    assert figures(text, "angular velocity zz") == pytest.approx([-50.0 / axial, 3e3 / torsion], rel=1e-3)
    assert figures(text, "B.x: ") == [0.0, 0.0]
    assert line(text, "gas: ") == "force (7, 0, 0) N, moment (0, 0.5, 0) N m about B, per unit factor"


def test_contact_patches_with_their_flexibility():
    text = two_crosses(contact=GROUPS["contact"][0]).inspect()
    said = line(text, "tooth: ")
    assert said == "2 patches, 1 to 2 m^2; beside the modes 1 to 4 m/N along the normals, 2 to 6 across"


def test_a_loaded_state_stands_with_the_body_frame():
    provenance = {"prestress": "pressure 'p' on 'lid': 2e+06\nlargest displacement 1 m", "a": "b"}
    text = two_crosses(provenance=provenance).inspect()
    above, _, below = text.partition("interfaces:")
    assert "must not apply them again\n                  pressure 'p' on 'lid': 2e+06\n" in above
    assert line(above, "largest displacement") == "1 m"
    assert below.endswith("\nprovenance\n  a  b\n")
    assert "prestressed" not in two_crosses().inspect()


def test_provenance_of_several_lines_in_the_order_of_the_keys():
    text = two_crosses(provenance={"mesh": "abc", "form": "one\ntwo", "empty": ""}).inspect()
    assert text.endswith("\nprovenance\n  empty\n  form   one\n         two\n  mesh   abc\n")


@pytest.mark.parametrize("make", [two_crosses, with_groups])
def test_same_text_after_save_and_load(tmp_path, make):
    body = make(**({"provenance": {"z": "1", "a": "2"}} if make is two_crosses else {}))
    body.save(tmp_path / "body.h5")
    assert ReducedBody.load(tmp_path / "body.h5").inspect() == body.inspect()


def test_noise_is_not_shown():
    rng = np.random.default_rng(0)
    gram = two_crosses().gram
    noise = 1e-15 * rng.normal(size=gram.shape)
    noisy = two_crosses(gram=gram + noise + noise.T).inspect()
    # but for the fingerprint
    assert noisy.splitlines()[3:] == two_crosses().inspect().splitlines()[3:]
