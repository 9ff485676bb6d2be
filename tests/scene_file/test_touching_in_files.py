"""Shapes that touch in scene files: the same numbers as in Python, and faults named by their places."""

import re
from pathlib import Path

import numpy as np
import pytest
import pyvista

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.scene_file import build, plan_columns, read_scene, tabulate
from flexmbd.scene_file.touching import LAWS, SHAPES

PAGE = Path(__file__).parents[2] / "docs" / "command_line.md"

SCENE = """\
gravity = [0, 0, -9.81]

[[body]]
name = "ball"
mass = 0.17
inertia = [5.562e-5, 5.562e-5, 5.562e-5]

[[body]]
name = "block"
mass = 1.0
inertia = [1e-3, 1e-3, 1e-3]

[[joint]]
name = "ball_free"
kind = "free"
child = "ball"
position = [0, 0, 0.03, 1, 0, 0, 0]
velocity = [1, 0, 0, 0, 0, 0]

[[joint]]
name = "block_free"
kind = "free"
child = "block"
position = [0.5, 0, 0.2, 1, 0, 0, 0]

[simulate]
t_end = 0.05

"""


def example():
    return re.findall(r"```toml\n(\[\[touch\]\].*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)[0]


def written(folder, text, scene=SCENE):
    path = folder / "scene.toml"
    path.write_text(scene + text)
    return path


def python():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(0.17, (5.562e-5, 5.562e-5, 5.562e-5)), name="ball")
    block = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="block")
    one = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame(), name="ball_free")
    two = scene.connect(fm.joint.Free(), scene.ground.frame(), block.frame(), name="block_free")
    one.position, one.velocity = (0, 0, 0.03, 1, 0, 0, 0), (1, 0, 0, 0, 0, 0)
    two.position = (0.5, 0, 0.2, 1, 0, 0, 0)
    return scene, ball, block


def test_the_page_s_contacts_are_those_of_python(tmp_path):
    read = read_scene(written(tmp_path, example()))
    built = build(read)
    run = built.system.simulate(0.05)
    scene, ball, block = python()
    floor = contact.HalfSpace(scene.ground.frame())
    cloth = contact.PowerLaw.bearing(load=1.7, depth=1e-6, restitution=0.5, speed=1e-3)
    rough = contact.Friction(mu=0.2, stiffness=1.7e6, damping=50.0, load=1.7)
    (pair,) = scene.touch(floor, contact.Sphere(ball.frame(), 0.0286), cloth, friction=rough)
    plates = [contact.Box(block.frame(), (0.1, 0.1, 0.1)), contact.Sphere(ball.frame(), 0.0286)]
    scene.touch(plates, plates, contact.PowerLaw(k=1e5, p=1.5, restitution=0.5, speed=None))
    same = scene.simulate(0.05)
    np.testing.assert_array_equal(run.x, same.x)
    assert [len(found) for found in built.touches.values()] == [1, 1]
    table = tabulate(run, plan_columns(built, read.output), every=0.01)
    t = table.column("t")
    np.testing.assert_array_equal(table.column("rolls.gap"), same.contacts(pair, t=t)[0].gap)
    np.testing.assert_array_equal(table.column("rolls.fx"), same.contacts(pair, t=t)[0].force[:, 0])


SPHERE = '{ kind = "sphere", frame = "ball", radius = 0.1 }'
KINDS = {
    "vertex": "",
    "sphere": "radius = 0.1",
    "half_space": 'normal = "y"',
    "hollow_sphere": "radius = 2.0",
    "hollow_cylinder": "radius = 2.0",
    "cylinder": "radius = 0.1",
    "disc": "radius = 0.2, thickness = 0.1, rounding = 0.02",
    "capsule": "radius = 0.1, length = 0.3",
    "box": "sides = [0.1, 0.2, 0.3]",
    "profile": "points = [[0, 0], [1, 0], [1, 1]], bulges = [0, 1, 0]",
    "triangle_surface": "points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], triangles = [[0, 1, 2]], open = true",
    "convex_polytope": "vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]",
}


@pytest.mark.parametrize("kind", SHAPES)
def test_every_kind_of_shape(tmp_path, kind):
    given = f'{{ kind = "{kind}", frame = {{ body = "ground", p = [0, 0, -1.0] }}, {KINDS[kind]} }}'
    other = '{ kind = "half_space", frame = "block" }' if kind == "convex_polytope" else SPHERE
    text = f'[[touch]]\nname = "it"\none = {given}\nother = {other}\nlaw = {{ kind = "power_law", k = 1e4 }}\n'
    built = build(read_scene(written(tmp_path, text.replace(",  }", " }"))))
    assert len(built.touches["it"]) == (4 if kind == "convex_polytope" else 1)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ('kind = "power_law", k = 1e5, p = 1.5, speed = "none", restitution = 0.4',
         contact.PowerLaw(k=1e5, p=1.5, speed=None, restitution=0.4)),
        ('kind = "bearing", load = 10, depth = 1e-4', contact.PowerLaw.bearing(10.0, depth=1e-4)),
        ('kind = "hertz", E = 2e11, nu = 0.25, E_other = 7e10', contact.Hertz(E=2e11, nu=0.25, E_other=7e10)),
        ('kind = "hard", restitution = 0.5, mu = 0.2', contact.Hard(restitution=0.5, mu=0.2)),
        ('kind = "hard", restitution = 0.5, impact = "Poisson"',
         contact.Hard(restitution=0.5, impact=contact.ImpactLaw.POISSON)),
    ],
)  # fmt: skip
def test_every_law(tmp_path, law, expected):
    floor = '{ kind = "half_space", frame = "ground" }'
    text = f'[[touch]]\nname = "it"\none = {floor}\nother = {SPHERE}\nlaw = {{ {law} }}\n'
    (found,) = build(read_scene(written(tmp_path, text))).touches["it"]
    assert found.law == expected
    assert {"power_law", "bearing", "hertz", "hard"} == set(LAWS)


