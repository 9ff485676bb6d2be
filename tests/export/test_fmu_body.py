"""Reduced bodies as FMUs: FMPy finds no fault, and moves them as the matrices and our machine do."""

import ctypes
import hashlib
import shutil
import subprocess
import zipfile
from dataclasses import replace
from importlib import resources
from pathlib import Path

import fmpy
import numpy as np
import pytest
import scipy.linalg
from exported_bodies import damped_rod, soft_bar
from fmpy.build import create_cmake_settings
from fmpy.validation import validate_fmu
from units import Instance, Unit, library

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup import unit_build

WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
PLACES = ("x", "y", "z", "rx", "ry", "rz")
RATES = ("vx", "vy", "vz", "wx", "wy", "wz")
VERSIONS = (fm.export.Fmi.V2, fm.export.Fmi.V3)


def coupled_rod():
    """The rod with damping that couples its modes, one of them beyond its critical damping."""
    rod = damped_rod()
    random = np.random.default_rng(3).normal(size=(rod.n_modes, rod.n_modes))
    w = np.sqrt(rod.stiffness)
    return replace(rod, damping=0.2 * w[0] * random @ random.T + np.diag(np.r_[3.0 * w[0], 0.1 * w[1:]]))


BODIES = {"bar": soft_bar, "rod": damped_rod, "coupled": coupled_rod}


