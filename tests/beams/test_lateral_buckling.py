"""Beams that give way aside: lateral buckling of a thin strip, and a column under a load that follows it all along."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from cantilever import rod_tips

import flexmbd as fm
from flexmbd.forms import beam_timoshenko


def strip():
    """A knife-edged cantilever's section of Kirchhoff's beam, 100 mm high along z and 1 mm thick; it does not warp."""
    p = beam_timoshenko.Parameters.rectangle(2e11, 0.3, 7800.0, width=1e-3, height=0.1, orientation=(0, 1, 0))
    return SimpleNamespace(**{**dataclasses.asdict(p), "ky": np.inf, "kz": np.inf})


def clamped(n, section):
    """A beam of 1 m along x, clamped at its start."""
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"rod": [("clamp", "tip")]}, {"rod": section}, n), name="beam")
    held = scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    return scene, beam, held


def test_a_strip_buckles_aside_under_a_load_at_its_end():
    """At 4.0126 sqrt(E I G J) / L^2 (Timoshenko & Gere 1961, section 6.3), and its path beyond against shooting."""
    section = strip()
    weak, twist = section.E * min(section.Iy, section.Iz), section.E / (2 * (1 + section.nu)) * section.J
    unit = np.sqrt(weak * twist)
    found = []
    for n in (6, 12):
        scene, beam, held = clamped(n, section)
        tip = beam.frame("tip")
        scene.add_force(fm.force.FrameForce(tip, (0.0, 0.0, lambda t: -unit * t)))
        plane = scene.equilibrium(path=fm.Continuation(to=5.0))
        (critical,) = plane.critical
        assert critical.kind is fm.CriticalKind.BIFURCATION
        assert abs(plane.position(tip)[:, 1]).max() < 1e-9
        found.append(critical.t)
    assert found[1] == pytest.approx(4.0126, rel=5e-3)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(4.0126, rel=1e-3)
    aside = scene.equilibrium(about=critical, path=fm.Continuation(to=1.2 * critical.t))
    assert set(aside.unstable[2:]) == {0}
    last = aside.points[-1]
    moment = last.reaction(held)[3:]
    (exact,) = rod_tips(section, [[0.0, 0.0, -unit * last.t]], length=1.0, moment=moment)
    assert abs(exact[1]) > 0.2
    assert last.position(tip) - [1.0, 0.0, 0.0] == pytest.approx(exact, abs=5e-3)


def column(n):
    """A clamped column of 1 m along x, and its bending stiffness in the weak plane, that of x and z."""
    p = beam_timoshenko.Parameters.rectangle(2e11, 0.3, 7800.0, width=0.02, height=0.01, orientation=(0, 1, 0))
    scene, beam, _ = clamped(n, SimpleNamespace(**{**dataclasses.asdict(p), "ky": np.inf, "kz": np.inf}))
    return scene, beam, p.E * min(p.Iy, p.Iz)


def flutter(scene, to):
    """The factor at which vibrations begin to grow, before which none do."""
    path = scene.equilibrium(path=fm.Continuation(to=to))
    critical = path.critical[0]
    assert critical.kind is fm.CriticalKind.FLUTTER
    assert set(path.unstable[path.factors < critical.t]) == {0}
    return critical.t


def test_leipholz_column_flutters():
    """A tangential load all along it: 40.05 E I / L^3 (Leipholz 1962, Ingenieur-Archiv 31)."""
    found = []
    for n in (4, 8):
        scene, beam, bending = column(n)
        for one in beam.line_load("rod", (-bending, 0.0, 0.0), axes=fm.force.Axes.FRAME):
            grows = tuple(lambda t, part=part: part * t for part in one.force)
            scene.add_force(dataclasses.replace(one, force=grows))
        found.append(flutter(scene, 50.0))
    assert found[1] == pytest.approx(40.05, rel=2e-2)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(40.05, rel=5e-3)


def test_reuts_column_flutters():
    """A force along a line that stays, on a plate on the column's end: 20.05 E I / L^2, as Beck's (Bolotin 1963)."""
    found = []
    for n in (4, 8):
        scene, beam, bending = column(n)
        tip = beam.frame("tip")

        def push(m, tip=tip, bending=bending):
            force = np.array([-bending * m.t, 0.0, 0.0])
            _, y, z = m.position(tip)
            return [(tip, force, np.cross([0.0, -y, -z], force))]

        scene.add_force(fm.force.KaneForce(push))
        found.append(flutter(scene, 25.0))
    assert found[1] == pytest.approx(20.0509, rel=4e-3)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(20.0509, rel=1e-3)
