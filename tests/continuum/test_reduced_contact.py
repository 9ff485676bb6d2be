"""Surfaces of bodies with history that touch reduced bodies, in explicit and implicit steps."""

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact, forms, meshes
from flexmbd.continuum import (
    ContinuumModel,
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
)
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.reduction import Keep, Patch, Pressure, craig_bampton

EXPLICIT, IMPLICIT = fm.CentralDifference(), fm.GeneralizedAlpha()
SIDES = (0.4, 0.1, 0.05)
RUBBER = forms.solid_linear.Parameters(E=1e7, nu=0.3, rho=1000.0)
V = np.array([0.3, 0.1, -1.0])
pytestmark = pytest.mark.filterwarnings("ignore:.*which lock")


def beam_mesh():
    return meshes.block(*SIDES, divisions=(8, 2, 2), comm=MPI.COMM_SELF)


@cache
def record(modes=20, frame="x_min"):
    """A beam of 2 kg along x, whose top may be touched beyond 0.05 m."""
    model = ContinuumModel(beam_mesh(), forms.solid_linear, RUBBER, degree=1, interfaces=[Interface("x_min")])
    top = Patch("top", size=0.05, facets=lambda x: (x[2] > 0.0249) & (x[0] > 0.049))
    return craig_bampton(model, modes=modes, frame=frame, contact=[top], keep=Keep(modes=True, surface=True))


def block(kind=ExplicitContinuum, *, E=1e6, nu=0.3, yields=1e9, comm=MPI.COMM_SELF, side=0.08, n=2):
    """A cube of 0.08 m and 0.512 kg that is held by its top."""
    mesh = meshes.block(side, side, side, divisions=(n, n, n), comm=comm)
    material = hencky_plasticity.Parameters(E, nu, 1000.0, yields, hardening=j2_plasticity.LinearHardening(1e5))
    return kind(NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface("z_max")]))


class Drop:
    """The cube above the beam, 1 mm from it."""

    start = np.array([0.25, 0.01, 0.066])

    def __init__(self, interior, body, facets, *, root, flies=False, mu=0.0, v=V, team=None, **told):
        self.interior = interior
        self.scene = fm.System() if team is None else fm.System(team=team)
        self.beam = self.scene.add(body, name="beam")
        self.block = self.scene.add(fm.ContinuumBody(interior), name="block")
        joint = fm.joint.Free() if flies else fm.joint.Fixed()
        self.at = self.beam.frame("x_min")
        self.scene.connect(joint, self.scene.ground.frame(p=root), self.at)
        at = self.scene.ground.frame(p=self.start + interior.frames[0].p_BI_B)
        self.scene.connect(fm.joint.Free(), at, self.block.frame("z_max")).velocity = [*v, 0.0, 0.0, 0.0]
        nodes = contact.Nodes(self.block, "z_min", **told)
        (self.contact,) = self.scene.touch(nodes, contact.SurfaceFacets(self.beam, facets), contact.Hard(mu=mu))

    @classmethod
    def on_reduced(cls, interior, body=None, **told):
        body = body or record()
        return cls(interior, fm.FlexibleBody(body), "top", root=np.zeros(3), **told)

    def force(self, run):
        return run.outer_forces(self.block)[self.contact.name]

    def momentum(self, run):
        """(6,) N s, N m s about the origin, of the cube and the reduced beam at the end."""
        own, frame = self.interior.frames[0], self.block.frame("z_max")
        R, w = run.rotation(frame)[-1], run.angular_velocity(frame)[-1]
        p, v = run.position(frame)[-1] + R @ own.com, run.velocity(frame)[-1] + np.cross(w, R @ own.com)
        whole = self.interior.motion.momentum(np.zeros(3))
        whole += np.append(own.mass * v, own.mass * np.cross(p, v) + R @ own.inertia @ R.T @ w)
        gram, frame = self.beam.record.gram, self.beam.frame()
        p, R = run.position(frame)[-1], run.rotation(frame)[-1]
        v, w = R.T @ run.velocity(frame)[-1], R.T @ run.angular_velocity(frame)[-1]
        place, speed = np.zeros((2, 3, len(gram)))
        for k in range(3):
            place[k, 1 + k], place[k, 4 + k :: 3] = 1.0, run.q(self.beam)[-1]
            speed[k, 4 + k :: 3] = run.q_rate(self.beam)[-1]
        speed += np.cross(w, place.T).T
        speed[:, 0] += v
        linear, moment = R @ speed @ gram[0], place @ gram @ speed.T
        spin = R @ (moment - moment.T)[[1, 2, 0], [2, 0, 1]]
        return whole + np.append(linear, spin + np.cross(p, linear))


