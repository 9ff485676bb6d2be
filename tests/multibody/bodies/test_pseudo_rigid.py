"""Pseudo-rigid bodies against the matrix equation of the homogeneous motion, closed forms and rigid bodies."""

import numpy as np
import polyhedra
import pytest
from homogeneous_motion import cross, motion, svk_stress

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

MATERIAL = fm.StVenantKirchhoff(E=1.0e5, nu=0.3)
BOX = fm.Solid.box((0.3, 0.1, 0.2), density=1000.0)
#: The same, its centre away from the axes' origin.
PLACED = fm.Solid(BOX.mass, BOX.volume, np.array([0.1, -0.2, 0.05]), BOX.second)
STRETCH = np.array([[1.2, 0.1, -0.05], [0.1, 0.9, 0.08], [-0.05, 0.08, 1.1]])
RATE = np.diag([0.3, 0.6, -0.3])
SPIN = np.array([3.0, -2.0, 5.0])
EIGHT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def flying(body, *, spin=SPIN, at=None, gravity=(0.0, 0.0, 0.0), speed=(1.0, 2.0, 3.0)):
    scene = fm.System(gravity=gravity)
    scene.add(body, name="block")
    place = body.solid.com if at is None else at
    joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame(place))
    joint.velocity = np.array([*speed, *spin])
    return scene


def rates(run, body):
    """Rates of F (nt, 3, 3), in inertial axes."""
    R = run.rotation(body.frame(body.solid.com))
    spin = np.array([cross(w) for w in run.angular_velocity(body.frame(body.solid.com))])
    U_rate = body.stretch_of(run.q_rate(body)) - np.eye(3)
    return spin @ run.deformation_gradient(body) + R @ U_rate


