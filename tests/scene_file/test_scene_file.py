"""Scene files: the machine that Python would build, and one clear line for whatever is wrong in one."""

import dataclasses
import random

import numpy as np
import pytest
from two_crosses_body import two_crosses

import flexmbd as fm
from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.scene_file import build, read_scene
from flexmbd.scene_file.entry_kinds import COUPLINGS, FORCES, INTEGRATORS, JOINTS

BODIES = """\
gravity = [0, 0, -9.81]

[[body]]
name = "arm"
mass = 2
inertia = [0.01, 0.02, 0.02]
com = [0.5, 0, 0]

[[body]]
name = "bob"
mass = 1.5
inertia = [[0.02, 0.001, 0], [0.001, 0.02, 0], [0, 0, 0.02]]

[[body]]
name = "cross"
record = "a.h5"

"""
JOINT = """\
[[joint]]
name = "hinge"
kind = "revolute"
axis = "y"
child = "arm"

"""
MORE = """\
[[joint]]
name = "slide"
kind = "prismatic"
parent = { body = "arm", p = [1, 0, 0] }
child = "bob"

"""
END = """\
[simulate]
t_end = 0.1
"""


@pytest.fixture
def scene(tmp_path):
    """Reads a text as a scene file beside which there is a record."""
    two_crosses().save(tmp_path / "a.h5")

    def read(text, *, end=END):
        path = tmp_path / "scene.toml"
        path.write_text(BODIES + text + end)
        return read_scene(path)

    return read


def same(one, other):
    """Two values of a joint or force, with the frames, joints and bodies that they hold."""
    if type(one) is not type(other):
        return False
    if isinstance(one, Frame):
        places = np.array_equal(one.p_BF_B, other.p_BF_B) and np.array_equal(one.R_BF, other.R_BF)
        return places and one.label == other.label
    if isinstance(one, (Connection, fm.FlexibleBody)):
        return one.name == other.name
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in dataclasses.fields(one))
    return one == other


def test_bodies_and_frames(scene):
    built = build(scene(JOINT + MORE))
    arm, bob, cross = (built.bodies[name] for name in ("arm", "bob", "cross"))
    assert (arm.mass, tuple(arm.com)) == (2.0, (0.5, 0.0, 0.0))
    np.testing.assert_array_equal(arm.moments()[1], fm.RigidBody(2.0, (0.01, 0.02, 0.02), (0.5, 0, 0)).moments()[1])
    assert bob.inertia == ((0.02, 0.001, 0.0), (0.001, 0.02, 0.0), (0.0, 0.0, 0.02))
    assert cross.record.fingerprint() == two_crosses().fingerprint()
    assert tuple(built.system.gravity) == (0.0, 0.0, -9.81)
    slide = built.joints["slide"]
    np.testing.assert_array_equal(slide.parent.p_BF_B, (1.0, 0.0, 0.0))
    assert slide.parent.body is arm
    assert slide.child.body is bob
    assert built.joints["hinge"].parent.body is built.system.ground


JOINT_TEXTS = {
    "fixed": ("", fm.joint.Fixed()),
    "revolute": ("axis = [0, 1, 1]", fm.joint.Revolute((0.0, 1.0, 1.0))),
    "prismatic": ('axis = "x"', fm.joint.Prismatic("x")),
    "screw": ('axis = "x"\npitch = 0.1', fm.joint.Screw(0.1, "x")),
    "cylindrical": ("", fm.joint.Cylindrical()),
    "planar": ('axis = "y"', fm.joint.Planar("y")),
    "planar_point": ('axis = "y"', fm.joint.PlanarPoint("y")),
    "translation": ("", fm.joint.Translation()),
    "universal": ('first = "y"\nsecond = "z"', fm.joint.Universal("y", "z")),
    "generic": ('translations = "xz"\nrotations = "y"', fm.joint.Generic("xz", "y")),
    "spherical": ("", fm.joint.Spherical()),
    "free": ("", fm.joint.Free()),
    "point_on_line": ('axis = "x"', fm.joint.PointOnLine("x")),
    "point_on_plane": ('axis = "x"', fm.joint.PointOnPlane("x")),
    "distance": ("length = 0.7", fm.joint.Distance(0.7)),
    "constant_velocity": ('axis = "x"', fm.joint.ConstantVelocity("x")),
    "rolling_disc": ("radius = 0.2", fm.joint.RollingDisc(0.2)),
}


