"""Units for Windows: kernels as its object code; libraries where mingw-w64 is installed, runs where Wine is."""

import os
import re
import shutil
import struct
import subprocess

import numpy as np
import pytest
from exported_bodies import damped_rod
from units import Unit

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.unit_build import WINDOWS
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.object_code import kernel_for, object_code
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.plan.compiled_scene import add_probe

HERE = shutil.which(WINDOWS.compiler) is not None
WINE = shutil.which("wine64") or shutil.which("wine")


def pendulum():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), (0.2, 0.0, 0.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame(), name="hinge")
    return scene, hinge, bob.frame(p=(0.2, 0.0, 0.0))


def symbols_of(coff):
    """Of a COFF file: name to the section that defines it, 0 where none does."""
    table, count = struct.unpack_from("<II", coff, 8)
    texts = table + 18 * count
    found, k = {}, 0
    while k < count:
        raw, section, _, kind, further = struct.unpack_from("<8sxxxxhHBB", coff, table + 18 * k)
        zero, place = struct.unpack("<II", raw)
        name = coff[texts + place : coff.index(b"\0", texts + place)] if zero == 0 else raw.rstrip(b"\0")
        if kind == 2:  # external
            found[name.decode()] = section
        k += 1 + further
    return found


def test_kernels_are_object_code_of_windows():
    """COFF for x86-64 that defines the kernel and asks for C's functions alone."""
    scene, _, tip = pendulum()
    compiled = scene.start().scene
    plan, row = add_probe(compiled, tip), np.zeros((1, 1))
    kernel = kernel_for(frame_series, (plan, new_work(plan), 0, row, row, row, np.zeros((1, 21))))
    code = object_code(kernel, WINDOWS.triple)
    assert struct.unpack_from("<H", code) == (0x8664,)
    symbols = symbols_of(code)
    assert symbols[kernel.symbol] > 0
    asked = {name for name, section in symbols.items() if section == 0 and "NumbaEnv" not in name}
    assert asked <= {"sin", "cos", "sincos", "memset", "memcpy", "flexmbd_bind_deferred", "___chkstk_ms"}


@pytest.mark.skipif(HERE, reason="mingw-w64 is installed")
def test_without_the_compiler_the_remedy_is_told(tmp_path):
    for write in (
        lambda: fm.export.fmu(damped_rod(), tmp_path / "rod.fmu", windows=True),
        lambda: fm.export.fmu_machine(pendulum()[0], tmp_path / "a.fmu", h=1e-3, windows=True),
    ):
        with pytest.raises(ExportError, match="apt install gcc-mingw-w64-x86-64"):
            write()
    assert not list(tmp_path.iterdir())


HOST = r"""
#include <windows.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#define CALL(type, name) ((type)(void *)GetProcAddress(unit, name))
typedef void *(*Make)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
                      void *, void *, void *);
typedef int (*Enter)(void *, bool, double, double, bool, double);
typedef int (*Plain)(void *);
typedef int (*Step)(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int (*Get)(void *, const uint32_t *, size_t, double *, size_t);
int main(int argc, char **argv) {
    HMODULE unit = LoadLibraryA(argv[1]);
    if (argc < 4 || !unit) return 1;
    void *one = CALL(Make, "fmi3InstantiateCoSimulation")("one", argv[2], "", 0, 0, 0, 0, 0, 0, 0, 0, 0);
    if (!one) return 2;
    if (CALL(Enter, "fmi3EnterInitializationMode")(one, 0, 0, 0, 0, 0)) return 3;
    if (CALL(Plain, "fmi3ExitInitializationMode")(one)) return 4;
    double reached, value;
    for (int k = 0; k < 10; k++) {
        bool event, ends, early;
        if (CALL(Step, "fmi3DoStep")(one, k * 1e-2, 1e-2, 1, &event, &ends, &early, &reached)) return 5;
    }
    uint32_t reference;
    sscanf(argv[3], "%u", &reference);
    if (CALL(Get, "fmi3GetFloat64")(one, &reference, 1, &value, 1)) return 6;
    printf("%.17g\n", value);
    return 0;
}
"""


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """The pendulum's unit for both systems."""
    folder = tmp_path_factory.mktemp("swing")
    scene, hinge, tip = pendulum()
    outputs = {"angle": fm.output.Position(hinge), "tip": fm.output.Velocity(tip)}
    fm.export.fmu_machine(scene, folder / "swing.fmu", h=1e-3, outputs=outputs, windows=True)
    return Unit(folder / "swing.fmu", folder / "unzipped")


@pytest.mark.skipif(not HERE, reason="mingw-w64 is not installed")
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_library_exports_the_interface(swing, tmp_path, fmi):
    if fmi == 3:
        binary = f"{swing.folder}/binaries/x86_64-windows/swing.dll"
    else:
        fm.export.fmu(damped_rod(), tmp_path / "rod.fmu", windows=True, fmi=2)
        binary = f"{Unit(tmp_path / 'rod.fmu', tmp_path / 'unzipped').folder}/binaries/win64/rod.dll"
    command = ["x86_64-w64-mingw32-objdump", "-p", binary]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    exported = re.findall(rf"\] (?:\+base\[ *\d+\] +[0-9a-f]+ )?(fmi{fmi}\w+)", told)
    assert {f"fmi{fmi}{name}" for name in ("DoStep", "Terminate", "GetVersion", "SetTime")} <= set(exported)
    assert len(exported) > 40
    assert {name.lower() for name in re.findall(r"DLL Name: (\S+)", told)} <= {"kernel32.dll", "msvcrt.dll"}


@pytest.mark.skipif(not (HERE and WINE), reason="mingw-w64 or Wine is not installed")
def test_wine_runs_it(swing, tmp_path):
    (tmp_path / "host.c").write_text(HOST)
    subprocess.run([WINDOWS.compiler, tmp_path / "host.c", "-o", tmp_path / "host.exe"], check=True)
    reference, token = swing.references["angle"], swing.description.guid
    binary = f"{swing.folder}/binaries/x86_64-windows/swing.dll"
    command = [WINE, str(tmp_path / "host.exe"), binary, token, str(reference)]
    quiet = os.environ | {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"}
    done = subprocess.run(command, capture_output=True, text=True, env=quiet)
    assert done.returncode == 0, done.stderr
    one = swing.instance()
    for _ in range(10):
        one.step(1e-2)
    assert float(done.stdout) == pytest.approx(one.get(["angle"])[0], rel=1e-12)  # the two have sines of their own
    one.free()