def angular_momentum(run, body):
    """(nt, 3) about the centre: the axial vector of F J F'^T."""
    product = run.deformation_gradient(body) @ body.solid.second @ rates(run, body).transpose(0, 2, 1)
    return np.stack([product[:, i, j] - product[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)


@pytest.mark.parametrize("solid", [BOX, PLACED], ids=["about the origin", "away from it"])
def test_free_flight(solid):
    """Large stretches and spin under gravity; the centre falls, F follows its own equation."""
    body = fm.PseudoRigidBody(solid, MATERIAL, stretch=STRETCH, stretch_rate=RATE)
    run = flying(body, gravity=(0.0, 0.0, -9.81)).simulate(0.3, rtol=1e-10, integrator=EIGHT)
    exact = motion(solid, lambda F: svk_stress(F, MATERIAL), STRETCH, cross(SPIN) @ STRETCH + RATE, run.t)
    F, centre = run.deformation_gradient(body), run.position(body.frame(solid.com))
    assert abs(F - exact).max() < 1e-9
    fall = np.outer(run.t, [1.0, 2.0, 3.0]) + np.outer(run.t**2, [0.0, 0.0, -0.5 * 9.81])
    assert centre == pytest.approx(fall, abs=1e-13)
    point = np.array([0.25, 0.0, 0.1])
    assert run.position(body.frame(point)) == pytest.approx(centre + F @ (point - solid.com), abs=1e-14)
    assert np.ptp(run.energy().total) < 1e-9 * run.energy().kinetic[0]
    # polar decomposition: what the machine's coordinates are
    R, U = fm.polar(F)
    assert run.rotation(body.frame()) == pytest.approx(R, abs=1e-13)
    assert run.stretch(body) == pytest.approx(U, abs=1e-13)


def test_momenta_of_free_flight():
    """To 1e-12: the linear one to round-off of any step, the angular one as the steps are short enough."""
    body = fm.PseudoRigidBody(BOX, MATERIAL, stretch=STRETCH, stretch_rate=RATE)
    run = flying(body).simulate(0.1, rtol=1e-13, integrator=EIGHT)
    linear = BOX.mass * run.velocity(body.frame(BOX.com))
    angular = angular_momentum(run, body)
    assert abs(linear - linear[0]).max() < 1e-12 * np.linalg.norm(linear[0])
    assert abs(angular - angular[0]).max() < 1e-12 * np.linalg.norm(angular[0])
    assert np.ptp(run.energy().total) < 1e-12 * run.energy().total[0]


def test_breathing_of_a_ball():
    """w^2 = 15 K / (rho a^2) with the bulk modulus K, and 10 mu / (rho a^2) without change of volume."""
    radius, density = 0.2, 1200.0
    body = fm.PseudoRigidBody(fm.Solid.ellipsoid([radius] * 3, density=density), MATERIAL)
    bulk, shear = MATERIAL.E / (3 * (1 - 2 * MATERIAL.nu)), MATERIAL.E / (2 * (1 + MATERIAL.nu))
    squares = np.array([*[10 * shear] * 5, 15 * bulk]) / (density * radius**2)
    assert (2 * np.pi * body.reduced().frequencies()) ** 2 == pytest.approx(squares, rel=1e-12)
    # and in time: a small breathing, a quarter of a period on
    body.stretch = (1.0 + 1e-6) * np.eye(3)
    quarter = 0.25 * 2 * np.pi / np.sqrt(squares[-1])
    run = flying(body, spin=np.zeros(3)).simulate(2 * quarter, rtol=1e-10, integrator=EIGHT)
    assert run.stretch(body, t=[quarter, 2 * quarter])[:, 0, 0] - 1.0 == pytest.approx([0.0, -1e-6], abs=2e-11)


def test_small_vibrations_of_any_body():
    """The nine squared frequencies of H'' J = -V C : H, three of them of rotations."""
    body = fm.PseudoRigidBody(BOX, MATERIAL)
    step, inverse = 1e-6, np.linalg.inv(BOX.second)
    columns = []
    for k in range(9):
        H = np.zeros(9)
        H[k] = step
        up, down = (svk_stress(np.eye(3) + sign * H.reshape(3, 3), MATERIAL) for sign in (1, -1))
        columns.append((BOX.volume * (up - down) / (2 * step) @ inverse).ravel())
    squares = np.sort(np.linalg.eigvals(np.array(columns).T).real)
    assert (2 * np.pi * body.reduced().frequencies()) ** 2 == pytest.approx(squares[3:], rel=1e-6)


def test_hung_by_a_corner():
    """A spherical joint at a point that deforms: x = F (X - X0), F'' J0 = -V dW/dF + m g (C - X0)^T."""
    corner, g = np.array([0.15, 0.05, 0.1]), np.array([0.0, 0.0, -9.81])
    body = fm.PseudoRigidBody(BOX, MATERIAL)
    scene = fm.System(gravity=g)
    scene.add(body, name="block")
    hook = scene.connect(fm.joint.Spherical(), scene.ground.frame(corner), body.frame(corner))
    run = scene.simulate(0.25, rtol=1e-9, integrator=EIGHT)
    second = BOX.second + BOX.mass * np.outer(corner, corner)
    load = BOX.mass * np.outer(g, -corner)
    exact = motion(
        BOX, lambda F: svk_stress(F, MATERIAL), np.eye(3), np.zeros((3, 3)), run.t, second=second, load=load
    )
    assert abs(run.deformation_gradient(body) - exact).max() < 1e-7
    assert abs(exact[-1] - exact[0]).max() > 0.5
    assert abs(run.position(body.frame(corner)) - corner).max() < 1e-10
    # the hook bears the weight less what accelerates
    pull = BOX.mass * (run.acceleration(body.frame(BOX.com)) - g)
    in_world = np.einsum("tij,tj->ti", run.rotation(body.frame(corner)), run.reaction(hook)[:, :3])
    assert in_world == pytest.approx(pull, abs=1e-6 * BOX.mass * 9.81)


def arm(body):
    """Hinged at the origin to the ground, with a mass on its far end by a second hinge."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    scene.add(body, name="arm")
    bob = scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3), (0.1, 0.0, 0.0)), name="bob")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame())
    scene.connect(fm.joint.Revolute("z"), body.frame((0.3, 0.0, 0.0)), bob.frame())
    return scene, bob


def test_held_stretches_are_a_rigid_body():
    placed = fm.Solid(BOX.mass, BOX.volume, np.array([0.15, 0.0, 0.0]), BOX.second)
    runs = []
    for body in (fm.PseudoRigidBody(placed, MATERIAL, rigid=True), fm.RigidBody.from_solid(placed)):
        scene, bob = arm(body)
        runs.append(scene.simulate(0.3, rtol=1e-8, integrator=EIGHT).position(bob.frame()))
    np.testing.assert_array_equal(*runs)
    held = fm.PseudoRigidBody(placed, MATERIAL, rigid=True)
    run = flying(held).simulate(0.1, rtol=1e-8)
    assert np.linalg.det(run.deformation_gradient(held)) == pytest.approx(1.0, abs=1e-14)
    assert "pseudo-rigid, its stretches held" in flying(fm.PseudoRigidBody(BOX, MATERIAL, rigid=True)).explain()


def test_rigid_limit_as_stiffness_grows():
    """A spinning block: where it is after a while differs from the rigid one's place by a share of 1 / E."""
    start = fm.RigidBody.from_solid(BOX)
    end = flying(start, at=np.zeros(3)).simulate(0.3, rtol=1e-11, integrator=EIGHT).rotation(start.frame())[-1]
    errors = []
    for stiffness in (1e7, 1e8):
        body = fm.PseudoRigidBody(BOX, fm.StVenantKirchhoff(stiffness, 0.3), damping=0.3)
        run = flying(body).simulate(0.3, rtol=1e-9, integrator=EIGHT)
        errors.append([abs(run.rotation(body.frame())[-1] - end).max(), abs(run.stretch(body)[-1] - np.eye(3)).max()])
    assert np.divide(*errors) == pytest.approx([10.0, 10.0], rel=0.02)


def test_a_mesh_is_what_it_encloses():
    """A prism of triangles, its second moments those of the polyhedron."""
    volume, across, along = polyhedra.prism_moments(5, 0.2, 0.7)
    body = fm.PseudoRigidBody(fm.Solid.from_surface(*polyhedra.prism(5, 0.2, 0.7), density=900.0), MATERIAL)
    lam, mu = MATERIAL.lame
    mass = 900.0 * np.array([across, across, along])
    stiffness = volume * (lam * np.ones((3, 3)) + 2 * mu * np.eye(3))
    squares = [*np.linalg.eigvals(stiffness / mass), *(4 * mu * volume / (mass[i] + mass[i - 1]) for i in range(3))]
    assert body.reduced().stiffness == pytest.approx(np.sort(squares), rel=1e-9)


def test_pressed_flat():
    """Two forces press a block of a material that gives way; what was before is kept."""
    body = fm.PseudoRigidBody(BOX, MATERIAL, damping=0.5)
    scene = fm.System()
    scene.add(body, name="block")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    for side in (-1.0, 1.0):
        end = body.frame((side * 0.15, 0.0, 0.0))
        scene.add_force(fm.force.FrameForce(end, force=(-side * 2000.0, 0.0, 0.0)))
    with pytest.raises(SimulationError, match=r"'block' has det F = -.* at t = 0\.0.* s: it is pressed flat") as caught:
        scene.simulate(1.0, rtol=1e-6, integrator=EIGHT)
    left = caught.value.trajectory
    assert (np.linalg.det(left.stretch(body)) > 0.0).all()
    assert len(left.t) > 5
    assert left.t[-1] < 0.1
    assert len(left.energy().total) == len(left.t)


def test_polar():
    F = np.random.default_rng(1).normal(size=(50, 3, 3))
    F[np.linalg.det(F) < 0] *= -1.0
    R, U = fm.polar(F)
    assert pytest.approx(F, abs=1e-13) == R @ U
    assert R @ R.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (50, 1, 1)), abs=1e-13)
    assert (np.linalg.eigvalsh(U) > 0.0).all()
    with pytest.raises(SceneError, match=r"det F = -1 must be positive"):
        fm.polar(np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(SceneError, match="det F = 0"):
        fm.polar(np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(SceneError, match="shape"):
        fm.polar(np.ones(3))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"stretch": np.diag([1.0, 1.0, -0.1])}, r"positive definite \(det F > 0\), its least value is -0.1"),
        ({"stretch": -np.eye(3)}, "positive definite"),
        ({"stretch": np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1.0]])}, r"symmetric; .* fm.polar\(F\)"),
        ({"stretch": np.ones(3)}, r"shape \(3, 3\)"),
        ({"stretch_rate": np.full((3, 3), np.nan)}, "finite"),
        ({"damping": -0.1}, "damping must not be negative"),
        ({"rigid": True, "stretch": STRETCH}, "it is rigid, so that stretch must be one"),
    ],
)
def test_starts_that_no_body_has(wrong, says):
    with pytest.raises(SceneError, match=says):
        fm.PseudoRigidBody(BOX, MATERIAL, **wrong)


def test_a_start_that_is_spoilt_later_is_named():
    body = fm.PseudoRigidBody(BOX, MATERIAL)
    scene = flying(body)
    body.stretch = np.diag([1.0, 1.0, 0.0])
    with pytest.raises(SceneError, match="pseudo-rigid body 'block': stretch must be positive definite"):
        scene.simulate(0.1)


@pytest.mark.parametrize(("E", "nu"), [(0.0, 0.3), (-1.0, 0.3), (np.nan, 0.3), (1e5, 0.5), (1e5, -1.0), (1e5, np.nan)])
def test_materials_that_are_none(E, nu):
    with pytest.raises(SceneError, match=r"St Venant-Kirchhoff: (E must be positive|nu must lie)"):
        fm.StVenantKirchhoff(E, nu)