@pytest.fixture(scope="module", autouse=True)
def no_warnings():
    """The compiler's warnings are errors here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unit_build, "C99", (*unit_build.C99, "-Wpedantic", "-Werror"))
        yield


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """Units of the bodies, compiled once."""
    made = {}

    def make(name, fmi=3):
        if (name, fmi) not in made:
            folder = tmp_path_factory.mktemp(f"{name}{fmi}")
            fm.export.fmu(BODIES[name](), folder / f"{name}.fmu", fmi=fmi)
            made[name, fmi] = Unit(folder / f"{name}.fmu", folder / "unzipped")
        return made[name, fmi]

    return make


def other(body):
    """The interface that is not held."""
    (frame,) = (frame for frame in body.interfaces if frame.name != body.frame)
    return frame


class Reference:
    """The body's equations in SciPy: exact over a step for inputs that are held; x = (w q, q'), or digits are lost."""

    def __init__(self, body, ratio=0.0):
        n = body.n_modes
        self.body, self.x = body, np.zeros(2 * n)
        self.mass = body.mass_matrix()
        self.damping = body.damping + np.diag(2.0 * ratio * np.sqrt(body.stiffness))
        self.w = np.sqrt(body.stiffness)
        self.A = np.block([[np.zeros((n, n)), np.diag(self.w)], [-np.diag(self.w), -self.damping]])

    def forces(self, wrench, gravity):
        return other(self.body).modes.T @ wrench + self.mass[6:, :3] @ gravity

    def step(self, h, wrench, gravity):
        n = self.body.n_modes
        resting = np.r_[self.forces(wrench, gravity) / self.w, np.zeros(n)]
        if np.any(self.damping - np.diag(np.diag(self.damping))):
            self.x = resting + scipy.linalg.expm(self.A * h) @ (self.x - resting)
            return
        # in closed form, as SciPy's exponential loses three digits beside modes this fast
        decay, (q, v) = 0.5 * np.diag(self.damping), (self.x - resting).reshape(2, n)
        turn = np.sqrt(self.w**2 - decay**2)
        cosine, sine = np.exp(-decay * h) * np.cos(turn * h), np.exp(-decay * h) * np.sin(turn * h) / turn
        moved = (cosine + decay * sine) * q + self.w * sine * v, (cosine - decay * sine) * v - self.w * sine * q
        self.x = resting + np.concatenate(moved)

    def outputs(self, wrench, gravity):
        n = self.body.n_modes
        frame = other(self.body)
        force, moment = wrench[:3], wrench[3:] + np.cross(frame.p_BI_B, wrench[:3])
        weight = self.body.mass * gravity
        acting = np.r_[force + weight, moment + np.cross(self.body.com, weight)]
        acceleration = (self.A @ self.x)[n:] + self.forces(wrench, gravity)
        reaction = self.mass[:6, 6:] @ acceleration - acting
        return frame.modes @ (self.x[:n] / self.w), frame.modes @ self.x[n:], reaction


def names(body):
    frame = other(body).name
    return (
        [f"{frame}.{p}" for p in PLACES],
        [f"{frame}.{p}" for p in RATES],
        [f"{body.frame}.reaction_{p}" for p in WRENCH],
    )


def near(found, expected, tol):
    found, expected = np.array(found), np.array(expected)
    assert np.abs(expected).max() > 0.0
    assert np.abs(found - expected).max() <= tol * np.abs(expected).max()


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("name", BODIES)
def test_fmpy_finds_no_fault(unit, name, fmi, tmp_path):
    folder = Path(unit(name, fmi).folder).parent
    assert validate_fmu(str(folder / f"{name}.fmu")) == []


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("name", BODIES)
def test_follows_the_matrices_with_any_steps(unit, name, fmi):
    body = BODIES[name]()
    reference, frame = Reference(body), other(body).name
    one = unit(name, fmi).instance()
    random = np.random.default_rng(1)
    period = 2.0 * np.pi / np.sqrt(body.stiffness[0])
    steps = [period * (0.05, 0.3, 1e-5, 2.0)[k % 4] * (1.0 if k % 3 else 0.7) for k in range(30)]
    # the angle that the fastest mode turns through in a step is rounded, as the processor's sine and products do it
    tol = max(1e-12, np.finfo(float).eps * np.sqrt(body.stiffness.max()) * max(steps))
    found, expected = [], []
    for h in steps:
        wrench, gravity = random.normal(size=6), 5.0 * random.normal(size=3)
        one.set({f"{frame}.{p}": v for p, v in zip(WRENCH, wrench, strict=True)})
        one.set({f"gravity.g{a}": v for a, v in zip("xyz", gravity, strict=True)})
        one.step(h)
        reference.step(h, wrench, gravity)
        found.append([one.get(group) for group in names(body)])
        expected.append(reference.outputs(wrench, gravity))
    for k in range(3):
        for part in (slice(0, 3), slice(3, 6)):
            near([row[k][part] for row in found], [row[k][part] for row in expected], tol)
    one.free()


def test_fmpy_simulates_with_inputs_over_time(unit):
    rod = damped_rod()
    reference, frame = Reference(rod), other(rod).name
    h, steps = 2e-4, 40
    t = h * np.arange(steps + 1)
    signal = np.zeros(steps + 1, dtype=[("time", float), (f"{frame}.Fy", float)])
    signal["time"], signal[f"{frame}.Fy"] = t, 100.0 * np.sin(4000.0 * t)
    folder = Path(unit("rod").folder).parent
    result = fmpy.simulate_fmu(
        str(folder / "rod.fmu"), stop_time=t[-1], step_size=h, output_interval=h, input=signal,
        output=[f"{frame}.y", f"{frame}.rz"], start_values={"damping_ratio": 0.05},
    )  # fmt: skip
    reference = Reference(rod, ratio=0.05)
    expected = [np.zeros(2)]
    for k in range(steps):
        reference.step(h, np.array([0.0, signal[f"{frame}.Fy"][k], 0.0, 0.0, 0.0, 0.0]), np.zeros(3))
        place = reference.outputs(np.zeros(6), np.zeros(3))[0]
        expected.append(place[[1, 5]])
    found = np.array([result[f"{frame}.y"], result[f"{frame}.rz"]]).T
    for column in range(2):
        near(found[:, column], np.array(expected)[:, column], 1e-12)


def test_is_the_machines_body_held_by_its_frame(unit):
    """Without stretching our machine's body is linear as well, once its frame is held."""
    bar = replace(soft_bar(), stretch=None, geometric=None)
    h, steps = 0.01, 20
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    part = scene.add(fm.FlexibleBody(bar), name="bar")
    clamp = scene.connect(fm.joint.Fixed(), scene.ground.frame(), part.frame("x_min"))
    run = scene.simulate(h * steps, h=h / 300, integrator=fm.ExplicitRungeKutta())
    one = unit("bar").instance(**{"gravity.gz": -9.81})
    found = []
    for _ in range(steps):
        one.step(h)
        found.append(one.get(["x_max.z", "x_min.reaction_Fz", "x_min.reaction_My"]))
    one.free()
    wrench = run.reaction(clamp)  # on the body, about its interface, along the axes of B
    series = np.array([run.position(part.frame("x_max"))[:, 2], wrench[:, 2], wrench[:, 4]])[:, 300::300]
    for expected, values in zip(series, np.transpose(found), strict=True):
        near(values, expected, 1e-8)


