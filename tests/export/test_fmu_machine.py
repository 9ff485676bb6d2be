"""Whole machines as FMUs: FMPy moves them as our own integrator does, and nothing in them needs Python."""

import ctypes
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from exported_bodies import soft_bar
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from scipy.interpolate import PPoly
from spring_machines import Nothing
from units import Unit, library

import flexmbd as fm
from flexmbd.errors import ExportError, SceneError
from flexmbd.export.functional_mockup import unit_build
from flexmbd.multibody.linear.working_point import WorkingPoint

EXPLICIT, IMPLICIT = fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(rho=0.9)
H = 2e-4  # s, the integrator's
SHORT = 4e-5  # s, an explicit one's with which the bar's fastest mode, of 3.3 kHz, is stable
UNITS = [(fm.export.Fmi.V2, EXPLICIT), (fm.export.Fmi.V3, EXPLICIT), (fm.export.Fmi.V3, IMPLICIT)]


def arm_step(integrator):
    return SHORT if integrator == EXPLICIT else H


class Arm:
    """A hub driven by a torque, a soft bar on it that stretches, a weight at its tip that a force pulls."""

    def __init__(self, torque=0.3, pull=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)):
        scene = self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        hub = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.03)), name="hub")
        bar = self.bar = scene.add(fm.FlexibleBody(soft_bar()), name="bar")
        weight = scene.add(fm.RigidBody(0.5, (1e-3, 2e-3, 3e-3), (0.02, 0.0, 0.01)), name="weight")
        self.shaft = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame(), name="shaft")
        scene.connect(fm.joint.Fixed(), hub.frame(p=(0.1, 0.0, 0.0)), bar.frame("x_min"))
        self.ball = scene.connect(fm.joint.Spherical(), bar.frame("x_max"), weight.frame(), name="ball")
        self.shaft.velocity = 2.0
        scene.add_force(fm.force.JointDamper(self.shaft, 0.05))
        scene.add_force(fm.force.JointTorque(self.shaft, fm.Sine(0.2, 30.0)))
        self.tip, self.grip = bar.frame("x_max"), weight.frame(p=(0.05, 0.0, 0.0))
        self.torque = fm.force.JointTorque(self.shaft, torque)
        self.pull = fm.force.FrameForce(self.grip, force=pull[:3], torque=pull[3:])

    def ports(self):
        out = fm.output
        outputs = {"tip": out.Position(self.tip), "grip": out.Velocity(self.grip), "shaft": out.Position(self.shaft)}
        outputs |= {"turn": out.Rotation(self.grip), "pull": out.Acceleration(self.grip), "q": out.Position(self.bar)}
        return {"inputs": {"torque": self.torque, "grip": self.pull}, "outputs": outputs}

    def observed(self, run):
        parts = run.position(self.tip), run.velocity(self.grip), run.beta(self.shaft)[:, None]
        turn = run.rotation(self.grip).reshape(-1, 9)
        return np.hstack([*parts, turn, run.acceleration(self.grip), run.q(self.bar)])


@pytest.fixture(scope="module", autouse=True)
def no_warnings():
    """The compiler's warnings are errors here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unit_build, "C99", (*unit_build.C99, "-Wpedantic", "-Werror"))
        yield


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Units of the arm of each version and integrator."""
    made = {}

    def make(fmi=3, integrator=EXPLICIT):
        if (fmi, integrator) not in made:
            folder, there = tmp_path_factory.mktemp(f"arm{fmi}"), Arm()
            how = {"h": arm_step(integrator), "fmi": fmi, "integrator": integrator}
            fm.export.fmu_machine(there.scene, folder / "arm.fmu", **how, **there.ports())
            made[fmi, integrator] = Unit(folder / "arm.fmu", folder / "unzipped")
        return made[fmi, integrator]

    return make


def outputs_of(unit):
    return [one.name for one in unit.description.modelVariables if one.causality == "output"]


@pytest.mark.parametrize(("fmi", "integrator"), UNITS)
def test_fmpy_finds_no_fault(arm, fmi, integrator):
    assert validate_fmu(str(Path(arm(fmi, integrator).folder).parent / "arm.fmu")) == []