@pytest.mark.parametrize("kind", JOINTS)
def test_joints(scene, kind):
    text, expected = JOINT_TEXTS[kind]
    built = build(scene(f'[[joint]]\nname = "j"\nkind = "{kind}"\nchild = "arm"\n{text}\n'))
    assert same(built.joints["j"].joint, expected)


def test_what_a_joint_starts_with(scene):
    text = JOINT + "position = 0.3\nvelocity = 2\n" + MORE + "motion = { amplitude = 1, omega = 2, offset = 3 }\n"
    text += '[[joint]]\nname = "ball"\nkind = "spherical"\nchild = "cross"\nposition = [0.6, 0.8, 0, 0]\n'
    built = build(scene(text))
    assert built.joints["hinge"].position == pytest.approx([0.3])
    assert built.joints["hinge"].velocity == pytest.approx([2.0])
    assert built.joints["slide"].motion == fm.Sine(1.0, 2.0, 0.0, 3.0)
    assert built.joints["ball"].position == pytest.approx([0.6, 0.8, 0.0, 0.0])


DRAWN = """
[[body]]
name = "plate"
mass = 1
inertia = [0.1, 0.1, 0.1]
p = [0.5, 0.2, 0]
R = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
[[joint]]
name = "post"
kind = "revolute"
axis = [0, 1, 1]
child = "plate"
at = [0.5, 0, 0.3]
"""


def test_a_joint_in_the_drawing(scene):
    """By its place and axis in the ground's axes; the frames on the bodies follow."""
    built = build(scene(JOINT + DRAWN))
    post, plate = built.joints["post"], built.bodies["plate"]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(post.parent.p_BF_B, (0.5, 0.0, 0.3))
    np.testing.assert_allclose(post.child.p_BF_B, turn.T @ (0.0, -0.2, 0.3), atol=1e-15)
    assert post.child.body is plate
    for fault, text in (
        (DRAWN.replace('child = "plate"', 'child = { body = "plate", p = [0, 0, 0] }'), "child.*name of a body"),
        (DRAWN.replace("at = [0.5, 0, 0.3]", "at = [0.5, 0]"), "at"),
        (DRAWN.replace("[0, 0, 1]]", "[0, 0, 2]]"), r"body.*plate.*not a rotation"),
    ):
        with pytest.raises(SceneError, match=text):
            build(scene(JOINT + fault))