def test_settles_where_statics_say(unit):
    rod = damped_rod()
    wrench, gravity = np.array([30.0, -20.0, 10.0, 1.0, 2.0, -3.0]), np.array([1.0, -9.0, 3.0])
    start = {f"small_end.{p}": v for p, v in zip(WRENCH, wrench, strict=True)}
    start |= {f"gravity.g{a}": v for a, v in zip("xyz", gravity, strict=True)} | {"damping_ratio": 0.7}
    one = unit("rod").instance(**start)
    one.step(10.0)
    static = other(rod).modes @ ((other(rod).modes.T @ wrench + rod.mass_matrix()[6:, :3] @ gravity) / rod.stiffness)
    places, rates, reactions = (one.get(group) for group in names(rod))
    near(places[:3], static[:3], 1e-12)
    near(places[3:], static[3:], 1e-12)
    assert np.abs(rates).max() < 1e-12
    weight = rod.mass * gravity
    near(reactions[:3], -(wrench[:3] + weight), 1e-12)
    arm = np.cross(other(rod).p_BI_B, wrench[:3]) + np.cross(rod.com, weight)
    near(reactions[3:], -(wrench[3:] + arm), 1e-12)
    one.free()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_instances_do_not_know_each_other_and_begin_anew(unit, fmi):
    there = unit("rod", fmi)
    one, two = there.instance("one", **{"gravity.gy": 1.0}), there.instance("two", **{"gravity.gy": -2.0})
    for _ in range(5):
        one.step(1e-4)
        two.step(1e-4)
    first = one.get(["small_end.y"])
    near(two.get(["small_end.y"]), -2.0 * first, 1e-13)
    one.set({"small_end.Fx": 9.0})
    one.fmu.reset()
    one.initialise(t=3.0, **{"gravity.gy": 1.0})
    assert one.get(["small_end.Fx"])[0] == 0.0
    assert one.get(["time", "small_end.y"]) == pytest.approx([3.0, 0.0], abs=0.0)
    for _ in range(5):
        one.step(1e-4)
    assert one.get(["small_end.y"]) == first
    one.fmu.terminate()
    one.free()
    two.free()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_states_are_kept_and_restored(unit, fmi):
    one = unit("coupled", fmi).instance(**{"gravity.gx": 3.0})
    one.step(1e-4)
    kept, t = one.keep(), one.t
    one.set({"small_end.Fy": 7.0})
    one.step(2e-4)
    ahead = one.get(names(coupled_rod())[0])
    serialise = one.fmu.serializeFMUstate if fmi == 2 else one.fmu.serializeFMUState
    there = one.fmu.deSerializeFMUstate if fmi == 2 else one.fmu.deserializeFMUState
    stored = serialise(kept)
    for state in (kept, there(stored)):
        one.restore(state)
        one.t = t
        assert one.get(["time", "small_end.Fy"]) == pytest.approx([t, 0.0], abs=0.0)
        one.set({"small_end.Fy": 7.0})
        one.step(2e-4)
        assert (one.get(names(coupled_rod())[0]) == ahead).all()
    random = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(stored)
        damaged[random.integers(len(damaged))] ^= 1 << int(random.integers(8))
        with pytest.raises(Exception, match="failed"):
            there(bytes(damaged))
    with pytest.raises(Exception, match="failed"):
        there(stored[:-8])
    one.free()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_wrong_calls_are_errors_and_change_nothing(unit, fmi):
    there = unit("rod", fmi)
    with pytest.raises(Exception, match="instantiate"):
        Instance(there, token="{00000000-0000-0000-0000-000000000000}")
    one = there.instance(**{"gravity.gy": 1.0})
    set_numbers = one.fmu.setReal if fmi == 2 else one.fmu.setFloat64
    get_numbers = one.fmu.getReal if fmi == 2 else one.fmu.getFloat64
    last = len(there.references)
    one.step(1e-4)
    before = one.get(there.references)
    for call in (
        lambda: one.set({"gravity.gx": 5.0, "gravity.gy": float("nan")}),
        lambda: one.set({"gravity.gy": float("inf")}),
        lambda: one.set({"small_end.y": 1.0}),
        lambda: one.set({"damping_ratio": 0.1}),
        lambda: set_numbers([0], [1.0]),
        lambda: set_numbers([last], [1.0]),
        lambda: get_numbers([last]),
        lambda: get_numbers([2**32 - 1]),
        lambda: one.fmu.doStep(one.t, 0.0),
        lambda: one.fmu.doStep(one.t, -1e-4),
        lambda: one.fmu.doStep(one.t, float("nan")),
        lambda: one.fmu.doStep(one.t, float("inf")),
        lambda: one.fmu.doStep(one.t + 1.0, 1e-4),
        lambda: one.fmu.exitInitializationMode(),
        lambda: one.fmu.setDebugLogging(True, ["logNothing"]),
    ):
        with pytest.raises(Exception, match="failed"):
            call()
        assert (one.get(there.references) == before).all()
    one.fmu.terminate()
    with pytest.raises(Exception, match="failed"):
        one.step(1e-4)
    one.free()
    with pytest.raises(Exception, match="failed"):
        there.instance(damping_ratio=-0.1)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_null_pointers_are_errors(unit, fmi):
    there = unit("rod", fmi)
    loaded = library(there)
    version = loaded[f"fmi{fmi}GetVersion"]
    version.restype = ctypes.c_char_p
    assert version() == (b"2.0" if fmi == 2 else b"3.0")
    error, null = 3, ctypes.c_void_p()
    number = "Real" if fmi == 2 else "Float64"
    step = (null, ctypes.c_double(0.0), ctypes.c_double(1.0), ctypes.c_bool(True))
    assert loaded[f"fmi{fmi}DoStep"](*step, *[null] * (0 if fmi == 2 else 4)) == error
    for function in (f"Get{number}", f"Set{number}", "Terminate", "Reset", "ExitInitializationMode"):
        assert loaded[f"fmi{fmi}{function}"](null, null, ctypes.c_size_t(1), null, ctypes.c_size_t(1)) == error
    state = "FMUstate" if fmi == 2 else "FMUState"
    for function in (f"Get{state}", f"Set{state}", f"Free{state}"):
        assert loaded[f"fmi{fmi}{function}"](null, null) == error
    one = there.instance()
    instance = ctypes.c_void_p(one.fmu.component)
    one_number = ctypes.c_size_t(1)
    for function in (f"Get{number}", f"Set{number}", f"Set{'Integer' if fmi == 2 else 'Int32'}"):
        assert loaded[f"fmi{fmi}{function}"](instance, null, one_number, null, one_number) == error
    for function in (f"Get{state}", f"Set{state}"):
        assert loaded[f"fmi{fmi}{function}"](instance, null) == error
    loaded[f"fmi{fmi}FreeInstance"](null)
    one.free()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_compiler_agrees_with_the_standards_headers(fmi, tmp_path):
    """Our definitions against the prototypes of the standard, and no warnings."""
    for name in unit_build.layer_sources(fmi):
        shutil.copy(str(resources.files("flexmbd.export.functional_mockup") / name), tmp_path / name)
    shutil.copy(str(resources.files("flexmbd.export.functional_mockup") / "linear_body.c"), tmp_path)
    shutil.copy(str(resources.files("flexmbd.export.functional_mockup") / "linear_body.h"), tmp_path)
    strict = ["gcc", "-std=c99", "-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion"]
    subprocess.run([*strict, *tmp_path.glob("*.c")], check=True)
    # in place of our header, the standard's
    (tmp_path / f"fmi{fmi}.h").write_text(f"#include <fmi{fmi}Functions.h>\n")
    headers = Path(fmpy.__file__).parent / "c-code"
    subprocess.run([*strict[:-1], f"-isystem{headers}", tmp_path / f"fmi{fmi}.c"], check=True)
    declared = {
        word.strip("()")
        for line in (headers / f"fmi{fmi}Functions.h").read_text().splitlines()
        if line.strip().startswith(f"FMI{fmi}_Export")
        for word in line.replace(";", " ").split()
        if word.startswith(f"fmi{fmi}") and not word.endswith("TYPE")
    }
    text = (tmp_path / f"fmi{fmi}.c").read_text()
    missing = {one for one in declared if f" {one}(" not in text and f"({one}" not in text}
    generated = ("fmi3Get", "fmi3Set", "fmi2Get", "fmi2Set")  # by a macro, each type's and each status'
    assert len(declared) > 40
    assert not {one for one in missing if not one.startswith(generated)}