@pytest.mark.parametrize(("fmi", "integrator"), UNITS)
def test_moves_as_the_machine_does(arm, fmi, integrator):
    """Inputs that stay as they start: a run of ours from beginning to end."""
    there = Arm()
    there.scene.add_force(there.torque)
    h = arm_step(integrator)
    apart = round(20 * H / h)
    run = there.scene.simulate(0.4, h=h, rtol=1e-9, integrator=integrator)
    expected = there.observed(run)
    one = arm(fmi, integrator).instance()
    found = [one.get(outputs_of(arm(fmi, integrator)))]
    for _ in range(100):
        one.step(20 * H)
        found.append(one.get(outputs_of(arm(fmi, integrator))))
    one.free()
    assert expected.shape[1] == len(found[0])
    scale = np.abs(expected).max(axis=0)
    off = np.abs(np.array(found) - expected[::apart]).max(axis=0)
    assert (off <= 1e-8 * np.maximum(scale, 1e-3 * scale.max())).all()
    assert np.ptp(expected[:, :2], axis=0).min() > 0.1  # it moves far, bends and stretches
    assert np.abs(expected[:, 2]).max() > 0.05


@pytest.mark.parametrize("integrator", [EXPLICIT, IMPLICIT])
def test_inputs_jump_between_steps_of_any_size(arm, integrator):
    """Against runs of ours from one communication point to the next, each with its own forces."""
    random = np.random.default_rng(5)
    one, names = arm(3, integrator).instance(), outputs_of(arm(3, integrator))
    h, about, t = arm_step(integrator), None, 0.0
    for k in range(12):
        torque, pull = float(random.normal()), tuple(map(float, random.normal(size=6) * [5, 5, 5, 0.05, 0.05, 0.05]))
        length = h * (10, 7.5, 33, 0.25)[k % 4]
        one.set(
            {
                "torque": torque,
                **{f"grip.{a}": v for a, v in zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), pull, strict=True)},
            }
        )
        one.step(length)
        there = Arm(torque, pull)
        there.scene.add_force(there.torque)
        there.scene.add_force(there.pull)
        steps = int(np.ceil(length / h - 1e-9))
        # one step more than is looked at, as the last one differs from the others by the rounding of the time
        end, size = t + length, length / steps
        run = there.scene.simulate(end + size, t_start=t, h=size, rtol=1e-9, integrator=integrator, about=about)
        assert run.t[steps] == pytest.approx(end, rel=1e-12)
        t, about = end, WorkingPoint(run.scene, end, run.x[steps], run.v[steps], run.multipliers[steps])
        expected, found = there.observed(run)[steps], one.get(names)
        assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max(), k
    one.free()


@pytest.mark.parametrize(("fmi", "integrator"), UNITS)
def test_states_instances_and_reset(arm, fmi, integrator):
    one, two = arm(fmi, integrator).instance("one"), arm(fmi, integrator).instance("two", torque=-1.0)
    names = outputs_of(arm(fmi, integrator))
    for _ in range(5):
        one.step(1e-3)
        two.step(1e-3)
    kept, first = one.keep(), one.get(names)
    assert not (two.get(names) == first).all()
    one.step(1e-3)
    ahead = one.get(names)
    one.restore(kept)
    one.t = 5e-3
    assert (one.get(names) == first).all()
    one.step(1e-3)
    assert (one.get(names) == ahead).all()
    one.fmu.reset()
    one.initialise()
    for _ in range(5):
        one.step(1e-3)
    assert np.abs(one.get(names) - first).max() <= 1e-12 * np.abs(first).max()
    for value in (float("nan"), float("inf")):
        with pytest.raises(Exception, match="failed"):
            one.set({"torque": value})
    with pytest.raises(Exception, match="failed"):
        one.fmu.doStep(one.t, -1e-3)
    one.free()
    two.free()
    late = arm(fmi, integrator).instance("late")
    late.fmu.reset()
    with pytest.raises(Exception, match="failed"):  # the sine begins at 0
        late.initialise(t=1.0)
    late.free()