def test_a_yielding_block_and_a_flying_beam_keep_momentum_and_energy():
    """What is lost is of the method's order, 2: the beam's frame is not at its centre of mass."""
    lost, spin = [], 0.512 * np.cross(Drop.start + np.array([0.04, 0.0, 0.0]), V)
    for h in (2e-4, 1e-4):
        drop = Drop.on_reduced(block(yields=2e4), flies=True, mu=0.3)
        run = drop.scene.simulate(0.05, h=h, integrator=EXPLICIT)
        force, energies = drop.force(run), run.energies(drop.block)
        assert force[:, 2].max() > 100.0
        assert energies["plastic"][-1] > 1e-3
        assert energies["friction"][-1] > 2e-3
        total = sum(energies.values()) + run.energy().total
        whole = drop.momentum(run)
        lost.append([abs(whole[:3] - 0.512 * V).max(), abs(whole[3:] - spin).max(), abs(total / total[0] - 1.0).max()])
    assert np.array(lost[0]) == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    assert (np.array(lost[1]) < 0.3 * np.array(lost[0])).all()


def test_linear_momentum_is_kept_to_round_off_where_a_frame_is_at_the_centre():
    drop = Drop.on_reduced(block(), record(12, None), flies=True, mu=0.3)
    run = drop.scene.simulate(0.02, integrator=EXPLICIT)
    assert drop.force(run)[:, 2].max() > 100.0
    assert abs(drop.momentum(run)[:3] - 0.512 * V).max() < 1e-10


def test_a_reduced_beam_does_what_the_same_beam_with_history_does():
    """By the impulse, with cells in the block as stiff; contact is that of springs in series with one of both."""
    impulses = []
    for modes in (20, 40):
        drop = Drop.on_reduced(block(E=1e7), record(modes), v=[0.0, 0.0, -1.0])
        run = drop.scene.simulate(0.01, h=5e-5, integrator=EXPLICIT)
        impulses.append(np.trapezoid(drop.force(run)[:, 2], run.t))
    material = hencky_plasticity.Parameters(1e7, 0.3, 1000.0, 1e12, hardening=j2_plasticity.LinearHardening(1e5))
    full = NonlinearModel(beam_mesh(), hencky_plasticity, material, degree=1, interfaces=[Interface("x_min")])
    interior = ExplicitContinuum(full)
    drop = Drop(
        block(E=1e7), fm.ContinuumBody(interior), "z_max", root=interior.frames[0].p_BI_B, v=[0.0, 0.0, -1.0]
    )
    run = drop.scene.simulate(0.01, h=5e-5, integrator=EXPLICIT)
    whole = np.trapezoid(drop.force(run)[:, 2], run.t)
    assert impulses[1] == pytest.approx(impulses[0], rel=5e-3)
    assert impulses[1] == pytest.approx(whole, rel=0.02)


@cache
def foot(n):
    """A cube of 0.08 m without cross contraction that stands on the ground; how a pressure shortens it is a mode."""
    mesh = meshes.block(0.08, 0.08, 0.08, divisions=(n, n, n), comm=MPI.COMM_SELF)
    material = forms.solid_linear.Parameters(E=1e6, nu=0.0, rho=1000.0)
    model = ContinuumModel(mesh, forms.solid_linear, material, degree=1, interfaces=[Interface("z_min")])
    told = {"frame": "z_min", "contact": [Patch("z_max", size=0.05)], "keep": Keep(modes=True)}
    return craig_bampton(model, modes=6, loads=[Pressure("p", "z_max")], residual_vectors=True, **told)