@pytest.mark.parametrize("fmi", VERSIONS)
def test_other_machines_compile_the_sources(fmi, tmp_path):
    """What `fmpy compile` hands to CMake, from the unit's own list of sources, makes the library."""
    rod = damped_rod()
    fm.export.fmu(rod, tmp_path / "rod.fmu", fmi=fmi, binary=False)
    assert validate_fmu(str(tmp_path / "rod.fmu")) == []
    with zipfile.ZipFile(tmp_path / "rod.fmu") as archive:
        assert not any(name.startswith("binaries") for name in archive.namelist())
    folder = fmpy.extract(str(tmp_path / "rod.fmu"), str(tmp_path / "unzipped"))
    (files,) = fmpy.read_model_description(folder).buildConfigurations[0].sourceFileSets
    assert sorted(files.sourceFiles) == sorted(path.name for path in Path(folder, "sources").glob("*.c"))
    create_cmake_settings(folder, tmp_path)
    cache = dict(line.split("=", 1) for line in (tmp_path / "CMakeCache.txt").read_text().splitlines())
    place = Path(cache["FMI_TARGET_DIR:STRING"], cache["FMI_MODEL_IDENTIFIER:STRING"]).with_suffix(".so")
    place.parent.mkdir(parents=True)
    sources, include = cache["FMI_SOURCES:STRING"].split(";"), cache["FMI_INCLUDE_DIRS:STRING"]
    subprocess.run(["cc", "-shared", "-fPIC", f"-I{include}", *sources, "-o", place], check=True)
    one = Unit(folder, folder).instance(**{"gravity.gy": 1.0})
    one.step(1e-4)
    reference = Reference(rod)
    reference.step(1e-4, np.zeros(6), np.array([0.0, 1.0, 0.0]))
    near(one.get(names(rod)[0]), reference.outputs(np.zeros(6), np.zeros(3))[0], 1e-12)
    one.free()