def slider_crank(torque):
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    crank = scene.add(fm.RigidBody(0.4, (1e-4, 4e-4, 4e-4), (0.04, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(0.6, (1e-4, 2e-3, 2e-3), (0.1, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, (1e-4, 1e-4, 1e-4)), name="piston")
    shaft = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), crank.frame(), name="shaft")
    scene.connect(fm.joint.Revolute("y"), crank.frame(p=(0.08, 0.0, 0.0)), rod.frame())
    scene.connect(fm.joint.Revolute("y"), rod.frame(p=(0.2, 0.0, 0.0)), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())
    shaft.velocity = 10.0
    drive = scene.add_force(fm.force.JointTorque(shaft, torque))
    return scene, drive, shaft, piston.frame()


def test_accelerations_follow_inputs_at_once(arm):
    one = arm().instance(**{"grip.Fx": 3.0})
    for torque in (0.3, -2.0):
        one.set({"torque": torque})
        there = Arm(torque, (3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        there.scene.add_force(there.torque)
        there.scene.add_force(there.pull)
        run = there.scene.simulate(H, h=H, integrator=EXPLICIT)
        expected = run.acceleration(there.grip)[0]
        assert np.abs(one.get(["pull.ax", "pull.ay", "pull.az"]) - expected).max() <= 1e-10 * np.abs(expected).max()
    one.free()


@pytest.mark.parametrize("integrator", [EXPLICIT, IMPLICIT])
def test_closed_loops_leave_as_well(tmp_path, integrator):
    scene, drive, shaft, piston = slider_crank(0.5)
    outputs = [fm.output.Position(piston), fm.output.Velocity(piston), fm.output.Position(shaft)]
    outputs.append(fm.output.Velocity(shaft))
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / "crank.fmu"
        fm.export.fmu_machine(scene, path, h=H, inputs=[drive], outputs=outputs, integrator=integrator)
    assert (tmp_path / "a" / "crank.fmu").read_bytes() == (tmp_path / "b" / "crank.fmu").read_bytes()
    assert validate_fmu(str(tmp_path / "a" / "crank.fmu")) == []
    unit = Unit(tmp_path / "a" / "crank.fmu", tmp_path / "unzipped")
    assert list(unit.references)[1] == "shaft.torque"
    for torque in (0.5, -0.8):
        expected = crank_motion(torque, integrator)
        one = unit.instance(**{"shaft.torque": torque})
        found = []
        for _ in range(50):
            one.step(50 * H)
            found.append(one.get(outputs_of(unit)))
        one.free()
        assert np.abs(expected[:, 6]).max() > 2.0 * np.pi
        bound = 1e-8 * np.abs(expected).max()
        if integrator == IMPLICIT:
            # rounding decides when factors are renewed, and with them the directions in which loops are closed: that
            # is a small part of what the step itself leaves
            bound += 0.05 * np.abs(crank_motion(torque, integrator, halved=1) - expected).max(axis=0)
        assert (np.abs(np.array(found) - expected).max(axis=0) <= bound).all()


def crank_motion(torque, integrator, *, halved=0):
    """What the outputs of the slider-crank's unit are in a run of ours, each 50 steps; the step halved so often."""
    scene, _, shaft, piston = slider_crank(torque)
    run = scene.simulate(0.5 + H, h=H / 2**halved, rtol=1e-9, integrator=integrator)
    parts = run.position(piston), run.velocity(piston), run.beta(shaft)[:, None], run.beta_rate(shaft)[:, None]
    return np.hstack(parts)[: 2501 << halved : 50 << halved][1:]


ELSEWHERE = """
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree
from spring_machines import Nothing
from units import Unit
unit = Unit(sys.argv[1], sys.argv[1])
one = unit.instance()
one.restore(one.fmu.deserializeFMUState(Path(sys.argv[2]).read_bytes()))
one.t = 2e-3
one.step(1e-3)
print(repr(float(one.get(["tip.x"])[0])))
"""


def test_states_go_on_in_another_process(arm, tmp_path):
    """Whose addresses are others: of the kernels behind addresses as well."""
    unit = arm(3, IMPLICIT)
    one = unit.instance(torque=2.0)
    one.step(1e-3)
    one.step(1e-3)
    (tmp_path / "state").write_bytes(one.fmu.serializeFMUState(one.keep()))
    one.step(1e-3)
    command = [sys.executable, "-c", ELSEWHERE, unit.folder, tmp_path / "state"]
    done = subprocess.run(command, cwd=Path(__file__).parents[1] / "helpers", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) == one.get(["tip.x"])[0]
    one.free()


HOST = r"""
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdbool.h>
typedef void *(*Make)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
                      void *, void *, void *);
typedef int (*Enter)(void *, bool, double, double, bool, double);
typedef int (*Plain)(void *);
typedef int (*Step)(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int (*Get)(void *, const uint32_t *, size_t, double *, size_t);
int main(int argc, char **argv) {
    void *unit = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (argc < 4 || !unit) return 1;
    void *one = ((Make)dlsym(unit, "fmi3InstantiateCoSimulation"))("one", argv[2], "", 0, 0, 0, 0, 0, 0, 0, 0, 0);
    if (!one) return 2;
    if (((Enter)dlsym(unit, "fmi3EnterInitializationMode"))(one, 0, 0, 0, 0, 0)) return 3;
    if (((Plain)dlsym(unit, "fmi3ExitInitializationMode"))(one)) return 4;
    double reached, value;
    for (int k = 0; k < 10; k++) {
        bool event, ends, early;
        if (((Step)dlsym(unit, "fmi3DoStep"))(one, k * 1e-3, 1e-3, 1, &event, &ends, &early, &reached)) return 5;
    }
    uint32_t reference;
    sscanf(argv[3], "%u", &reference);
    if (((Get)dlsym(unit, "fmi3GetFloat64"))(one, &reference, 1, &value, 1)) return 6;
    printf("%.17g\n", value);
    return 0;
}
"""


def test_host_needs_no_python(arm, tmp_path):
    """A host in C, in a process with an empty environment; the library asks for C's own libraries alone."""
    unit = arm(3, IMPLICIT)
    (binary,) = Path(unit.folder, "binaries").glob("*/*.so")
    (tmp_path / "host.c").write_text(HOST)
    subprocess.run(["gcc", tmp_path / "host.c", "-o", tmp_path / "host", "-ldl"], check=True)
    reference = unit.references["tip.x"]
    command = [tmp_path / "host", binary, unit.description.guid, str(reference)]
    done = subprocess.run(command, env={}, capture_output=True, text=True)
    assert done.returncode == 0, (done.returncode, done.stderr)
    one = unit.instance()
    for k in range(10):
        one.fmu.doStep(k * 1e-3, 1e-3)
    assert float(done.stdout) == one.get(["tip.x"])[0]
    one.free()
    if shutil.which("objdump") is None:
        pytest.skip("objdump (binutils) is not installed")
    told = subprocess.run(["objdump", "-p", binary], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"NEEDED\s+(\S+)", told)) <= {"libm.so.6", "libc.so.6"}
    code = subprocess.run(["objdump", "-d", binary], capture_output=True, text=True, check=True).stdout
    assert not re.search(r"%[yz]mm\d", code)  # no instructions of newer processors
    exported = subprocess.run(["objdump", "-T", binary], capture_output=True, text=True, check=True).stdout
    own = [line.split()[-1] for line in exported.splitlines() if " .text" in line]
    assert len(own) > 50
    assert all(name.startswith("fmi3") for name in own)


@pytest.mark.parametrize(("fmi", "integrator"), UNITS)
def test_null_pointers_are_errors(arm, fmi, integrator):
    loaded, null = library(arm(fmi, integrator)), ctypes.c_void_p()
    assert loaded[f"fmi{fmi}Terminate"](null) == 3
    loaded[f"fmi{fmi}FreeInstance"](null)


def test_what_cannot_leave_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "arm.fmu"
    path.write_text("before")
    there = Arm()
    torque, position = fm.force.JointTorque, fm.output.Position

    def refused(words, error=ExportError, scene=there.scene, h=SHORT, **options):
        with pytest.raises(error, match=words):
            fm.export.fmu_machine(scene, path, h=h, **options)

    refused("h is", h=0.0)
    refused("step", step=float("inf"))
    refused("versions 2 and 3", fmi=1)
    refused("not with RadauIIA", integrator=fm.RadauIIA())
    refused("not an input of a machine", inputs=[fm.force.JointSpring(there.shaft, 1.0)])
    refused("not an input of a machine", inputs=[there.shaft])
    refused("numbers at the start", inputs=[torque(there.shaft, fm.Sine(1.0, 2.0))])
    refused("numbers at the start", inputs=[torque(there.shaft, float("nan"))])
    refused("not an output", outputs=[there.tip])
    refused("no coordinates here", outputs=[fm.output.Rotation(there.shaft)])
    refused("no coordinates here", outputs=[position(Arm().shaft)])
    refused("a quaternion", outputs=[position(there.ball)])
    refused("called 'tip.x'", outputs={"tip": position(there.tip), "tip.x": position(there.shaft)})
    refused("control characters", outputs={"a\nb": position(there.shaft)})
    refused("not in this scene", SceneError, inputs=[torque(Arm().shaft, 1.0)])
    refused("belongs to no body", SceneError, outputs=[position(Arm().tip)])
    for function in (lambda t: 0.0, fm.compiled(lambda t: 0.0)):
        other = Arm()
        other.scene.add_force(torque(other.shaft, function))
        refused("users' functions .*shaft", scene=other.scene)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused("apt install gcc")
    assert path.read_text() == "before"


def test_bodies_with_history_stay(tmp_path):
    scene = fm.System()
    lattice = scene.add(fm.ContinuumBody(Nothing()), name="lattice")
    scene.connect(fm.joint.Free(), scene.ground.frame(), lattice.frame("alone"))
    with pytest.raises(ExportError, match="lattice"):
        fm.export.fmu_machine(scene, tmp_path / "lattice.fmu", h=1e-3)


class Slider:
    """A mass on a spring, pushed by a force given as data, that carries a pendulum."""

    def __init__(self, push):
        scene = self.scene = fm.System(gravity=(0.0, -9.81, 0.0))
        slider = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.01)), name="slider")
        bob = scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3), (0.0, -0.2, 0.0)), name="bob")
        self.rail = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="rail")
        self.pin = scene.connect(fm.joint.Revolute("z"), slider.frame(), bob.frame(), name="pin")
        scene.add_force(fm.force.JointSpring(self.rail, 200.0))
        scene.add_force(fm.force.JointForce(self.rail, push))