def pressing(kind, n_foot, way, **told):
    """N, by which a cube is held that is pressed on another one like it."""
    interior, body = block(kind, nu=0.0), foot(n_foot)
    scene = fm.System()
    lower, upper = scene.add(fm.FlexibleBody(body), name="lower"), scene.add(fm.ContinuumBody(interior), name="upper")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(0.04, 0.0, -0.04)), lower.frame("z_min"))
    at = scene.ground.frame(p=interior.frames[0].p_BI_B + np.array([0.0, 0.0, 0.08]))
    rail = scene.connect(fm.joint.Prismatic("z"), at, upper.frame("z_max"))
    t = np.minimum(np.linspace(0.0, 1.0, 41) / 0.6, 1.0)
    rail.prescribe(fm.Table(np.linspace(0.0, 0.25, 41), -way * t**2 * (3.0 - 2.0 * t)))
    nodes = contact.Nodes(upper, "z_min", **told)
    (pair,) = scene.touch(nodes, contact.SurfaceFacets(lower, "z_max"), contact.Hard())
    steps = {"h": 0.0125} if kind is ImplicitContinuum else {}
    run = scene.simulate(0.25, integrator=IMPLICIT if kind is ImplicitContinuum else EXPLICIT, **steps)
    force = run.outer_forces(upper)[pair.name][run.t > 0.18]
    assert abs(force[:, :2]).max() < 1e-5 * force[:, 2].max()
    return force[:, 2].mean(), interior


def test_cubes_and_their_contact_are_springs_in_series():
    """Stress is uniform where meshes agree; where they do not, nodes on facets of unlike size pass it within 3 %."""
    way, columns = 1e-4, 2.0 * 0.08 / (1e6 * 0.08**2)
    force, interior = pressing(ExplicitContinuum, 2, way)
    spring = 0.25 * 0.512 * 0.5 / (1.0 - 0.5 / 4.0) / interior.motion.step_at_rest**2  # a quarter of it is at the face
    assert force == pytest.approx(way / (columns + 1.0 / spring), rel=3e-3)
    for n_foot, off in ((2, 1e-3), (3, 0.03)):
        soft, hard = (way / pressing(ImplicitContinuum, n_foot, way, stiffness_ratio=k)[0] for k in (10.0, 20.0))
        assert 2.0 * hard - soft == pytest.approx(columns, rel=off)


SCHEME, H = Scheme(1.0 / 3.0, 4.0 / 9.0, 25.0 / 81.0, 11.0 / 18.0), 2e-3


class Motions:
    """Of the cube's frame and those of the beam at the end of a step that presses them together, and near these."""

    def __init__(self, interior, frames):
        rng = np.random.default_rng(3)
        n = 1 + frames
        zero = np.zeros((n, 3))
        p = np.vstack([Drop.start - [0.02, 0.0, 1e-3] + interior.frames[0].p_BI_B, zero[1:]])
        self.start = FrameMotion(p, np.tile(np.eye(3), (n, 1, 1)), zero, zero, zero, zero)
        turn = 0.01 * rng.normal(size=(2, 3))
        self._R = Rotation.from_rotvec(turn[[0] + [1] * frames]).as_matrix()
        self._p = p + np.array([[0.0, 0.0, -2e-3]] + [[1.5e-3, 0.0, 1e-3]] * frames)
        self._p[2:] += 1e-4 * rng.normal(size=(n - 2, 3))
        self._rest = 0.5 * rng.normal(size=(4, n, 3))

    def at(self, y):
        move, turn = np.split(y.reshape(-1, 6), 2, axis=1)
        per_x, per_v = SCHEME.slopes(H)
        v, w, a, alpha = self._rest
        speed, R = per_v / per_x, Rotation.from_rotvec(turn).as_matrix() @ self._R
        return FrameMotion(
            self._p + move, R, v + speed * move, w + speed * turn, a + move / per_x, alpha + turn / per_x
        )


