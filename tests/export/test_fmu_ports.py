"""A machine with electrodes as an FMU: voltages in, charges out, as FMPy moves it."""

import numpy as np
import pytest
from scipy.interpolate import PPoly
from units import Unit

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Electrode, Interface
from flexmbd.errors import ExportError
from flexmbd.forms import solid_piezo
from flexmbd.reduction import craig_bampton

H, STEP = 1e-6, 2e-5


@pytest.fixture(scope="module")
def bender():
    """A bimorph with a sensing skin and an acting one on a metal core."""
    ceramic = solid_piezo.reference().parameters
    steel = solid_piezo.elastic(E=2.1e11, nu=0.3, rho=7850.0)
    layers = {"below": (solid_piezo, ceramic), "core": (solid_piezo, steel), "above": (solid_piezo, ceramic)}
    mesh = meshes.block(0.1, 0.01, 0.0012, divisions=(4, 1, 3), layers=tuple(layers))
    electrodes = [Electrode("core", grounded=True), Electrode("z_min"), Electrode("z_max")]
    model = ContinuumModel(mesh, layers, degree=2, interfaces=[Interface("x_min")], conditions=electrodes)
    return craig_bampton(model, modes=2, frame="x_min")


def machine(record):
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    body = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    return scene, body.port("z_min"), body.port("z_max")


def test_voltages_go_in_and_charges_come_out(bender, tmp_path):
    """As the machine's own, with voltages that are held from one communication point to the next."""
    scene, sense, act = machine(bender)
    act.voltage = 10.0
    how = {"h": H, "integrator": fm.GeneralizedAlpha(rho=0.9)}
    ports = {"inputs": [act], "outputs": {"sensed": sense.charge, "arm.z_max.charge": act.charge}}
    fm.export.fmu_machine(scene, tmp_path / "arm.fmu", **how, **ports)
    assert act.voltage == 10.0
    unit = Unit(tmp_path / "arm.fmu", tmp_path / "unzipped")
    names = {one.name: one for one in unit.description.modelVariables}
    assert names["arm.z_max.voltage"].causality == "input"
    assert names["sensed"].causality == "output"
    volts = 50.0 * np.sin(2 * np.pi * 900.0 * STEP * np.arange(40))
    one, found = unit.instance(), []
    for voltage in volts:
        one.set({"arm.z_max.voltage": voltage})
        one.step(STEP)
        found.append(one.get(["sensed", "arm.z_max.charge"]))
    one.free()
    act.voltage = PPoly(volts[None], STEP * np.arange(41))
    run = scene.simulate(STEP * 40, h=H, integrator=how["integrator"], rtol=1e-9)
    before = STEP * np.arange(1, 41) - 1e-12
    wanted = np.stack([run.port(one, t=before).flow for one in (sense, act)], axis=1)
    assert abs(np.array(found) - wanted).max(axis=0) == pytest.approx(0.0, abs=1e-5 * abs(wanted).max(axis=0).min())


def test_what_is_no_port_of_a_unit(bender, tmp_path):
    scene, sense, act = machine(bender)
    act.voltage = fm.Sine(1.0, 1.0)
    with pytest.raises(ExportError, match=r"voltage of port arm.z_max is an input, whose values are numbers"):
        fm.export.fmu_machine(scene, tmp_path / "arm.fmu", h=H, inputs=[act])
    with pytest.raises(ExportError, match="charges are no outputs of model exchange"):
        fm.export.fmu_machine(scene, tmp_path / "arm.fmu", h=H, outputs=[sense.charge], model_exchange=True)
    _, stranger, _ = machine(bender)
    with pytest.raises(ExportError, match=r"port arm.z_min is of no body in the scene"):
        fm.export.fmu_machine(scene, tmp_path / "arm.fmu", h=H, inputs=[stranger])