#: A load that jumps within steps and at a communication point, and a pulse of a hundredth of a step.
STEPS_UP = PPoly(np.array([[0.0, 30.0, -20.0, 5.0]]), [-1.0, 0.0137, 0.1, 0.15512, 1.0])
PULSE = PPoly(np.array([[0.0, 4e6, 0.0]]), [-1.0, 0.03333, 0.0333301, 1.0])


@pytest.mark.parametrize("integrator", [EXPLICIT, IMPLICIT])
@pytest.mark.parametrize("push", [STEPS_UP, PULSE], ids=["steps", "pulse"])
def test_steps_end_at_breaks_of_data(tmp_path, integrator, push):
    """As in a run of ours to round-off, at steps much longer than the pulse."""
    there, h = Slider(push), 1e-3
    outputs = {"rail": fm.output.Position(there.rail), "pin": fm.output.Position(there.pin)}
    fm.export.fmu_machine(there.scene, tmp_path / "slider.fmu", h=h, integrator=integrator, outputs=outputs)
    run = there.scene.simulate(0.2, h=h, rtol=1e-9, integrator=integrator)
    unit = Unit(tmp_path / "slider.fmu", tmp_path / "unzipped")
    one = unit.instance()
    found = [one.get(outputs_of(unit))]
    for _ in range(20):
        one.step(10 * h)
        found.append(one.get(outputs_of(unit)))
    one.free()
    at = np.searchsorted(run.t, 10 * h * np.arange(21) - 1e-9)
    expected = np.column_stack([run.beta(there.rail), run.beta(there.pin)])[at]
    assert np.ptp(expected, axis=0).min() > 1e-3
    assert np.abs(np.array(found) - expected).max() <= 1e-9 * np.abs(expected).max()


