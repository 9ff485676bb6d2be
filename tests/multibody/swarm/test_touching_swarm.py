"""Pseudo-rigid bodies that touch: momenta, energy, a bounce and an incline by closed forms, and what is refused."""

import numpy as np
import pytest
from scipy.linalg import expm

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

G = 9.81
GROUND = fm.System().ground
SIDE = 0.2
CUBE = fm.Solid.box((SIDE, SIDE, SIDE), density=2500.0)


def rotation(vector):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def points_of(n, rng):
    """Semi-axes (n, 3) and points (12, 3) of irregular stones."""
    axes = rng.uniform(0.08, 0.14, (n, 3))
    points = rng.normal(size=(n, 12, 3))
    return axes, list(axes[:, None] * points / np.linalg.norm(points, axis=2, keepdims=True))


def stones(n, *, seed=3, **changes):
    """Irregular stones, deformed, that fly towards the origin and spin; no gravity."""
    rng = np.random.default_rng(seed)
    axes, shapes = points_of(n, rng)
    given = {
        "law": contact.PowerLaw(k=1e5, restitution=0.5, speed=1.0),
        "friction": contact.Friction(mu=0.4, stiffness=8e4, damping=30.0, load=50.0),
        "damping": 1e-4,
        **changes,
    }
    solids = [fm.Solid.ellipsoid(0.8 * a, density=2500.0) for a in axes]
    places = np.array([(i, j, k) for i in range(3) for j in range(3) for k in range(3)])[:n] * 0.22
    many = fm.PseudoRigidSwarm(solids, fm.StVenantKirchhoff(2e6, 0.25), r=places, shapes=shapes, **given)
    many.F = rotation(rng.normal(size=(n, 3))) @ (np.eye(3) + 0.03 * rng.normal(size=(n, 3, 3)))
    many.F_rate = np.cross(rng.normal(scale=3.0, size=(n, 1, 3)), many.F.transpose(0, 2, 1)).transpose(0, 2, 1)
    many.v = -3.0 * (places - 0.22) + rng.normal(scale=0.3, size=(n, 3)) + [0.5, 0.0, 0.0]
    return many


@pytest.mark.parametrize("dissipative", [True, False])
def test_momenta_and_energy(dissipative):
    """27 stones that fly into each other: momenta to round-off; with what dissipates the energy never grows."""
    changes = {} if dissipative else {"law": contact.PowerLaw(k=1e5), "friction": None, "damping": 0.0}
    many = stones(27, **changes)
    h = 0.3 * many.stable_step()
    linear, angular, energy, touched = [], [], [], set()
    for _ in range(40):
        found = many.contacts()
        touched |= set(map(tuple, found.bodies))
        linear.append(many.linear_momentum().sum(axis=0))
        angular.append(many.angular_momentum().sum(axis=0))
        energy.append(many.energy().total.sum() + found.energy.sum())
        many.step(h, 100)
    size = np.linalg.norm(many.linear_momentum(), axis=1).sum()
    assert abs(np.array(linear) - linear[0]).max() < 1e-12 * size
    assert abs(np.array(angular) - angular[0]).max() < 1e-12 * size  # arms are less than 1 m
    assert len(touched) >= 20
    if dissipative:
        assert max(np.diff(energy)) < 1e-4 * energy[0]
        assert energy[-1] < 0.7 * energy[0]


def test_elastic_bounce():
    """A cube that falls flat and slowly: r and F_zz are two oscillators on four springs, in closed form."""
    k, E, v = 2e4, 1e6, 1e-4
    many = fm.PseudoRigidSwarm(
        [CUBE], fm.StVenantKirchhoff(E, 0.0), r=[(0.0, 0.0, SIDE / 2)], law=contact.PowerLaw(k=k),
        walls=[contact.HalfSpace(GROUND.frame())],
    )  # fmt: skip
    many.v = [(0.0, 0.0, -v)]
    m, J, half = CUBE.mass, CUBE.second[2, 2], SIDE / 2
    pull = 4 * k * np.array([[1.0, -half], [-half, half * half]])  # of r - half F_zz, by r and F_zz
    K = pull + np.diag([0.0, CUBE.volume * E])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(np.diag([m, J]), K), np.zeros((2, 2))]])
    t = 0.8 * np.pi * np.sqrt(m / (4 * k))
    exact = expm(t * A) @ [0.0, 0.0, -v, 0.0]
    assert exact[0] - half * exact[1] < 0.0  # it touches until then
    errors = []
    for count in (400, 800):
        many.r, many.v, many.F, many.F_rate = [(0, 0, half)], [(0, 0, -v)], [np.eye(3)], [np.zeros((3, 3))]
        many.step(t / count, count)
        found = [many.r[0, 2] - half, many.F[0, 2, 2] - 1.0, many.v[0, 2], many.F_rate[0, 2, 2]]
        errors.append(abs(np.array(found) / exact - 1.0).max())
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)


