"""Machines as sources: what a C compiler makes of them moves as the binary does, and as our own integrator."""

import re
import shutil
import subprocess
import zipfile
from hashlib import sha256
from pathlib import Path

import fmpy
import numpy as np
import pytest
from exported_bodies import soft_bar
from fmpy.validation import validate_fmu
from scipy.interpolate import PPoly
from units import Unit

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup import machine_build

OUT = fm.output
EXPLICIT, IMPLICIT = fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(rho=0.9)
H = 4e-5  # s, with which the bar's fastest mode is stable in explicit steps
#: How near two runs are that differ by rounding alone; Newton's method ends at 1e-9.
NEAR = {EXPLICIT: 1e-9, IMPLICIT: 1e-7}
#: What is compiled without a warning, but for the speed of the compiler without optimisation.
COMPILE = ["gcc", "-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]


class Crank:
    """A crank, a flexible rod and a piston on a rail: a closed loop, with a spring, a stop and a load given as data."""

    def __init__(self, torque=0.5):
        scene = self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        crank = scene.add(fm.RigidBody(2.0, (1e-2, 4e-2, 4e-2), (0.1, 0.0, 0.0)), name="crank")
        rod = self.rod = scene.add(fm.FlexibleBody(soft_bar()), name="rod")
        piston = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="piston")
        self.shaft = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), crank.frame(), name="shaft")
        scene.connect(fm.joint.Revolute("y"), crank.frame(p=(0.2, 0.0, 0.0)), rod.frame("x_min"))
        scene.connect(fm.joint.Revolute("y"), rod.frame("x_max"), piston.frame())
        rail = scene.connect(
            fm.joint.Prismatic("x"), scene.ground.frame(p=(1.2, 0.0, 0.0)), piston.frame(), name="rail"
        )
        self.shaft.velocity = 4.0
        scene.add_force(fm.force.JointDamper(self.shaft, 0.05))
        scene.add_force(fm.force.JointStop(self.shaft, -1.0, 0.15, stiffness=500.0, damping=0.1))
        scene.add_force(
            fm.force.JointTorque(self.shaft, PPoly(np.array([[0.0, 3.0, -2.0]]), [-1.0, 0.0137, 0.05, 1.0]))
        )
        scene.add_force(fm.force.JointSpring(rail, 30.0))
        self.torque = fm.force.JointTorque(self.shaft, torque)
        self.tip = piston.frame()

    def ports(self):
        outputs = {"tip": OUT.Position(self.tip), "v": OUT.Velocity(self.tip), "q": OUT.Position(self.rod)}
        outputs |= {"shaft": OUT.Position(self.shaft), "a": OUT.Acceleration(self.shaft)}
        return {"inputs": {"torque": self.torque}, "outputs": outputs}

    def observed(self, run):
        parts = run.position(self.tip), run.velocity(self.tip), run.q(self.rod), run.beta(self.shaft)[:, None]
        return np.hstack(parts)


