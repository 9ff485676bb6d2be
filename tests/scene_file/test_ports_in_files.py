"""Electrodes in scene files: voltages of bodies, circuits and columns; the same numbers as in Python."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Electrode, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_piezo
from flexmbd.reduction import craig_bampton
from flexmbd.scene_file import build, plan_columns, read_scene, tabulate

SCENE = """\
[[body]]
name = "arm"
record = "arm.h5"
voltages = { z_max = { amplitude = 20.0, omega = 6000.0 } }

[[joint]]
name = "wall"
kind = "fixed"
child = "arm:x_min"

[[force]]
kind = "shunt"
port = "arm:z_min"
resistance = 2e4

[simulate]
t_end = 0.001
rtol = 1e-6

[output]
ports = ["arm:z_max", "arm:z_min"]
"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The file of a bimorph on a metal core."""
    ceramic = solid_piezo.reference().parameters
    steel = solid_piezo.elastic(E=2.1e11, nu=0.3, rho=7850.0)
    layers = {"below": (solid_piezo, ceramic), "core": (solid_piezo, steel), "above": (solid_piezo, ceramic)}
    mesh = meshes.block(0.1, 0.01, 0.0012, divisions=(4, 1, 3), layers=tuple(layers))
    electrodes = [Electrode("core", grounded=True), Electrode("z_min"), Electrode("z_max")]
    model = ContinuumModel(mesh, layers, degree=2, interfaces=[Interface("x_min")], conditions=electrodes)
    path = tmp_path_factory.mktemp("ports") / "arm.h5"
    craig_bampton(model, modes=2, frame="x_min").save(path)
    return path


def read(arm, text):
    (arm.parent / "scene.toml").write_text(text)
    return read_scene(arm.parent / "scene.toml")


def columns_of(arm, text):
    file = read(arm, text)
    return plan_columns(build(file), file.output)


def test_voltages_circuits_and_columns(arm):
    file = read(arm, SCENE)
    built = build(file)
    columns = plan_columns(built, file.output)
    table = tabulate(built.system.simulate(0.001, rtol=1e-6), columns, every=None)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(fm.ReducedBody.load(arm)), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"), name="wall")
    act, sense = body.port("z_max"), body.port("z_min")
    act.voltage = fm.Sine(20.0, 6000.0)
    scene.add_force(fm.force.shunt(sense, resistance=2e4))
    run = scene.simulate(0.001, rtol=1e-6)
    for port, name in ((act, "arm.z_max"), (sense, "arm.z_min")):
        series = run.port(port)
        np.testing.assert_array_equal(table.column(f"{name}.voltage"), series.effort)
        np.testing.assert_array_equal(table.column(f"{name}.charge"), series.flow)
    assert abs(run.port(sense).effort).max() > 0.1


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("z_max = {", "side = {", r"body 'arm' has no port 'side'"),
        ('"arm:z_min"\nresistance', '"arm"\nresistance', r'must be a port of a flexible body, as "arm:z_max"'),
        ('["arm:z_max"', '["leg:z_max"', r"there is no flexible body 'leg'"),
        ("z_max = { amplitude", "z_min = { amplitude", r"its voltage is given already"),
    ],
)
def test_what_is_no_port(arm, old, new, told):
    assert old in SCENE
    with pytest.raises(SceneError, match=told):
        columns_of(arm, SCENE.replace(old, new))
