"""Shapes in scene files: those of Python, by the same names, and one clear line for whatever is wrong in one."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.scene_file import build, read_scene

TEXT = """\
[ground]
shape = { kind = "floor", size = [2, 1], normal = "y", at = [0, -0.5, 0] }

[[body]]
name = "arm"
density = 7850
shape = [
    { kind = "rod", start = [0, 0, 0], end = [1, 0, 0], radius = 0.02, colour = "#336699" },
    { kind = "sphere", radius = 0.05, at = [1, 0, 0] },
]

[[body]]
name = "block"
mass = 2
inertia = [1, 1, 1]
shape = { kind = "file", path = "block.stl", scale = 1e-3 }

[[joint]]
name = "hinge"
kind = "revolute"
axis = "z"
child = "arm"

[[joint]]
name = "pin"
kind = "revolute"
axis = "z"
parent = "arm"
child = "block"

[simulate]
t_end = 0.1
"""


@pytest.fixture
def scene(tmp_path):
    """Writes a text as a scene file beside which there is an STL file, and builds its machine."""
    pyvista = pytest.importorskip("pyvista")
    pyvista.Box(bounds=(0.0, 100.0, 0.0, 40.0, 0.0, 20.0)).triangulate().save(tmp_path / "block.stl")

    def read(text):
        (tmp_path / "a.toml").write_text(text)
        return build(read_scene(tmp_path / "a.toml"))

    return read


def test_shapes_are_those_of_python(scene):
    built = scene(TEXT)
    arm, block = built.bodies["arm"], built.bodies["block"]
    rod = fm.Shape.rod((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.02, colour="#336699")
    expected = rod + fm.Shape.sphere(0.05, at=(1.0, 0.0, 0.0))
    np.testing.assert_array_equal(arm.shape.points, expected.points)
    assert [part.colour for part in arm.shape.pieces()] == ["#336699", None]
    assert arm.mass == expected.solid(density=7850.0).mass
    assert block.mass == 2.0
    np.testing.assert_allclose(block.shape.points.max(axis=0), [0.1, 0.04, 0.02], atol=1e-8)
    floor = built.system.ground.shape.points
    np.testing.assert_allclose(floor.min(axis=0)[1], -0.5)
    np.testing.assert_allclose(np.ptp(floor[:, [0, 2]], axis=0).prod(), 2.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "rod"', 'kind = "rodd"', r"body\[0\]\.shape\[0\]\.kind: 'rodd' is not known; did you mean 'rod'"),
        ("radius = 0.02", "radios = 0.02", r"body\[0\]\.shape\[0\]\.radios: is not known; did you mean 'radius'"),
        ("radius = 0.02,", "", r"body\[0\]\.shape\[0\]: has no 'radius', which a rod needs"),
        ("radius = 0.05", "radius = -0.05", r"body\[0\] \(arm\).*radius of a sphere must be positive"),
        ("at = [1, 0, 0]", "at = [1, 0]", r"body\[0\] \(arm\).*place of a shape"),
        ("block.stl", "blok.stl", r"body\[1\] \(block\).*there is no such file"),
        ("density = 7850", "density = 0", r"body\[0\] \(arm\).*density must be positive"),
        ("density = 7850", "mass = 1", r"body\[0\]: has no 'inertia'"),
        ("mass = 2", "density = 3", r"body\[1\]\.inertia: is not known"),
        ('{ kind = "floor", size = [2, 1], normal = "y", at = [0, -0.5, 0] }', "3", r"ground\.shape: must be a t"),
        ("[ground]", "[ground]\nname = 'g'", r"ground\.name: is not known"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_by_its_place(scene, old, new, message):
    assert old in TEXT
    with pytest.raises(SceneError, match=message):
        scene(TEXT.replace(old, new))


def test_a_shape_that_is_not_closed_has_no_mass(scene):
    text = TEXT.replace('kind = "sphere", radius = 0.05', 'kind = "floor", size = [1, 1]')
    with pytest.raises(SceneError, match=r"body\[0\] \(arm\): the surface is open"):
        scene(text)
