"""Force elements from outside the package: laws of one's own between two frames, against those that are built in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.elements.table import element_wrench_variation


@fm.compiled
def pull(data, d, R, rate, spin, out):
    """A spring of stiffness data[0] and length data[1], a part that grows with the cube, data[2]; a damper, data[3]."""
    length = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    s = length - data[1]
    speed = (d[0] * rate[0] + d[1] * rate[1] + d[2] * rate[2]) / length
    force = data[0] * s + data[2] * s**3 + data[3] * speed
    for k in range(3):
        out[k] = -force / length * d[k]
    return 0.5 * data[0] * s**2 + 0.25 * data[2] * s**4


@fm.compiled
def pull_variation(data, d, R, rate, spin, dd, dtheta, drate, dspin, out):
    length = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    s = length - data[1]
    stretch = (d[0] * dd[0] + d[1] * dd[1] + d[2] * dd[2]) / length
    speed = (d[0] * rate[0] + d[1] * rate[1] + d[2] * rate[2]) / length
    change = (d[0] * drate[0] + d[1] * drate[1] + d[2] * drate[2]) / length
    change += (dd[0] * rate[0] + dd[1] * rate[1] + dd[2] * rate[2]) / length - speed * stretch / length
    force = data[0] * s + data[2] * s**3 + data[3] * speed
    dforce = (data[0] + 3.0 * data[2] * s**2) * stretch + data[3] * change
    for k in range(3):
        out[k] = -(dforce * d[k] + force * dd[k] - force * stretch / length * d[k]) / length


@fm.compiled
def turn_back(data, d, R, rate, spin, out):
    """A torque by the turn's skew part and the spin, which stores what it does not say."""
    out[3] = -data[0] * (R[2, 1] - R[1, 2]) - data[1] * spin[0]
    out[4] = -data[0] * (R[0, 2] - R[2, 0]) - data[1] * spin[1]
    out[5] = -data[0] * (R[1, 0] - R[0, 1]) - data[1] * spin[2]


@dataclass(frozen=True, eq=False)
class OwnSpring(fm.force.BetweenFrames):
    frame_F: fm.Frame
    frame_G: fm.Frame
    stiffness: float
    length: float
    damping: float = 0.0
    cube: float = 0.0
    derivative: fm.Compiled | None = None

    def check(self) -> None:
        fm.force.check_numbers(self.what, least={"stiffness": self.stiffness, "damping": self.damping})

    def assemble(self, table: fm.force.ElementTable) -> None:
        numbers = [self.stiffness, self.length, self.cube, self.damping]
        table.frame_law(pull, self.what, self.frame_F, self.frame_G, numbers=numbers, derivative=self.derivative)


@dataclass(frozen=True, eq=False)
class OwnLaw(fm.force.BetweenFrames):
    frame_F: fm.Frame
    frame_G: fm.Frame
    law: fm.Compiled
    numbers: tuple[float, ...] = ()

    def check(self) -> None:
        pass

    def assemble(self, table: fm.force.ElementTable) -> None:
        table.frame_law(self.law, self.what, self.frame_F, self.frame_G, numbers=self.numbers)


def flying(force, *more):
    """A body that flies, hung on the ground by a force between frames; it turns and swings."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = scene.add(fm.RigidBody(mass=1.3, inertia=(0.02, 0.03, 0.04)), name="body")
    joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    joint.velocity = (0.0, 0.0, 0.0, 1.0, -2.0, 0.5)
    scene.add_force(force(scene.ground.frame(p=(0.1, 0.5, 0.0)), body.frame(p=(0.2, 0.1, 0.05)), *more))
    return scene


METHODS = [fm.GeneralizedAlpha(), fm.RadauIIA(), fm.ExplicitRungeKutta(), fm.CentralDifference(), fm.EnergyMomentum()]


@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("derivative", [None, pull_variation], ids=["differences", "derivative"])
def test_an_own_spring_is_the_one_built_in(method, derivative):
    """Motion and stored energy of `SpringDamper`, to the round-off of some two hundred steps."""
    theirs = flying(fm.force.SpringDamper, 40.0, 0.3, 0.7).simulate(1.0, h=5e-3, integrator=method)
    own = flying(OwnSpring, 40.0, 0.3, 0.7, 0.0, derivative).simulate(1.0, h=5e-3, integrator=method)
    np.testing.assert_allclose(own.x, theirs.x, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(own.energy().total, theirs.energy().total, rtol=0.0, atol=1e-12)
    assert np.ptp(own.energy().total) > 0.1  # the damper takes it


def test_error_control_and_the_automatic_choice_take_an_own_spring():
    theirs = flying(fm.force.SpringDamper, 40.0, 0.3, 0.7).simulate(1.0, rtol=1e-9, integrator=fm.RadauIIA())
    own = flying(OwnSpring, 40.0, 0.3, 0.7).simulate(1.0, rtol=1e-6)
    assert "Radau" in own.stats.integrator
    np.testing.assert_allclose(own.x[-1], theirs.x[-1], atol=3e-6)


@pytest.mark.parametrize("cube", [0.0, 900.0])
def test_energy_momentum_keeps_the_energy_of_a_law_that_gives_it(cube):
    run = flying(OwnSpring, 40.0, 0.3, 0.0, cube).simulate(2.0, h=5e-3, integrator=fm.EnergyMomentum())
    total = run.energy().total
    assert np.ptp(total) < 1e-11 * np.ptp(run.energy().kinetic)
    damped = flying(OwnSpring, 40.0, 0.3, 0.5, cube).simulate(2.0, h=5e-3, integrator=fm.EnergyMomentum())
    assert (np.diff(damped.energy().total) < 1e-12).all()


def test_a_law_without_energy_counts_for_nothing_but_acts():
    """The torque of the turn's skew part is that of the energy -k tr R: the kinetic energy changes by this."""
    run = flying(OwnLaw, turn_back, (0.4, 0.0)).simulate(0.5, rtol=1e-8, integrator=fm.RadauIIA())
    trace = 4.0 * run.x[:, 3] ** 2 - 1.0  # of the rotation, by its quaternion
    total = run.energy().total
    assert np.ptp(total) > 0.05
    assert np.ptp(total - 0.4 * trace) < 1e-6