class Cart:
    """A cart on a spring that carries a hub with a flexible bar, for model exchange."""

    def __init__(self, torque=0.4):
        scene = self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        cart = scene.add(fm.RigidBody(3.0, (0.1, 0.1, 0.1)), name="cart")
        hub = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.03)), name="hub")
        self.bar = scene.add(fm.FlexibleBody(soft_bar()), name="bar")
        self.rail = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="rail")
        self.shaft = scene.connect(fm.joint.Revolute("y"), cart.frame(), hub.frame(), name="shaft")
        scene.connect(fm.joint.Fixed(), hub.frame(p=(0.1, 0.0, 0.0)), self.bar.frame("x_min"))
        scene.add_force(fm.force.JointSpring(self.rail, 300.0))
        scene.add_force(fm.force.JointTorque(self.shaft, fm.Sine(0.5, 9.0)))
        self.shaft.velocity = 1.5
        self.torque, self.tip = fm.force.JointTorque(self.shaft, torque), self.bar.frame("x_max")

    def ports(self):
        outputs = {"tip": OUT.Position(self.tip), "v": OUT.Velocity(self.tip), "q": OUT.Position(self.bar)}
        outputs |= {"shaft": OUT.Position(self.shaft), "a": OUT.Acceleration(self.shaft)}
        return {"inputs": {"torque": self.torque}, "outputs": outputs}

    def observed(self, run):
        parts = run.position(self.tip), run.velocity(self.tip), run.q(self.bar), run.beta(self.shaft)[:, None]
        return np.hstack(parts)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The unit whose library is made of another one's sources alone, as FMPy lists them; each file is compiled once."""
    objects = tmp_path_factory.mktemp("objects")

    def build(path):
        folder = path.parent / f"{path.stem}_compiled"
        fmpy.extract(str(path), str(folder))
        shutil.rmtree(folder / "binaries", ignore_errors=True)
        description = fmpy.read_model_description(str(folder))
        (files,) = description.buildConfigurations[0].sourceFileSets
        headers = b"".join(one.read_bytes() for one in sorted(folder.glob("sources/*.h")))
        linked = []
        for name in files.sourceFiles:
            text = (folder / "sources" / name).read_bytes()
            linked.append(objects / f"{sha256(headers + text).hexdigest()}.o")
            if not linked[-1].exists():
                subprocess.run([*COMPILE, "-c", name, "-o", linked[-1]], cwd=folder / "sources", check=True)
        place = folder / "binaries" / ("linux64" if description.fmiVersion[0] == "2" else "x86_64-linux")
        place.mkdir(parents=True)
        library = place / f"{description.coSimulation.modelIdentifier}.so"
        subprocess.run(["gcc", "-shared", *linked, "-o", library, "-lm"], check=True)
        return Unit(folder, folder)

    return build


def outputs_of(unit):
    return [one.name for one in unit.description.modelVariables if one.causality == "output"]


def pendulum():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), (0.2, 0.0, 0.0)), name="bob")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame(), name="hinge")
    return scene


def moved(unit, torque, times, every):
    one, found = unit.instance(torque=torque), []
    for _ in range(times):
        one.step(every)
        found.append(one.get(outputs_of(unit)))
    one.free()
    return np.array(found)


def near(a, b, bound):
    """Columns alike, to a share of their size or of a thousandth of the largest one's."""
    scale = np.abs(b).max(axis=0)
    off = np.abs(a - b).max(axis=0) / np.maximum(scale, 1e-3 * scale.max())
    assert off.max() <= bound, off.max()


@pytest.mark.parametrize(("integrator", "h"), [(EXPLICIT, H), (IMPLICIT, 5 * H)])
def test_sources_move_as_the_binary_does(tmp_path, compiled, integrator, h):
    """A loop, a spring, a stop and data by both integrators: the binary's motion, and that of a run of ours."""
    there, path = Crank(), tmp_path / "crank.fmu"
    fm.export.fmu_machine(there.scene, path, h=h, integrator=integrator, sources=True, **there.ports())
    assert validate_fmu(str(path)) == []
    torque, times, every = 0.7, 10, 50 * H
    found = moved(compiled(path), torque, times, every)
    near(found, moved(Unit(path, tmp_path / "unzipped"), torque, times, every), NEAR[integrator])
    there = Crank(torque)
    there.scene.add_force(there.torque)
    run = there.scene.simulate(times * every + h, h=h, rtol=1e-9, integrator=integrator)
    at = np.searchsorted(run.t, every * np.arange(1, times + 1) - 1e-9)
    expected = there.observed(run)[at]
    near(found[:, : expected.shape[1]], expected, NEAR[integrator])
    assert np.ptp(expected[:, -1]) > 0.05