def test_triangles_of_a_file_and_hard_contacts_by_their_integrator(tmp_path):
    plate = fm.Shape.box((1000.0, 1000.0, 100.0))
    pyvista.PolyData.from_regular_faces(plate.points, plate.triangles).save(tmp_path / "plate.stl")
    text = (
        '[[touch]]\nname = "it"\none = { kind = "triangle_surface", path = "plate.stl", scale = 1e-3, frame = '
        f'{{ body = "ground", p = [0, 0, -0.15] }} }}\nother = {SPHERE}\n'
        'law = { kind = "hard", restitution = 0.5 }\n'
    )
    scene = SCENE.replace("t_end = 0.05", 't_end = 0.05\nh = 1e-3\nintegrator = "moreau_jean"')
    read = read_scene(written(tmp_path, text + '[output]\ncontacts = ["it"]\n', scene))
    built = build(read)
    run = built.system.simulate(0.05, h=1e-3, integrator=fm.MoreauJean())
    table = tabulate(run, plan_columns(built, read.output), every=0.01)
    assert table.column("it.gap")[0] == pytest.approx(0.03, abs=1e-12)


def test_values_of_contacts_change_from_outside(tmp_path):
    path = written(tmp_path, example())
    for name in ("touch.rolls.friction.mu", "touches.rolls.friction.mu", "touch[0].friction.mu"):
        (pair,) = build(read_scene(path, changes={name: 0.4})).touches["rolls"]
        assert pair.friction.mu == 0.4


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ('kind = "half_space", frame = "ground"', 'kind = "halfspace", frame = "ground"',
         r"touch\[0\]\.one\.kind: 'halfspace' is not known; did you mean 'half_space'"),
        ('frame = "ball", radius = 0.0286 }\nlaw', 'frame = "bal", radius = 0.0286 }\nlaw',
         r"touch\[0\]\.other\.frame: there is no body 'bal'; did you mean 'ball'"),
        ("radius = 0.0286 }\nlaw", "radius = -1 }\nlaw", r"\[0\] \(rolls\): touch\[0\]\.other: radius of a Sphere"),
        (", radius = 0.0286 }\nlaw", " }\nlaw", r"touch\[0\]\.other: has no 'radius', which a sphere needs"),
        ("radius = 0.0286 }\nlaw", "radius = 1, sides = 3 }\nlaw", r"touch\[0\]\.other\.sides: is not known"),
        ('kind = "bearing", load = 1.7', 'kind = "bearing", load = "a"', r"touch\[0\]\.law\.load: must be a number"),
        ('kind = "bearing", load = 1.7', 'kind = "bearing", load = -1', r"\[0\] \(rolls\): touch\[0\]\.law: .*load"),
        ("mu = 0.2", "mu = -0.2", r"touch\[0\] \(rolls\): contact of sphere ball .*mu = -0.2"),
        ("mu = 0.2", "mue = 0.2", r"touch\[0\]\.friction\.mue: is not known; did you mean 'mu'"),
        ("mu = 0.2, ", "", r"touch\[0\]\.friction: has no 'mu', which a friction needs"),
        ('name = "bounces"', 'name = "rolls"', r"touch\[0\]\.name: 'rolls' is taken"),
        ('contacts = ["rolls"]', 'contacts = ["roll"]', r"output\.contacts: there is no \[\[touch\]\] named 'roll'"),
        ('speed = "none"', 'speed = "any"', r"touch\[1\]\.law\.speed: must be a number"),
    ],
)  # fmt: skip
def test_faults_are_named_by_their_places(tmp_path, was, becomes, told):
    assert was in example()
    with pytest.raises(SceneError, match=told):
        build(read_scene(written(tmp_path, example().replace(was, becomes, 1))))


def test_one_shape_alone_and_triangles_of_nothing_are_told(tmp_path):
    law = 'law = { kind = "power_law", k = 1e4 }\n'
    with pytest.raises(SceneError, match=r"touch\[0\]: has no 'other'"):
        read_scene(written(tmp_path, f'[[touch]]\nname = "it"\none = {SPHERE}\n{law}'))
    empty = '{ kind = "triangle_surface", frame = "ground" }'
    with pytest.raises(SceneError, match=r"touch\[0\]\.one: needs either a 'path'"):
        read_scene(written(tmp_path, f'[[touch]]\nname = "it"\none = {empty}\nother = {SPHERE}\n{law}'))