def variation_of(scene, step):
    compiled = scene.compile().scene
    rng = np.random.default_rng(3)
    R = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    d, rate, spin, *changes = (tuple(map(float, u)) for u in rng.standard_normal((7, 3)))
    row = compiled.plan.elements[0]
    plan, work = compiled.plan, new_work(compiled.plan)
    dd, dtheta, drate, dspin = changes
    changed = element_wrench_variation(plan, work, row, d, tuple(R.ravel()), rate, spin, dd, dtheta, drate, dspin, step)
    return np.array(changed)


def test_the_derivative_is_the_given_one_or_differences():
    exact = variation_of(flying(fm.force.SpringDamper, 40.0, 0.3, 0.7), 0.0)
    given = variation_of(flying(OwnSpring, 40.0, 0.3, 0.7, 0.0, pull_variation), 0.0)
    np.testing.assert_allclose(given, exact, rtol=1e-13, atol=1e-13)
    by_differences = variation_of(flying(OwnSpring, 40.0, 0.3, 0.7), 1e-5)
    np.testing.assert_allclose(by_differences, exact, rtol=1e-8, atol=1e-8)


def test_an_own_force_varies_in_a_compiled_scene():
    scene = flying(OwnSpring, 40.0, 0.3, 0.7)
    spring = next(force for force in scene.compile().scene.parts.forces if isinstance(force, OwnSpring))
    machine = scene.compile(parameters={"k": fm.parameter.OfForce(spring, "stiffness")})
    varied = machine.simulate(0.2, h=1e-2, integrator=fm.ExplicitRungeKutta(), k=55.0)
    anew = flying(OwnSpring, 55.0, 0.3, 0.7).simulate(0.2, h=1e-2, integrator=fm.ExplicitRungeKutta())
    np.testing.assert_array_equal(varied.x, anew.x)


@fm.compiled
def broken(data, d, R, rate, spin, out):
    out[0] = 1.0 / d[0]


def test_a_law_that_is_not_finite_stops_the_run_and_is_named():
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0)), name="body")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    scene.add_force(OwnLaw(scene.ground.frame(), body.frame(), broken))
    with pytest.raises(SceneError, match=r"OwnLaw ground.* to body.*: the compiled function gave no finite number"):
        scene.simulate(0.1)


@fm.compiled
def twice_its_energy(data, d, R, rate, spin, out):
    for k in range(3):
        out[k] = -data[0] * d[k]
    return data[0] * (d[0] ** 2 + d[1] ** 2 + d[2] ** 2)


def test_an_energy_that_is_not_the_wrench_s_own_is_refused():
    with pytest.raises(SceneError, match=r"OwnLaw .*: at the start its force at rest, .* is not that of the energy"):
        flying(OwnLaw, twice_its_energy, (30.0,)).simulate(0.1)


@fm.compiled
def wall(data, d, R, rate, spin, out):
    """The energy data[0] s^n, n = data[1], of how far s d[0] lies behind data[2], before it if data[4].

    Its force is 1 + data[3] of its own.
    """
    n, s = data[1], d[0] - data[2]
    if s < 0.0 and data[4] == 0.0:
        return 0.0
    out[0] = -(1.0 + data[3]) * data[0] * n * s ** (n - 1.0)
    return data[0] * s**n


def at_wall(power, *, behind, size, falsely=0.0, pulls=False):
    """A body of this size (m) so far behind the wall, as a share of it, and as stiff whatever the size."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass=1.0, inertia=(size**2,) * 3), name="body")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame((0.0, size, 0.0)))
    free.position = (size, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    numbers = (50.0 * size ** (2.0 - power), power, (1.0 - behind) * size, falsely, float(pulls))
    scene.add_force(OwnLaw(scene.ground.frame(), body.frame((0.0, size, 0.0)), wall, numbers))
    return scene


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
def test_energies_of_laws_that_bend_or_jump_at_the_start_are_their_own(size):
    """Differences are known to their truncation and rounding: a force false by 1e-4 is told where it is smooth."""
    for power in (1.0, 1.5, 2.0, 3.0, 4.0):
        for behind in (-1e-3, -1e-5, -3e-6, 0.0, 1e-7, 3e-6, 1e-5, 1e-3, 0.3):
            at_wall(power, behind=behind, size=size).start()
    at_wall(3.0, behind=0.0, size=size, pulls=True).start()  # slopes on both sides are alike, and not that between
    for power in (1.0, 1.5, 2.0, 3.0):
        for falsely in (-1e-4, 1e-4):
            with pytest.raises(SceneError, match="is not that of the energy"):
                at_wall(power, behind=0.3, size=size, falsely=falsely).start()


@fm.compiled
def of_time(t):
    return t


def test_another_function_is_refused():
    with pytest.raises(SceneError, match=r"OwnLaw .*: of_time must be made by flexmbd.compiled of .* \(data, d"):
        flying(OwnLaw, of_time).simulate(0.1)
    with pytest.raises(SceneError, match="takes 8 arguments"):
        fm.compiled(lambda data, d, R, rate, spin, out, more, still: 0.0)
