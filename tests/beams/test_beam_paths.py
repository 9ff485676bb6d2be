"""Paths of equilibria of exact beams: the elastica, followers, Beck's flutter; thin beams take no more steps."""

import dataclasses
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.forms import beam_timoshenko


def thin(height):
    """A rectangular section of Kirchhoff's beam, and its bending stiffness in the weak plane, that of x and z."""
    p = beam_timoshenko.Parameters.rectangle(2e11, 0.3, 7800.0, width=2 * height, height=height, orientation=(0, 1, 0))
    return SimpleNamespace(**{**dataclasses.asdict(p), "ky": np.inf, "kz": np.inf}), p.E * min(p.Iy, p.Iz)


def cantilever(n, force, *, follows=False, height=0.01):
    """A beam of 1 m along x, clamped, and a force on its tip in units of EI / L^2."""
    section, bending = thin(height)
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"rod": [("clamp", "tip")]}, {"rod": section}, n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    tip = beam.frame("tip")
    axes = fm.force.Axes.FRAME if follows else fm.force.Axes.WORLD
    parts = tuple((lambda t, part=part: part(t) * bending) if callable(part) else part * bending for part in force)
    scene.add_force(fm.force.FrameForce(tip, parts, axes=axes))
    return scene, tip


def test_a_column_buckles_to_the_elastica():
    """Tip at 2 E / K - 1 and 2 k / K under K(k)^2 EI / L^2 (Timoshenko & Gere 1961, section 2.7)."""
    scene, tip = cantilever(8, (lambda t: -t, 0.0, 0.0))
    straight = scene.equilibrium(path=fm.Continuation(to=4.0))
    (critical,) = straight.critical
    assert critical.kind is fm.CriticalKind.BIFURCATION
    assert critical.t == pytest.approx(np.pi**2 / 4, rel=5e-5)
    assert straight.unstable[-1] == 1
    bent = scene.equilibrium(about=critical, path=fm.Continuation(to=5.0, longest_step=0.2))
    assert (bent.unstable[1:] == 0).all()
    place = bent.position(tip)
    for factor, (x, y, z) in list(zip(bent.factors, place, strict=True))[3:]:
        k = brentq(lambda k, factor=factor: ellipk(k * k) ** 2 - factor, 1e-6, 0.999999)
        exact = 2 * ellipe(k * k) / ellipk(k * k) - 1, 2 * k / ellipk(k * k)
        assert (x, abs(z)) == pytest.approx(exact, abs=3e-4)
        assert abs(y) < 1e-12
    assert place[-1, 0] == pytest.approx(0.0597845, abs=2e-5)


def test_becks_column_flutters():
    """At 20.05 EI / L^2, without ever having another equilibrium; second order in the elements."""
    found = []
    for n in (4, 8):
        scene, _ = cantilever(n, (lambda t: -t, 0.0, 0.0), follows=True)
        path = scene.equilibrium(path=fm.Continuation(to=25.0))
        (critical,) = path.critical
        assert critical.kind is fm.CriticalKind.FLUTTER
        assert set(path.unstable[path.factors < critical.t]) == {0}
        assert set(path.unstable[path.factors > critical.t]) == {2}
        found.append(critical.t)
    assert found[1] == pytest.approx(20.0509, rel=4e-3)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(20.0509, rel=1e-3)
    # the machine's own vibrations grow beyond, and not before
    for point in (path.points[-2], path.points[-1]):
        grows = scene.linearize(about=point).eigenvalues().real.max()
        assert (grows > 1.0) == (point.t > critical.t)
    assert path.points[-1].unstable == 2


def follower_tip(force):
    """(2,) place of the tip under a force across it, force EI / L^2: EI psi'' = - F cos(psi) from the tip on."""

    def slope(_, y):
        psi, rate, _, _ = y
        return [rate, -force * np.cos(psi), np.cos(psi), np.sin(psi)]

    psi, _, along, across = solve_ivp(slope, (0.0, 1.0), np.zeros(4), rtol=1e-11, atol=1e-12).y[:, -1]
    # from the tip's axes to the clamp's
    c, s = np.cos(psi), np.sin(psi)
    return np.array([c * along + s * across, -s * along + c * across])


@pytest.mark.parametrize("load", [20.0, 100.0])
def test_a_follower_winds_the_beam_up(load):
    """Found at once, though a force that follows has no potential; it may be unstable, and says so."""
    scene, tip = cantilever(12, (0.0, 0.0, load), follows=True)
    told = pytest.warns(fm.EquilibriumWarning, match=r"2 independent motions grow, most of all in 'beam\.rod\.8\.wx'")
    with told if load > 27.0 else nullcontext():
        wound = scene.equilibrium()
    x, y, z = wound.position(tip)
    assert (x, abs(z)) == pytest.approx(abs(follower_tip(load)) * [np.sign(x), 1.0], abs=2e-5 * load)
    assert abs(y) < 1e-12
    assert (wound.unstable > 0) == (load > 27.0)