def test_sources_of_model_exchange_derive_as_the_binary_does(tmp_path, compiled):
    """Derivatives, directional derivatives, and steps in co-simulation of the one unit, of FMI 2."""
    there, path = Cart(), tmp_path / "cart.fmu"
    fm.export.fmu_machine(there.scene, path, h=H, fmi=2, sources=True, model_exchange=True, **there.ports())
    results, motions = [], []
    for unit in (Unit(path, tmp_path / "unzipped"), compiled(path)):
        one = unit.instance(exchange=True, torque=0.7)
        states = [v.derivative.name for v in unit.description.modelVariables if v.derivative is not None]
        one.set_states(one.get(states) + 1e-2 * np.random.default_rng(2).normal(size=len(states)))
        one.fmu.setTime(0.05)
        unknowns, knowns = [*(f"der({name})" for name in states), *outputs_of(unit)], ["torque", *states]
        values = one.get(unknowns)
        changes = one.direction(unknowns, knowns, np.random.default_rng(3).normal(size=len(knowns)))
        results.append(np.r_[values, changes][None])
        motions.append(moved(unit, 0.7, 5, 50 * H))
        one.free()
    near(results[1], results[0], 1e-9)
    near(motions[1], motions[0], 1e-11)
    there = Cart(0.7)
    there.scene.add_force(there.torque)
    expected = there.observed(there.scene.simulate(250 * H, h=H, integrator=EXPLICIT))[50::50]
    near(motions[1][:, : expected.shape[1]], expected, 1e-9)


def test_a_unit_of_sources_alone(tmp_path):
    """It needs no compiler, holds the same sources as one with a binary, and writes the same bytes each time."""
    scene = pendulum()
    fm.export.fmu_machine(scene, tmp_path / "a.fmu", h=1e-3, sources=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(tmp_path))
        (tmp_path / "again").mkdir()
        for path in (tmp_path / "b.fmu", tmp_path / "again" / "b.fmu"):
            fm.export.fmu_machine(scene, path, h=1e-3, binary=False)
    assert (tmp_path / "b.fmu").read_bytes() == (tmp_path / "again" / "b.fmu").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.fmu") as a, zipfile.ZipFile(tmp_path / "b.fmu") as b:
        sources = {name for name in a.namelist() if name.startswith("sources/")} - {"sources/buildDescription.xml"}
        assert not any(name.startswith("binaries/") for name in b.namelist())
        assert all(a.read(name) == b.read(name) for name in sources)
        assert len([name for name in sources if "/kernel_" in name]) > 10
        assert not re.search(rb"__asm__|incbin", b"".join(b.read(name) for name in sources))


def test_a_processor_that_sources_do_not_suit_is_told_by_its_compiler(tmp_path):
    """Machines' memory is written with the lowest byte first; the compiler here believes that the highest is."""
    fm.export.fmu_machine(pendulum(), tmp_path / "a.fmu", h=1e-3, binary=False)
    fmpy.extract(str(tmp_path / "a.fmu"), str(tmp_path / "a"))
    kernel = min((tmp_path / "a" / "sources").glob("kernel_*.c"), key=lambda path: path.stat().st_size)
    for options, compiles in ((), True), (("-U__BYTE_ORDER__", "-D__BYTE_ORDER__=__ORDER_BIG_ENDIAN__"), False):
        done = subprocess.run(["gcc", "-fsyntax-only", *options, kernel], capture_output=True, text=True, check=False)
        assert (done.returncode == 0) is compiles
        assert ("lowest byte first" in done.stderr) is not compiles


def test_a_kernel_that_has_no_c_is_named(tmp_path, monkeypatch):
    """Before anything is written."""
    scene, path = pendulum(), tmp_path / "pendulum.fmu"
    machine_build._source.cache_clear()
    monkeypatch.setattr(machine_build, "CALLED", ("numba_attempt_nocopy_reshape",))
    with pytest.raises(ExportError, match="flexmbd_bind_deferred"):
        fm.export.fmu_machine(scene, path, h=1e-3, binary=False)
    for word in ("sources", "binary"):
        with pytest.raises(ExportError, match=word):
            fm.export.fmu_machine(scene, path, h=1e-3, **{word: "yes"})
    assert not list(Path(tmp_path).iterdir())