def test_restitution():
    """A stiff cube leaves as much of its speed as the law says; one that hardly deforms is a rigid one."""
    many = fm.PseudoRigidSwarm(
        [CUBE], fm.StVenantKirchhoff(5e7, 0.2), r=[(0.0, 0.0, SIDE / 2 + 1e-4)],
        law=contact.PowerLaw(k=2e4, restitution=0.4, speed=0.5), walls=[contact.HalfSpace(GROUND.frame())],
    )  # fmt: skip
    many.v = np.array([(0.0, 0.0, -0.5)])
    h = 0.2 * many.stable_step()
    while many.v[0, 2] < 0.0 or len(many.contacts().depth):
        many.step(h, 100)
    assert many.v[0, 2] / 0.5 == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize("slope", [0.4, 0.6])
def test_incline(slope):
    """Friction of 0.5 holds a cube on a slope of 0.4 without creep; on one of 0.6 it slides as Coulomb's law says."""
    mu, angle, k = 0.5, np.arctan(slope), 1e5
    weight = CUBE.mass * G
    R = rotation([0.0, angle, 0.0])
    depth = weight * np.cos(angle) / 4 / k
    many = fm.PseudoRigidSwarm(
        [CUBE], fm.StVenantKirchhoff(2e7, 0.2), r=[R @ (0.0, 0.0, SIDE / 2 - depth)], gravity=(0.0, 0.0, -G),
        law=contact.PowerLaw(k=k, restitution=0.3, speed=0.1), damping=1e-3,
        friction=contact.Friction(mu=mu, stiffness=k, damping=80.0, load=weight / 4),
        walls=[contact.HalfSpace(GROUND.frame(R=R))],
    )  # fmt: skip
    many.F = [R]
    h = 0.5 * many.stable_step()
    many.step(h, int(0.6 / h))
    r, v, t = many.r[0], many.v[0], many.t
    many.step(h, int(0.3 / h))
    down = R[:, 0]
    if slope < mu:
        assert abs(many.v).max() < 1e-4
        assert abs(many.r[0] - r).max() < 1e-6
        assert many.contacts().force.sum(axis=0) == pytest.approx([0.0, 0.0, weight], abs=2e-2 * weight)
    else:
        expected = G * (np.sin(angle) - mu * np.cos(angle))
        assert (many.v[0] - v) @ down / (many.t - t) == pytest.approx(expected, rel=0.01)


def test_shapes_are_carried():
    """Where stones with a deformation gradient touch is where stones of the deformed shapes do."""
    rng = np.random.default_rng(1)
    many = stones(27)
    many.F = many.F @ (np.eye(3) + 0.15 * rng.normal(size=(27, 3, 3)))
    many.r = 0.7 * many.r
    carried = many.contacts()
    shapes = [points @ F.T for points, F in zip(points_of(27, np.random.default_rng(3))[1], many.F, strict=True)]
    law = contact.PowerLaw(k=1e5)
    again = fm.PseudoRigidSwarm([CUBE] * 27, fm.StVenantKirchhoff(1e6, 0.2), r=many.r, shapes=shapes, law=law)
    laid = again.contacts()
    assert len(carried.depth) > 40
    assert (carried.bodies == laid.bodies).all()
    order = [np.lexsort((x.point.round(9)[:, 0], x.bodies[:, 1], x.bodies[:, 0])) for x in (carried, laid)]
    assert carried.point[order[0]] == pytest.approx(laid.point[order[1]], abs=1e-9)
    assert carried.normal[order[0]] == pytest.approx(laid.normal[order[1]], abs=1e-9)
    assert carried.depth[order[0]] == pytest.approx(laid.depth[order[1]], abs=1e-9)


def test_calls_do_not_matter():
    """One call or many, to the bit: bristles and near pairs are none of the calls'."""
    one, many = stones(27), stones(27)
    h = 0.3 * one.stable_step()
    one.step(h, 300)
    for count in (1, 99, 200):
        many.step(h, count)
        many.contacts()
    for name in ("r", "v", "F", "F_rate"):
        assert (getattr(one, name) == getattr(many, name)).all()
    assert (one.contacts().force == many.contacts().force).all()
    assert len(one.contacts().force)