@pytest.mark.parametrize("mu", [0.0, 0.05, 5.0])
def test_the_derivative_of_the_wrenches_knows_facets_that_move(mu):
    """Exact where frames carry the cube; facets' edges, at which places jump, are left to iterations."""
    interior, scene = block(ImplicitContinuum), fm.System()
    part, beam = scene.add(fm.ContinuumBody(interior), name="block"), scene.add(fm.FlexibleBody(record(6)), name="beam")
    (pair,) = scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(beam, "top"), contact.Hard(mu=mu))
    interior.meet_reduced([pair.reduced()])
    motions = Motions(interior, len(pair.reduced().frames))
    interior.begin(0.0, motions.start, np.zeros(3))
    unit = np.eye(6 * len(motions.start.p))
    wrenches, slopes = interior.trial(H, H, SCHEME, motions.at(0.0 * unit[0]))
    assert wrenches[0, 2] > 100.0
    step, found = 1e-7, np.zeros_like(slopes)
    for j, y in enumerate(unit):
        there, back = (interior.trial(H, H, SCHEME, motions.at(sign * step * y))[0] for sign in (1.0, -1.0))
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    off, size = abs(found - slopes), abs(slopes).max()
    assert off[:6, :6].max() < 2e-6 * size
    assert off.max() < 5e-3 * size
    assert abs(slopes[12:, 12:]).max() > 0.1 * size


def test_a_rejected_step_leaves_no_trace():
    """Places near facets' edges, which it found on others."""
    interior, scene = block(ImplicitContinuum, n=4), fm.System()
    part, beam = scene.add(fm.ContinuumBody(interior), name="block"), scene.add(fm.FlexibleBody(record(6)), name="beam")
    (pair,) = scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(beam, "top"), contact.Hard(mu=0.3))
    interior.meet_reduced([pair.reduced()])
    motions = Motions(interior, len(pair.reduced().frames))
    still = np.zeros(6 * len(motions.start.p))
    aside = still.copy()
    aside[:2] = 1.5e-3
    interior.begin(0.0, motions.start, np.zeros(3))
    wanted = interior.trial(H, H, SCHEME, motions.at(still))[0]
    interior.revert()
    interior.trial(H, H, SCHEME, motions.at(aside))
    interior.revert()
    assert np.array_equal(interior.trial(H, H, SCHEME, motions.at(still))[0], wanted)


def hitting(kind, *, team=None, comm=MPI.COMM_SELF, h=None, **told):
    drop = Drop.on_reduced(block(kind, n=3, comm=comm), record(6), team=team, mu=0.3)
    integrator = IMPLICIT if kind is ImplicitContinuum else EXPLICIT
    steps = {} if h is None else {"h": h}
    return drop, drop.scene.simulate(0.006, integrator=integrator, **steps, **told)


def test_implicit_steps_do_what_explicit_ones_do():
    """Ten times a node's stiffness is more than explicit steps bear; the highest penalty is near."""
    impulses = []
    for kind, told in ((ExplicitContinuum, {"penalty": 2.9}), (ImplicitContinuum, {})):
        drop = Drop.on_reduced(block(kind), mu=0.3, **told)
        integrator = EXPLICIT if kind is ExplicitContinuum else IMPLICIT
        run = drop.scene.simulate(0.03, integrator=integrator, **({} if kind is ExplicitContinuum else {"rtol": 1e-3}))
        impulses.append(np.trapezoid(drop.force(run), run.t, axis=0)[2])
        total = sum(run.energies(drop.block).values()) + run.energy().total
        assert abs(total / total[0] - 1.0).max() < 0.01
    assert impulses[1] == pytest.approx(impulses[0], rel=0.05)