def test_same_body_same_bytes(tmp_path):
    digests = set()
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        fm.export.fmu(damped_rod(), tmp_path / folder / "rod.fmu")
        digests.add(hashlib.sha256((tmp_path / folder / "rod.fmu").read_bytes()).hexdigest())
    assert len(digests) == 1


@pytest.mark.parametrize("fmi", VERSIONS)
def test_any_name_that_xml_carries(tmp_path, fmi):
    rod = damped_rod()
    frames = tuple(
        replace(frame, name=name) for frame, name in zip(rod.interfaces, ('Kolben <1> & "2"', "große Öse"), strict=True)
    )
    body = replace(rod, interfaces=frames, frame=frames[0].name)
    path = tmp_path / "1 Träger.fmu"
    fm.export.fmu(body, path, fmi=fmi)
    assert validate_fmu(str(path)) == []
    there = Unit(path, tmp_path / "unzipped")
    assert there.description.modelName == "1 Träger"
    assert there.description.coSimulation.modelIdentifier == "_1_Tr_ger"
    one = there.instance(**{"große Öse.Fy": 1.0})
    one.step(1e-4)
    assert one.get(["große Öse.y"])[0] > 0.0
    one.free()


def test_what_cannot_be_a_unit_is_refused(tmp_path, monkeypatch):
    rod, path = damped_rod(), tmp_path / "rod.fmu"
    path.write_text("before")
    nothing = replace(
        rod, gram=rod.gram[:4, :4], stiffness=np.zeros(0), damping=np.zeros((0, 0)), partition=np.zeros((0, 0)),
        partition_names=(), interfaces=tuple(replace(f, modes=np.zeros((6, 0))) for f in rod.interfaces), stretch=None,
        geometric=None, loads=None, modes=None, surface=None, stress=None,
    )  # fmt: skip
    line = replace(rod, interfaces=tuple(replace(f, name=f.name + "\n") for f in rod.interfaces), frame="big_end\n")
    for body, options, words in (
        (replace(rod, frame=None), {}, "floats"),
        (replace(rod, frame=None), {"lossy": True}, "floats"),
        (nothing, {}, "does not deform"),
        (line, {}, "control characters"),
        (rod, {"fmi": 1}, "versions 2 and 3"),
        (rod, {"step": 0.0}, "step"),
        (rod, {"step": float("nan")}, "step"),
    ):
        with pytest.raises(ExportError, match=words):
            fm.export.fmu(body, path, **options)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ExportError, match="apt install gcc"):
        fm.export.fmu(rod, path)
    (tmp_path / "gcc").write_text("#!/bin/sh\necho no room >&2\nexit 1\n")
    (tmp_path / "gcc").chmod(0o755)
    with pytest.raises(ExportError, match="no room"):
        fm.export.fmu(rod, path)
    assert path.read_text() == "before"