def test_another_frame():
    """Seen from axes that lie askew the same happens."""
    R, p = rotation([0.7, -0.4, 1.1]), np.array([3.0, -2.0, 1.0])
    one, other = stones(8), stones(8)
    other.r, other.v = one.r @ R.T + p, one.v @ R.T
    other.F, other.F_rate = R @ one.F, R @ one.F_rate
    h = 0.3 * one.stable_step()
    for _ in range(3):
        one.step(h, 150)
        other.step(h, 150)
    assert len(one.contacts().force)
    assert other.r == pytest.approx(one.r @ R.T + p, abs=1e-9)
    assert other.F == pytest.approx(R @ one.F, abs=1e-7)


def test_wall_and_box_bear():
    """A cube between a floor and the lid of a polytope and a box that overlap it: forces as their depths say."""
    depth, k = 1e-3, 1e5
    lid = contact.Box(GROUND.frame((0.0, 0.0, 0.15 + SIDE - 2 * depth)), (1.0, 1.0, 0.3))
    floor = contact.ConvexPolytope(GROUND.frame(), contact.Box(GROUND.frame(), (1.0, 1.0, 0.3)).sides * np.array(
        [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-1.0, 0.0)]
    ))  # fmt: skip
    material = fm.StVenantKirchhoff(1e7, 0.2)
    law = contact.PowerLaw(k=k)
    many = fm.PseudoRigidSwarm([CUBE], material, r=[(0.0, 0.0, SIDE / 2 - depth)], law=law, walls=[lid, floor])
    found = many.contacts()
    assert sorted(map(tuple, found.bodies)) == [(0, -2)] * 4 + [(0, -1)] * 4
    assert found.depth == pytest.approx(depth, abs=1e-12)
    assert found.force[:, 2] == pytest.approx(np.where(found.bodies[:, 1] == -2, 1.0, -1.0) * k * depth, rel=1e-9)
    assert found.energy == pytest.approx(0.5 * k * depth**2, rel=1e-9)


def test_step_too_long():
    """A step that a contact cannot bear is refused with the longest one, and nothing has moved; that one goes."""
    many = fm.PseudoRigidSwarm(
        [CUBE] * 2, fm.StVenantKirchhoff(1e7, 0.2), r=[(0.0, 0.0, 0.11), (1.0, 0.0, 9.0)],
        law=contact.PowerLaw(k=1e10, p=2.0), walls=[contact.HalfSpace(GROUND.frame())],
    )  # fmt: skip
    many.v = np.array([(0.0, 0.0, -5.0)] * 2)
    h = 0.5 * many.stable_step()
    before = many.r, many.v, many.F, many.F_rate, many.t
    with pytest.raises(SceneError, match=r"body 0 .* 4 points touch it: the longest stable one is") as refused:
        many.step(h, 100)
    assert all(one is other for one, other in zip(before, (many.r, many.v, many.F, many.F_rate, many.t), strict=True))
    longest = float(str(refused.value).split("stable one is ")[1].split()[0])
    assert 0.0 < longest < h
    many.step(0.3 * longest, 50)
    many = stones(27)
    many.v = many.v + np.array([[900.0, 0.0, 0.0]])
    with pytest.raises(SceneError, match="may pass through"):
        many.step(0.25 * many.stable_step())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"law": contact.Hertz(E=1e7)}, "corners have no curvature"),
        ({"law": contact.PowerLaw(k=-1.0)}, "k"),
        ({"law": contact.PowerLaw(k=1e5, restitution=0.5, speed=None)}, "give its speed"),
        ({"friction": contact.Friction(0.5, 1e5, 10.0, 1.0, rolling=0.1)}, "rolling"),
        ({"law": None}, "give their law="),
        ({"shapes": [np.zeros((5, 3))]}, "in a plane"),
        ({"shapes": [np.eye(3)] * 2}, "give one a solid"),
        ({"damping": -1.0}, "not negative"),
        ({"walls": [GROUND.frame()]}, "a wall of a swarm must be"),
        ({"walls": contact.Sphere(fm.PointMass(1.0).frame(), 0.1)}, "not on the ground"),
        ({"law": None, "damping": 0.0, "walls": contact.HalfSpace(GROUND.frame())}, "give their law="),
        ({"friction": contact.Friction(mu=0.5, stiffness=0.0, damping=1.0, load=1.0)}, "stiffness"),
    ],
)
def test_wrong_arguments(changes, message):
    given = {"law": contact.PowerLaw(k=1e5), "damping": 1e-3, **changes}
    with pytest.raises(SceneError, match=message):
        fm.PseudoRigidSwarm([CUBE], fm.StVenantKirchhoff(1e7, 0.2), r=np.zeros((1, 3)), **given)


def test_free_bodies_have_no_contacts():
    many = fm.PseudoRigidSwarm([CUBE], fm.StVenantKirchhoff(1e7, 0.2), r=np.zeros((1, 3)))
    with pytest.raises(SceneError, match="do not touch"):
        many.contacts()