def test_thin_beams_take_as_many_steps_as_fat_ones():
    points = set()
    for height in (0.1, 0.01, 0.001):
        scene, _ = cantilever(6, (0.0, 0.0, lambda t: 50.0 * t), height=height)
        path = scene.equilibrium(path=fm.Continuation(to=1.0, longest_step=0.3))
        points.add(len(path.points))
    assert max(points) <= 10
    assert max(points) - min(points) <= 1


def test_a_shallow_arch_snaps():
    """Clamped at both ends, a loop: it turns twice, and is unstable between."""
    section, _ = thin(0.01)
    scene = fm.System()
    rise, half = 0.04, 0.5
    ends = {"a": (-half, 0.0, 0.0), "top": (0.0, 0.0, rise), "b": (half, 0.0, 0.0)}
    halves = [("a", (-half / 2, 0, 0.75 * rise), "top"), ("top", (half / 2, 0, 0.75 * rise), "b")]
    arch = fm.ExactBeam(ends, {"arc": halves}, {"arc": section}, 3)
    scene.add(arch, name="arch")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=ends["a"]), arch.frame("a"))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=ends["b"]), arch.frame("b"))
    scene.add_force(fm.force.FrameForce(arch.frame("top"), (0.0, 0.0, lambda t: -t)))
    path = scene.equilibrium(path=fm.Continuation(to=6e4, back_to=-6e4))
    limits = [one for one in path.critical if one.kind is fm.CriticalKind.LIMIT]
    assert len(limits) == 2
    assert limits[0].t > limits[1].t
    assert path.end is fm.PathEnd.REACHED
    assert path.unstable[0] == path.unstable[-1] == 0
    assert path.position(arch.frame("top"))[-1, 2] < -rise


def test_a_beam_that_nothing_holds():
    section, _ = thin(0.01)
    scene = fm.System()
    rod = fm.ExactBeam({"a": (0, 0, 0), "b": (1, 0, 0)}, {"rod": [("a", "b")]}, {"rod": section}, 2)
    scene.add(rod, name="rod")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rod.frame("a"), name="hinge")
    scene.add_force(fm.force.FrameForce(rod.frame("b"), (lambda t: t, 0.0, 0.0)))
    with pytest.raises(SceneError, match=r"nothing resists the motion of .*hinge"):
        scene.equilibrium(path=fm.Continuation(to=1.0))


def shallow_arch():
    """A clamped one of 1 m that rises by 3 % of its span, under t N / (EI / m^2) at each of 15 points."""
    section, bending = thin(0.01)
    scene = fm.System()
    x = np.linspace(0.0, 1.0, 17)
    points = {f"p{k}": (one, 0.0, 0.12 * one * (1.0 - one)) for k, one in enumerate(x)}
    pieces = [(f"p{k}", f"p{k + 1}") for k in range(16)]
    beam = scene.add(fm.ExactBeam(points, {"arch": pieces}, {"arch": section}, 1), name="arch")
    for end in ("p0", "p16"):
        scene.connect(fm.joint.Fixed(), scene.ground.frame(p=points[end]), beam.frame(end))
    for k in range(1, 16):
        scene.add_force(fm.force.FrameForce(beam.frame(f"p{k}"), (0.0, 0.0, lambda t: -t * bending)))
    return scene


def test_a_branch_of_a_shallow_arch_is_a_closed_one():
    """From where a clamped arch first bends aside to where it last does and back, not onto the path that crosses there.

    It moves by as much as it rises: steps that are short in its size turn sharply in its shape.
    """
    scene = shallow_arch()
    path = scene.equilibrium(path=fm.Continuation(to=4.0))
    kinds = [one.kind for one in path.critical]
    aside = [one for one in path.critical if one.kind is fm.CriticalKind.BIFURCATION]
    assert kinds.count(fm.CriticalKind.LIMIT) == 2
    assert len(aside) == 2
    with pytest.warns(fm.PathWarning, match="is closed"):
        branch = scene.equilibrium(about=aside[0], path=fm.Continuation(to=4.0))
    assert branch.end is fm.PathEnd.CLOSED
    assert [one.t for one in branch.critical] == pytest.approx([aside[1].t, aside[0].t], rel=1e-6)
    assert branch.factors[-1] == branch.factors[1]