def test_tells_what_is_left_out(tmp_path):
    lost = fm.export.fmu(soft_bar(), tmp_path / "bar.fmu", binary=False)
    assert any("large motions" in one for one in lost)
    assert any("stiffening" in one for one in lost)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_host_with_its_own_solver(unit, fmi):
    """Model exchange: CVode moves the body as its exact propagator does, from the static response to its weight."""
    rod = damped_rod()
    start = {"gravity.gy": -9.81, "static_start": 0.5, "damping_ratio": 0.02}
    path, span = Path(unit("rod", fmi).folder).parent / "rod.fmu", 2e-3
    result = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-8, stop_time=span,
        output_interval=span / 10, output=["small_end.y", "big_end.reaction_Fy"], start_values=start,
    )  # fmt: skip
    reference, gravity = Reference(rod, ratio=0.02), np.array([0.0, -9.81, 0.0])
    reference.x[: rod.n_modes] = 0.5 * reference.forces(np.zeros(6), gravity) / reference.w
    expected = []
    for _ in result["time"]:
        place, _, reaction = reference.outputs(np.zeros(6), gravity)
        expected.append((place[1], reaction[1]))
        reference.step(span / 10, np.zeros(6), gravity)
    assert np.ptp(np.transpose(expected)[0]) > 0.5 * abs(expected[0][0])
    near(result["small_end.y"], np.transpose(expected)[0], 1e-5)
    near(result["big_end.reaction_Fy"], np.transpose(expected)[1], 1e-5)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_directional_derivatives_of_the_body(unit, fmi):
    """Of a linear system they are differences, whatever the change's size."""
    there = unit("coupled", fmi)
    one = there.instance(exchange=True, damping_ratio=0.1, **{"gravity.gx": 3.0})
    n = coupled_rod().n_modes
    states = [f"mode_{k + 1}{ending}" for ending in ("", ".rate") for k in range(n)]
    knowns = ["small_end.Fy", "gravity.gz", *states]
    unknowns = [*(f"der({name})" for name in states), *np.concatenate(names(coupled_rod()))]
    random = np.random.default_rng(4)
    x, change = random.normal(size=2 * n), random.normal(size=len(knowns))
    one.set_states(x)
    before = one.get(unknowns)
    found = one.direction(unknowns, knowns, change)
    one.set({"small_end.Fy": change[0], "gravity.gz": change[1]})
    one.set_states(x + change[2:])
    near(found, one.get(unknowns) - before, 1e-9)
    assert one.get(states) == pytest.approx(x + change[2:], abs=0.0)
    with pytest.raises(Exception, match="failed"):
        one.direction(unknowns, ["damping_ratio"], np.ones(1))
    with pytest.raises(Exception, match="failed"):
        one.direction(states[:1], knowns, change)
    with pytest.raises(Exception, match="failed"):
        one.set_states(np.full(2 * n, np.nan))
    one.free()
    stepped = there.instance()
    with pytest.raises(Exception, match="failed"):
        stepped.direction(unknowns, knowns, change)
    stepped.free()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_begins_in_equilibrium(unit, fmi):
    """With its whole static response it stays where it is, to what is left of the digits."""
    one = unit("rod", fmi).instance(static_start=1.0, **{"small_end.Fy": 20.0, "gravity.gx": 9.81})
    first = one.get(names(damped_rod())[0])
    for _ in range(3):
        one.step(1e-3)
    near(one.get(names(damped_rod())[0]), first, 1e-12)
    assert np.abs(first).max() > 1e-9
    one.free()
