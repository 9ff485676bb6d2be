"""Bodies with history that touch each other: nodes of one on facets of the other, in explicit steps."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.continuum.interior.facet_search import FacetSurface
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity

EXPLICIT = fm.CentralDifference()


def model(n, face, *, nu=0.3, cell="hexahedron", comm=MPI.COMM_SELF):
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=(n, n, n), cell=cell, comm=comm)
    material = hencky_plasticity.Parameters(1e6, nu, 1000.0, 1e9, hardening=j2_plasticity.LinearHardening(1e5))
    return NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface(face)])


class Stack:
    """Two cubes of 0.1 m and 1 kg, the upper one held by its top, the lower one by its bottom."""

    def __init__(self, divisions, *, offset=0.0, gap=0.0, mu=0.0, comm=MPI.COMM_SELF, **told):
        self.interiors = tuple(
            ExplicitContinuum(model(n, face, comm=comm, **told))
            for n, face in zip(divisions, ("z_max", "z_min"), strict=True)
        )
        self.scene = fm.System(team=MpiTeam(comm))
        self.bodies = tuple(
            self.scene.add(fm.ContinuumBody(interior), name=name)
            for interior, name in zip(self.interiors, ("upper", "lower"), strict=True)
        )
        self.places = np.array([[offset, 0.0, 0.1 + gap], [0.0, 0.0, 0.0]])
        upper, lower = self.bodies
        nodes, facets = fm.contact.Nodes(upper, "z_min"), fm.contact.SurfaceFacets(lower, "z_max")
        (self.contact,) = self.scene.touch(nodes, facets, fm.contact.Hard(mu=mu))

    def frame(self, k):
        own = self.interiors[k].frames[0]
        return self.scene.ground.frame(p=self.places[k] + own.p_BI_B), self.bodies[k].frame(own.name)

    def let_fly(self, velocity):
        for k, v in enumerate((velocity, np.zeros(3))):
            self.scene.connect(fm.joint.Free(), *self.frame(k)).velocity = [*v, 0.0, 0.0, 0.0]
        return self

    def momentum(self, run):
        """(6,) N s, N m s about the origin, at the end."""
        whole = np.zeros(6)
        for k, interior in enumerate(self.interiors):
            own, frame = interior.frames[0], self.frame(k)[1]
            R, w = run.rotation(frame)[-1], run.angular_velocity(frame)[-1]
            arm = R @ own.com
            p, v = run.position(frame)[-1] + arm, run.velocity(frame)[-1] + np.cross(w, arm)
            whole += interior.motion.momentum(np.zeros(3))
            whole += np.append(own.mass * v, own.mass * np.cross(p, v) + R @ own.inertia @ R.T @ w)
        return whole

    def energies(self, run):
        first, second = (run.energies(body) for body in self.bodies)
        return {name: first[name] + second[name] for name in first}


def test_two_cubes_that_hit_each_other_keep_momentum_and_energy():
    """Beside each other by a tenth, sliding, on unlike meshes: what is lost is of the method's order, 2."""
    lost, v = [], np.array([0.2, 0.0, -1.0])
    for h in (6e-4, 3e-4):
        stack = Stack((2, 3), offset=0.01, gap=1e-3, mu=0.2).let_fly(v)
        run = stack.scene.simulate(0.05, h=h, integrator=EXPLICIT)
        upper, lower = (run.outer_forces(body)[stack.contact.name] for body in stack.bodies)
        assert np.array_equal(upper, -lower)
        assert upper[:, 2].max() > 100.0
        whole, spin = stack.momentum(run), np.cross([0.06, 0.0, 0.101], v)
        assert abs(whole[:3] - v).max() < 1e-12
        assert abs(whole[3:] - spin).max() < 2e-3 * abs(spin).max()
        energies = stack.energies(run)
        total = sum(energies.values()) + run.energy().kinetic
        assert energies["friction"][-1] > 1e-3
        assert abs(energies["contact"][-1]) < 0.01 * total[0]
        lost.append(abs(total / total[0] - 1.0).max())
    assert lost[1] < 0.35 * lost[0] < 2e-3


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_friction_keeps_angular_momentum(cell):
    """Of two free cubes that rub on unlike meshes: what is lost is of the method's order, 2, however deep nodes are."""
    lost, v = [], np.array([1.0, 0.3, -1.0])
    for h in (2e-4, 1e-4):
        stack = Stack((2, 3), offset=0.01, gap=1e-3, mu=0.6, cell=cell).let_fly(v)
        run = stack.scene.simulate(0.03, h=h, integrator=EXPLICIT)
        force = run.outer_forces(stack.bodies[0])[stack.contact.name]
        assert abs(force[:, 0]).max() > 0.5 * force[:, 2].max() > 50.0
        lost.append(abs(stack.momentum(run) - [*v, *np.cross([0.06, 0.0, 0.101], v)]))
    linear, angular = ([part[k].max() for part in lost] for k in (slice(3), slice(3, 6)))
    assert linear[1] < max(0.3 * linear[0], 1e-13)
    assert angular[1] < 0.3 * angular[0] < 1e-6