@pytest.mark.parametrize(("kind", "h"), [(ExplicitContinuum, None), (ImplicitContinuum, 5e-4)])
def test_a_run_goes_on_to_the_bit_from_within_a_contact(kind, h):
    drop, whole = hitting(kind, h=h, checkpoints=[3e-3])
    _, again = hitting(kind, h=h, restart=whole.checkpoints[0])
    assert np.array_equal(again.x[-1], whole.x[-1])
    assert abs(drop.force(whole)[whole.t < 3e-3][-1]).min() > 0.0


@pytest.mark.mpi
@pytest.mark.parametrize(("kind", "h"), [(ExplicitContinuum, None), (ImplicitContinuum, 5e-4)])
def test_all_ranks_together_do_what_one_does(kind, h):
    drop, one = hitting(kind, h=h)
    both, all_of_them = hitting(kind, h=h, team=MpiTeam(MPI.COMM_WORLD), comm=MPI.COMM_WORLD)
    assert abs(one.x[-1] - all_of_them.x[-1]).max() < 1e-8
    assert abs(drop.force(one)[-1] - both.force(all_of_them)[-1]).max() < 1e-5 * abs(drop.force(one)).max()


def test_wrong_surfaces_are_refused():
    interior, scene = block(), fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="block")
    plain = replace(record(6), contact=None, surface=None)
    with pytest.raises(SceneError, match=r"facets 'top' of body 'beam'.*craig_bampton\(..., contact=\[Patch\('top'"):
        contact.SurfaceFacets(fm.FlexibleBody(plain, name="beam"), "top")
    with pytest.raises(SceneError, match=r"keeps no boundary.*keep=Keep\(surface=True\)"):
        contact.SurfaceFacets(fm.FlexibleBody(plain, name="beam"))
    with pytest.raises(SceneError, match="no surface 'lid'; it has 'top'"):
        contact.SurfaceFacets(fm.FlexibleBody(record(6)), "lid")
    with pytest.raises(SceneError, match=r"no modes at their nodes.*keep=Keep\(modes=True\)"):
        contact.SurfaceFacets(fm.FlexibleBody(replace(record(6), modes=None)), "top")
    beam, hard = scene.add(fm.FlexibleBody(record(6)), name="beam"), contact.Hard()
    with pytest.raises(SceneError, match=r"or fm\.contact\.SurfaceFacets\(body, surface\)"):
        scene.touch(contact.Nodes(part, "z_min"), beam, hard)
    with pytest.raises(SceneError, match="without a penalty"):
        scene.touch(contact.Nodes(part, "z_min", penalty=None), contact.SurfaceFacets(beam, "top"), hard)
    stranger = fm.FlexibleBody(record(6), name="stranger")
    with pytest.raises(SceneError, match="'stranger': the body is not in this scene"):
        scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(stranger, "top"), hard)
    scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(beam, "top"), hard)
    with pytest.raises(SceneError, match="touch already"):
        scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(beam, "top"), hard)
    inside = Drop.on_reduced(block(), v=[0.0, 0.0, 0.0])
    inside.scene.touch(contact.Nodes(inside.block, "z_max"), contact.SurfaceFacets(inside.beam), hard)
    with pytest.raises(SceneError, match="touches a shape or a body that gives way"):
        inside.scene.simulate(1e-3, integrator=fm.CentralDifference(subcycle=True))


@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_a_body_that_begins_inside_is_refused(kind):
    drop = Drop.on_reduced(block(kind), v=[0.0, 0.0, 0.0])
    low = Drop.start - [0.0, 0.0, 6e-3]
    at = drop.scene.ground.frame(p=low + drop.interior.frames[0].p_BI_B)
    scene = fm.System()
    beam = scene.add(fm.FlexibleBody(record()), name="beam")
    part = scene.add(fm.ContinuumBody(block(kind)), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("x_min"))
    scene.connect(fm.joint.Free(), scene.ground.frame(p=at.p_BF_B), part.frame("z_max"))
    scene.touch(contact.Nodes(part, "z_min"), contact.SurfaceFacets(beam, "top"), contact.Hard())
    with pytest.raises(SceneError, match=r"z_min on beam\.top.*begins 0\.005 m inside"):
        scene.simulate(1e-3)