def test_a_rate_that_jumps_stops_the_unit(tmp_path):
    """No impulse is known there; up to then it moves."""
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.1, 0.0, 0.0)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame(), name="hinge")
    hinge.prescribe(PPoly(np.array([[1.0, -1.0], [0.0, 0.05]]), [0.0, 0.05, 1.0]))
    fm.export.fmu_machine(scene, tmp_path / "arm.fmu", h=1e-2, outputs=[fm.output.Position(hinge)])
    unit = Unit(tmp_path / "arm.fmu", tmp_path / "unzipped")
    one = unit.instance()
    one.step(0.05)
    assert one.get(outputs_of(unit)) == pytest.approx([0.05])
    with pytest.raises(FMICallException, match="fmi3DoStep failed"):
        one.step(0.01)
    one.free()


def test_outputs_are_called_as_the_user_calls_them(tmp_path):
    """Position, velocity and acceleration of one joint by names of three; without names by theirs."""
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame(), name="hinge")
    asked = [kind(hinge) for kind in (fm.output.Position, fm.output.Velocity, fm.output.Acceleration)]

    def names(outputs):
        fm.export.fmu_machine(scene, tmp_path / "wheel.fmu", h=1e-2, outputs=outputs, binary=False)
        with zipfile.ZipFile(tmp_path / "wheel.fmu") as unit:
            root = ET.fromstring(unit.read("modelDescription.xml"))
        return [one.get("name") for one in root.iter() if one.get("causality") == "output"]

    assert names(dict(zip(["angle", "speed", "gain"], asked, strict=True))) == ["angle", "speed", "gain"]
    assert names(asked) == ["hinge.angle", "hinge.angle.rate", "hinge.angle.acceleration"]