FORCE_TEXTS = {
    "joint_torque": (
        'joint = "hinge"\nvalue = { amplitude = 3, omega = 4, phase = 0.5 }',
        lambda b: fm.force.JointTorque(b.joints["hinge"], fm.Sine(3.0, 4.0, 0.5)),
    ),
    "joint_force": ('joint = "slide"\nvalue = -2', lambda b: fm.force.JointForce(b.joints["slide"], -2.0)),
    "joint_spring": (
        'joint = "hinge"\nstiffness = { deflection = [-1, 0, 1], force = [-5, 0, 9], beyond = "linear" }\nrest = 0.2',
        lambda b: fm.force.JointSpring(
            b.joints["hinge"], fm.Table((-1.0, 0.0, 1.0), (-5.0, 0.0, 9.0), beyond=fm.Beyond.LINEAR), 0.2
        ),
    ),
    "plastic_joint_spring": (
        'joint = "hinge"\ndeformation = [0, 0.1, 0.3]\nforce = [0, 5, 6]\nrest = 0.2\nkinematic = 0.5',
        lambda b: fm.force.PlasticJointSpring(b.joints["hinge"], (0.0, 0.1, 0.3), (0.0, 5.0, 6.0), 0.2, 0.5),
    ),
    "plastic_spring": (
        'from = "ground"\nto = "bob"\ndeformation = [0.1, 0.3]\nforce = [5, 6]\nlength = 0.4',
        lambda b: fm.force.PlasticSpring(
            b.system.ground.frame(), b.bodies["bob"].frame(), (0.1, 0.3), (5.0, 6.0), 0.4
        ),
    ),
    "joint_damper": ('joint = "hinge"\ndamping = 2', lambda b: fm.force.JointDamper(b.joints["hinge"], 2.0)),
    "joint_stop": (
        'joint = "slide"\nlower = -1\nupper = 1\nstiffness = 1e4\ndamping = 0.1\ntransition = 0.01',
        lambda b: fm.force.JointStop(b.joints["slide"], -1.0, 1.0, 1e4, 0.1, 0.01),
    ),
    "joint_friction": (
        'joint = "slide"\ncoulomb = 1\nregularisation = 0.01\nstatic = 2\nstribeck = 0.1\nviscous = 3\ncoordinate = 0',
        lambda b: fm.force.JointFriction(b.joints["slide"], 1.0, 0.01, 2.0, 0.1, 3.0),
    ),
    "bearing_friction": (
        'joint = "hinge"\ncoefficient = 0.1\nregularisation = 0.01\nradius = 0.02',
        lambda b: fm.force.BearingFriction(b.joints["hinge"], 0.1, 0.01, 0.02),
    ),
    "spring_damper": (
        'from = "ground"\nto = "bob"\nstiffness = 100\nlength = 0.4\ndamping = 1',
        lambda b: fm.force.SpringDamper(b.system.ground.frame(), b.bodies["bob"].frame(), 100.0, 0.4, 1.0),
    ),
    "bushing": (
        'from = { body = "ground", p = [1, 2, 3], R = [[0, -1, 0], [1, 0, 0], [0, 0, 1]] }\nto = "bob"\n'
        "stiffness = [1, 2, 3, 4, 5, 6]\nsymmetric = true",
        lambda b: fm.force.Bushing(
            b.system.ground.frame((1, 2, 3), R=[[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
            b.bodies["bob"].frame(),
            (1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
            symmetric=True,
        ),
    ),
    "line_force": (
        'from = "ground"\nto = "bob"\nvalue = { amplitude = 3, omega = 4 }',
        lambda b: fm.force.LineForce(b.system.ground.frame(), b.bodies["bob"].frame(), fm.Sine(3.0, 4.0)),
    ),
    "shaft_inertia": (
        'joint = "hinge"\ninertia = 0.002\nratio = 30',
        lambda b: fm.force.ShaftInertia(b.joints["hinge"], 0.002, 30.0),
    ),
    "gravitation": (
        'bodies = ["bob", "arm"]\nG = 3',
        lambda b: fm.force.Gravitation((b.bodies["bob"], b.bodies["arm"]), 3.0),
    ),
    "frame_force": (
        'frame = "bob"\nforce = [1, { t = [0, 1, 2], y = [0, 5, 0], monotone = true }, 0]',
        lambda b: fm.force.FrameForce(
            b.bodies["bob"].frame(), (1.0, fm.Table((0.0, 1.0, 2.0), (0.0, 5.0, 0.0), monotone=True), 0.0)
        ),
    ),
    "distributed_load": (
        'body = "cross"\nload = "{load}"\nfactor = 3',
        lambda b: fm.force.DistributedLoad(b.bodies["cross"], two_crosses().loads.names[0], 3.0),
    ),
}  # fmt: skip


def test_every_kind_of_force_is_tested():
    # test_user_files.py, test_between_pairs.py, test_ports_in_files.py
    elsewhere = {"joint_law", "state_force", "kane_force", "between_pairs", "shunt"}
    assert set(FORCES) == {*FORCE_TEXTS, *elsewhere}


@pytest.mark.parametrize("kind", FORCE_TEXTS)
def test_forces(scene, kind):
    text, expected = FORCE_TEXTS[kind]
    loads = two_crosses().loads
    if kind == "distributed_load" and loads is None:
        with pytest.raises(SceneError, match=r"force\[0\] \(distributed_load\): .*load"):
            build(scene(JOINT + MORE + f'[[force]]\nkind = "{kind}"\n{text}\n'))
        return
    text = text.replace("{load}", loads.names[0] if loads else "")
    built = build(scene(JOINT + MORE + f'[[force]]\nkind = "{kind}"\n{text}\n'))
    (made,) = built.system._forces
    assert same(made, expected(built))


@pytest.mark.parametrize("kind", COUPLINGS)
def test_couplings(scene, kind):
    texts = {
        "gear": 'first = "hinge"\nsecond = "other"\nratio = -2',
        "rack_and_pinion": 'pinion = "hinge"\nrack = "slide"\nradius = 0.1',
    }
    other = '[[joint]]\nname = "other"\nkind = "revolute"\nchild = "cross"\n'
    built = build(scene(JOINT + MORE + other + f'[[coupling]]\nkind = "{kind}"\n{texts[kind]}\n'))
    expected = {
        "gear": lambda: fm.joint.Gear(built.joints["hinge"], built.joints["other"], -2.0),
        "rack_and_pinion": lambda: fm.joint.RackAndPinion(built.joints["hinge"], built.joints["slide"], 0.1),
    }
    (made,) = built.system._couplings
    assert same(made, expected[kind]())


@pytest.mark.parametrize("kind", INTEGRATORS)
def test_integrators(scene, kind):
    read = scene(JOINT, end=f'{END}integrator = "{kind}"\nh = 1e-3\nrtol = 1e-4\n')
    assert (read.run.integrator, read.run.h, read.run.rtol, read.run.t_end) == (kind, 1e-3, 1e-4, 0.1)
    assert type(INTEGRATORS[kind]()).__name__.lower() == kind.replace("_", "")


WRONG = {
    ("mass = 2\n", "mas = 2\n"): "body[0].mas: is not known; did you mean 'mass'? There may be name, mass, ",
    ("mass = 2\n", ""): "body[0]: has no 'mass', which is needed",
    ("mass = 2\n", 'mass = "2"\n'): "body[0].mass: must be a number, got '2'",
    ("mass = 2\n", "mass = nan\n"): "body[0].mass: must be a finite number, got nan",
    ("mass = 2\n", "mass = true\n"): "body[0].mass: must be a number, got True",
    ("mass = 2\n", "mass = -2\n"): "body[0] (arm): rigid body: mass must be positive, got -2.0",
    ("[0.01, 0.02, 0.02]", "[0.01, 0.02]"): "body[0].inertia: must be a list of 3 numbers, got [0.01, 0.02]",
    ("[0.01, 0.02, 0.02]", "0.01"): "body[0].inertia: must be a list of 3 numbers, got 0.01",
    ("[0.5, 0, 0]", '[0.5, 0, "a"]'): "body[0].com[2]: must be a number, got 'a'",
    ("[0.001, 0.02, 0]", "[0.001, 0.02]"): "body[1].inertia[1]: must be a list of 3 numbers",
    ('"bob"', '"arm"'): "body[0].name: 'arm' is taken",
    ('"bob"', '"ground"'): "body[1].name: 'ground' is the inertial frame",
    ('"a.h5"', '"nowhere.h5"'): "body[2] (cross): cannot read",
    ('record = "a.h5"', 'record = "a.h5"\nmass = 1'): "body[2].mass: is not known; there may be name, record",
    ("gravity = [0, 0, -9.81]", "gravity = -9.81"): "gravity: must be a list of 3 numbers, got -9.81",
    ("gravity", "gravty"): "gravty: is not known; did you mean 'gravity'?",
    ('child = "bob"\n', 'child = "bob"\nmotion = { t = [0, 1], y = [0, 1], beyond = "hol" }\n'): (
        "joint[1].motion.beyond: 'hol' is not known; did you mean 'hold'?"
    ),
    ("[[joint]]", "[[joints]]"): "joints: is not known; did you mean 'joint'?",
    ("[simulate]", "coupling = 3\n[simulate]"): "joint[1].coupling: is not known",
    ("gravity", "coupling = 3\ngravity"): "coupling: must be tables headed [[coupling]], got 3",
    ('kind = "revolute"', 'kind = "revolut"'): "joint[0].kind: 'revolut' is not known; did you mean 'revolute'?",
    ('kind = "revolute"', 'kind = "hinge of brass"'): "'hinge of brass' is not known; there are fixed, revolute, ",
    ('kind = "revolute"', 'kind = "spherical"'): "joint[0].axis: is not known; ",
    ('kind = "revolute"', 'kind = "distance"'): "joint[0].axis: is not known; ",
    ('axis = "y"', 'axis = "w"'): "joint[0].axis: must be \"x\", \"y\", \"z\" or a direction",
    ('axis = "y"', "axis = [0, 0, 0]"): "joint[0] (hinge): ",
    ('axis = "y"', "pitch = 1"): "joint[0].pitch: is not known; there may be kind, name, parent, child, ",
    ('child = "arm"', 'child = "amr"'): "joint[0].child: there is no body 'amr'; did you mean 'arm'?",
    ('child = "arm"', 'child = "arm:tip"'): "joint[0].child: 'arm' is rigid and has no interfaces",
    ('child = "arm"', 'child = "cross:tip"'): "joint[0] (hinge): the reduced body has no interface 'tip'",
    ('child = "arm"', "child = 3"): "joint[0].child: must be a frame,",
    ('child = "arm"', 'child = { body = "cross", p = [0, 0, 0] }'): "joint[0].child: 'cross' is flexible:",
    ('child = "arm"', 'child = { body = "arm", q = [0, 0, 0] }'): "joint[0].child.q: is not known;",
    ('child = "arm"', 'child = { body = "arm", R = [[1, 0, 0], [0, 1, 0], [0, 0, 2]] }'): "joint[0] (hinge): frame arm",
    ('child = "arm"', 'child = "ground"'): "joint[0] (hinge): joint 'hinge' connects body 'ground' to itself",
    ('child = "arm"', 'child = "arm"\nposition = [0, 1]'): "joint[0] (hinge): joint 'hinge': position of a Revolute",
    ('child = "arm"', 'child = "arm"\nposition = "low"'): "joint[0].position: must be a number, got 'low'",
    ('child = "arm"', 'child = "arm"\nmotion = { omega = 1 }'): "joint[0].motion: has no 'amplitude'",
    ('child = "arm"', 'child = "arm"\nmotion = { t = [0, 0], y = [1, 2] }'):
        "joint[0].motion: needs at least two points",
    ('name = "slide"', 'name = "hinge"'): "joint[0].name: 'hinge' is taken",
    ("t_end = 0.1", "t_end = 0.1\nrtoll = 1"): "simulate.rtoll: is not known; did you mean 'rtol'?",
    ("t_end = 0.1", 't_end = 0.1\nintegrator = "rk4"'): "simulate.integrator: 'rk4' is not known; there are ",
    ("[simulate]\nt_end = 0.1", ""): "has no 'simulate', which is needed",
    ("t_end = 0.1", "t_end = 0.1\n[output]\nevery = 0"): "output.every: must be above 0 s, got 0",
    ("t_end = 0.1", 't_end = 0.1\n[output]\njoints = ["hing"]'):
        "output.joints: there is no joint 'hing'; did you mean",
    ("t_end = 0.1", 't_end = 0.1\n[output]\njoints = "hinge"'): "output.joints: must be a list of texts",
    ("t_end = 0.1", 't_end = 0.1\n[output]\nmodal = ["arm"]'): "output.modal: there is no flexible body 'arm'",
    ("t_end = 0.1", 't_end = 0.1\n[output]\npositions = "arm"'): "output.positions: must be a list of frames",
    ("t_end = 0.1", 't_end = 0.1\n[output]\nformats = ["xls"]'):
        "output.formats: 'xls' is not known; there are csv, npz",
    ("t_end = 0.1", 't_end = 0.1\n[output]\nfilm = "../a.mp4"'): "output.film: must be a file name that ends in .mp4",
    ("t_end = 0.1", 't_end = 0.1\n[output]\nenergies = 1'): "output.energies: must be true or false, got 1",
    ("t_end = 0.1", 't_end = 0.1\n[output]\nevery = 1\nreactions = ["hinge"]'):
        "output.reactions: are known at the ends",
    ("[simulate]", '[[force]]\nkind = "joint_torque"\njoint = "hinge"\n[simulate]'): "force[0]: has no 'value', which",
    ("[simulate]", '[[force]]\nkind = "joint_torqe"\n[simulate]'): "force[0].kind: 'joint_torqe' is not known; did you",
    ("[simulate]", '[[force]]\nkind = "joint_torque"\njoint = "slide"\nvalue = 1\n[simulate]'):
        "force[0] (joint_torque): ",
    ("[simulate]", '[[force]]\nkind = "joint_damper"\njoint = 3\ndamping = 1\n[simulate]'):
        "force[0].joint: must be a text",
    ("[simulate]", '[[force]]\nkind = "joint_torque"\njoint = "hinge"\nvalue = [1]\n[simulate]'):
        "force[0].value: must be a",
    ("[simulate]", '[[force]]\nkind = "frame_force"\nframe = "bob"\nforce = [1, 2]\n[simulate]'):
        "force[0].force: must be",
    ("[simulate]", "simulate"): "is no TOML: ",
}  # fmt: skip


@pytest.mark.parametrize("change", WRONG)
def test_what_is_wrong_is_named_by_its_place(tmp_path, change):
    two_crosses().save(tmp_path / "a.h5")
    whole = BODIES + JOINT + MORE + END
    assert change[0] in whole
    path = tmp_path / "größer.toml"
    path.write_text(whole.replace(*change))
    with pytest.raises(SceneError) as caught:
        build(read_scene(path))
    assert WRONG[change] in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_unchanged_scene_is_sound(scene):
    assert len(build(scene(JOINT + MORE)).bodies) == 4


def test_mutated_scenes_are_refused_or_sound(tmp_path):
    """Thousands of files with bytes lost, doubled, changed or swapped: an error of flexmbd's, or a scene."""
    two_crosses().save(tmp_path / "a.h5")
    forces = "".join(
        f'[[force]]\nkind = "{kind}"\n{text}\n' for kind, (text, _) in FORCE_TEXTS.items() if kind != "distributed_load"
    )
    whole = (BODIES + JOINT + MORE + forces + END + '[output]\npositions = ["bob"]\n').encode()
    path = tmp_path / "scene.toml"
    rng = random.Random(7)
    refused = unplaced = 0
    for _ in range(1500):
        data = bytearray(whole)
        for _ in range(rng.choice((1, 1, 2, 5))):
            start = rng.randrange(len(data))
            stop = min(len(data), start + rng.choice((1, 2, 8, 60)))
            way = rng.randrange(4)
            if way == 0:
                del data[start:stop]
            elif way == 1:
                data[start:start] = data[start:stop]
            elif way == 2:
                data[start] = rng.choice(b'0123456789[]{}=".,#\n\\e-\x00\xff')
            else:
                other = rng.randrange(len(data))
                data[start:stop] = data[other : other + stop - start]
        path.write_bytes(bytes(data))
        try:
            build(read_scene(path))
        except FlexmbdError as error:
            refused += 1
            unplaced += "scene.toml" not in str(error)
    assert refused > 700
    assert unplaced == 0