def test_what_comes_from_beside_is_not_thrown_out():
    """Lower than the top of the other cube, whose sides are no part of the pair: nothing is pushed up."""
    stack = Stack((2, 2), offset=0.101, gap=-0.02).let_fly(np.array([-1.0, 0.0, 0.0]))
    run = stack.scene.simulate(0.02, integrator=EXPLICIT)
    assert not run.outer_forces(stack.bodies[0])[stack.contact.name].any()
    assert run.velocity(stack.frame(0)[1])[-1] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)


def test_cubes_and_their_contact_are_springs_in_series():
    """On like meshes, k of each node and that opposite in series: half of it; nu = 0, so that depths are the same."""
    stack, way = Stack((2, 2), nu=0.0), 1e-4
    stack.scene.connect(fm.joint.Fixed(), *stack.frame(1))
    rail = stack.scene.connect(fm.joint.Prismatic("z"), *stack.frame(0))
    t = np.linspace(0.0, 1.0, 41)
    rail.prescribe(fm.Table(t, -way * np.minimum(t / 0.8, 1.0) ** 2 * (3.0 - 2.0 * np.minimum(t / 0.8, 1.0))))
    run = stack.scene.simulate(1.0, integrator=EXPLICIT)
    force = run.outer_forces(stack.bodies[0])[stack.contact.name][run.t > 0.8]
    at_rest = stack.interiors[0].motion.step_at_rest
    spring = 0.25 * 0.5 / (1.0 - 0.5 / 4.0) / at_rest**2 / 2.0  # a quarter of the mass is at the face
    assert force[:, 2].mean() == pytest.approx(way / (2.0 * 0.1 / (1e6 * 0.1**2) + 1.0 / spring), rel=2e-3)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_where_points_are_before_a_plane_surface(cell):
    """Places hang on nodes so that they are right below the points; beyond the rim as well, half a facet far."""
    body = model(3, "z_min", cell=cell)
    surface, x = FacetSurface(body, "z_max"), body.layout.node_x
    corners, top = x[surface.own], x[abs(x[:, 2] - 0.05) < 1e-9]
    assert len(surface.number) == len(top) == 16
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.005, -0.055, 0.045], [0.105, 0.055, 0.0499], (50, 3))
    found = surface.find(points, corners)
    assert len(found.points) == 50
    assert found.depth == pytest.approx(0.05 - points[:, 2], abs=1e-12)
    assert abs(found.normal - [0.0, 0.0, 1.0]).max() < 1e-9
    below = np.einsum("nk,nka->na", found.weights, corners[found.nodes])
    assert abs(below[:, :2] - points[:, :2]).max() < 1e-12
    outside = (points[:, 0] < 0.0) | (points[:, 0] > 0.1) | (abs(points[:, 1]) > 0.05)
    assert np.array_equal(found.beside, outside)
    assert len(surface.find(points + np.array([0.05, 0.0, 0.0]), corners).points) < 50


def rubbing(*, comm=MPI.COMM_SELF, **told):
    stack = Stack((3, 2), offset=0.013, gap=1e-4, mu=0.3, comm=comm).let_fly(np.array([0.5, 0.1, -1.0]))
    return stack, stack.scene.simulate(0.03, integrator=EXPLICIT, **told)


def test_a_run_goes_on_to_the_bit_from_within_a_contact():
    stack, whole = rubbing(checkpoints=[6e-3])
    _, again = rubbing(restart=whole.checkpoints[0])
    assert np.array_equal(again.x[-1], whole.x[-1])
    force = whole.outer_forces(stack.bodies[0])[stack.contact.name]
    assert abs(force[whole.t < 6e-3][-1]).min() > 0.0


@pytest.mark.mpi
def test_all_ranks_together_do_what_one_does():
    one, all_of_them = rubbing()[1], rubbing(comm=MPI.COMM_WORLD)[1]
    assert abs(one.x[-1] - all_of_them.x[-1]).max() < 1e-8


def test_wrong_pairs_are_refused():
    stack, hard = Stack((1, 1)), fm.contact.Hard()
    upper, lower = stack.bodies
    with pytest.raises(SceneError, match="no group of facets 'top'"):
        fm.contact.SurfaceFacets(lower, "top")
    with pytest.raises(SceneError, match="does not touch itself yet"):
        stack.scene.touch(fm.contact.Nodes(upper, "x_min"), fm.contact.SurfaceFacets(upper, "x_max"), hard)
    with pytest.raises(SceneError, match="touch already"):
        stack.scene.touch(fm.contact.Nodes(upper, "z_min"), fm.contact.SurfaceFacets(lower, "z_max"), hard)
    nodes = fm.contact.Nodes(upper, "z_min", penalty=None)
    with pytest.raises(SceneError, match="without a penalty"):
        stack.scene.touch(nodes, fm.contact.SurfaceFacets(lower, "z_max"), hard)
    stack.let_fly(np.zeros(3))
    with pytest.raises(SceneError, match="touches a shape or a body that gives way"):
        stack.scene.simulate(1e-3, integrator=fm.CentralDifference(subcycle=True))
    overlapped = Stack((1, 1), gap=-0.01).let_fly(np.zeros(3))
    with pytest.raises(SceneError, match=r"z_min on lower\.z_max.*begins 0\.01 m inside"):
        overlapped.scene.simulate(1e-3, integrator=EXPLICIT)
