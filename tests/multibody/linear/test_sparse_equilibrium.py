"""Equilibria of machines of many bodies by their sparse stiffness: closed forms, and the dense way."""

import itertools

import numpy as np
import pytest
import scipy
from spring_lattice import linked_pendulums, spring_lattice

import flexmbd as fm
from flexmbd.multibody.kernels.base import compiling
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.linear import equilibrium, sparse_equilibrium
from flexmbd.multibody.linear.derivatives import DERIVING
from flexmbd.multibody.plan.sparse_stiffness import SparseStiffness, sparse_stiffness


@pytest.fixture
def ways(monkeypatch):
    """How often the sparse way found what was asked for, and how often not."""
    found = []

    def told(*arguments):
        answer = sparse_equilibrium.stable_equilibrium(*arguments)
        found.append(answer is not None)
        return answer

    monkeypatch.setattr(equilibrium, "stable_equilibrium", told)
    return found


def dense(monkeypatch, scene, **named):
    """The equilibrium by dense matrices."""
    with monkeypatch.context() as patch:
        patch.setattr(equilibrium, "stable_equilibrium", lambda *_: None)
        return scene.equilibrium(**named)


def test_a_hanging_chain(ways):
    """Each spring carries what hangs on it."""
    count, m, k, g, length = 60, 0.7, 250.0, 9.81, 0.3
    scene, above, bodies = fm.System(gravity=(0.0, 0.0, -g)), None, []
    for n in range(count):
        body = scene.add(fm.RigidBody(m, (1e-3, 1e-3, 1e-3)), name=f"mass {n}")
        scene.connect(fm.joint.Generic("xyz"), scene.ground.frame((0, 0, -length * (n + 1))), body.frame())
        upper = scene.ground.frame() if above is None else above.frame()
        scene.add_force(fm.force.SpringDamper(upper, body.frame(), k, length))
        bodies.append(body)
        above = body
    found = scene.equilibrium()
    assert ways == [True]
    stretched = length + (count - np.arange(count)) * m * g / k
    places = [found.position(body.frame())[2] for body in bodies]
    np.testing.assert_allclose(places, -np.cumsum(stretched), rtol=1e-12)
    assert (found.unstable, found.neutral) == (0, ())


def flat_string(count, *, mass=0.2, stiffness=3e3, length=0.5, gravity=9.81, slack=0.0):
    """Points on springs from wall to wall along a level line, in their lengths but for a share of slack; frames."""
    scene, frames = fm.System(gravity=(0.0, -gravity, 0.0)), []
    for n in range(count):
        frames.append(scene.add(fm.PointMass(mass)).frame())
        plane = scene.connect(fm.joint.PlanarPoint("z"), scene.ground.frame(), frames[-1])
        plane.position = ((n + 1) * length, 0.0)
    ends = [scene.ground.frame(), *frames, scene.ground.frame(((count + 1) * length, 0.0, 0.0))]
    for one, other in itertools.pairwise(ends):
        scene.add_force(fm.force.SpringDamper(one, other, stiffness, (1.0 + slack) * length))
    return scene, frames


@pytest.mark.parametrize(
    ("count", "gravity", "slack", "sparse"),
    [
        (45, 9.81, 0.0, False),
        (70, 9.81, 0.0, True),
        (70, 9.81e-3, 0.0, True),
        (200, 300.0, 0.0, True),
        (60, 9.81, 0.02, False),  # pressed straight it is unstable
    ],
)
def test_a_flat_string_hangs_in_a_polygon(ways, count, gravity, slack, sparse):
    """Nothing resists its weight at first; then all springs pull the walls alike."""
    mass, stiffness, length = 0.2, 3e3, 0.5
    scene, frames = flat_string(count, gravity=gravity, slack=slack)
    down = mass * gravity * (0.5 * count - np.arange(count + 1))

    def stretched(across):
        pull = np.hypot(across, down)
        return np.stack([np.full(count + 1, across), -down]) / pull * ((1.0 + slack) * length + pull / stiffness)

    span = (count + 1) * length
    least, most = 1e-9 * down[0], 100.0 * down[0]
    across = scipy.optimize.brentq(lambda one: stretched(one)[0].sum() - span, least, most, xtol=1e-15)
    expected = np.cumsum(stretched(across), axis=1)[:, :-1].T
    found = scene.equilibrium()
    assert ways == [sparse]
    np.testing.assert_allclose([found.position(frame)[:2] for frame in frames], expected, rtol=0, atol=1e-9 * span)
    assert (found.unstable, found.neutral) == (0, ())


@pytest.mark.parametrize("seed", range(3))
def test_flat_nets_as_by_dense_matrices(ways, monkeypatch, seed):
    """Without tension or with little, in space, some nodes tied in pairs by rods; under weights that differ."""
    rng = np.random.default_rng(seed)
    scene, frames, (nx, ny), tension = fm.System(gravity=(0.0, 0.0, -9.81)), {}, (7, 7), (0.0, 1e-4, 0.0)[seed]
    for i, j in itertools.product(range(nx), range(ny)):
        frames[i, j] = scene.add(fm.PointMass(rng.uniform(0.1, 1.0))).frame()
        scene.connect(fm.joint.Translation(), scene.ground.frame(), frames[i, j]).position = (float(i), float(j), 0.0)

    def spring(one, other):
        ends = [frames.get(node) or scene.ground.frame((float(node[0]), float(node[1]), 0.0)) for node in (one, other)]
        scene.add_force(fm.force.SpringDamper(*ends, stiffness=rng.uniform(1e3, 4e3), length=1.0 - tension))

    for i, j in itertools.product(range(-1, nx), range(-1, ny)):
        if j >= 0 and not (seed == 2 and (i, j) == (2, 2)):
            spring((i, j), (i + 1, j))
        if i >= 0:
            spring((i, j), (i, j + 1))
    if seed == 2:
        scene.connect(fm.joint.Distance(1.0), frames[2, 2], frames[3, 2])
    expected = dense(monkeypatch, scene)
    found = scene.equilibrium()
    assert ways == [True]
    assert abs(expected.x[2::3]).max() > 0.02
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-10)
    assert (found.unstable, found.neutral) == (expected.unstable, expected.neutral) == (0, ())


def test_a_straight_beam_of_springs_sags_between_walls(ways, monkeypatch):
    """A lattice that horizontal springs alone join to the walls: its weight moves it as a whole at first."""
    scene, frames, (nx, ny) = fm.System(gravity=(0.0, -1.0, 0.0)), {}, (24, 3)
    for i, j in itertools.product(range(nx), range(ny)):
        frames[i, j] = scene.add(fm.PointMass(0.1)).frame()
        scene.connect(fm.joint.PlanarPoint("z"), scene.ground.frame(), frames[i, j]).position = (float(i), float(j))
    for i, j in itertools.product(range(-1, nx), range(ny)):
        for one, other in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if 0 <= j + other < ny and (other == 0 or (i >= 0 and i + one < nx)):
                ends = [(i, j), (i + one, j + other)]
                joined = [frames.get(k) or scene.ground.frame((float(k[0]), float(k[1]), 0.0)) for k in ends]
                length = float(np.hypot(one, other))
                scene.add_force(fm.force.SpringDamper(*joined, stiffness=4e4, length=length))
    expected = dense(monkeypatch, scene)
    found = scene.equilibrium()
    assert ways == [True]
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-10)


@pytest.mark.parametrize("seed", range(2))
def test_lattices_as_by_dense_matrices(ways, monkeypatch, seed):
    scene, _ = spring_lattice(14, 5, fm.joint.Generic("xy"), seed=seed)
    expected = dense(monkeypatch, scene)
    found = scene.equilibrium()
    assert ways == [True]
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-11)
    assert (found.unstable, found.neutral) == (expected.unstable, expected.neutral) == (0, ())


def test_turns_that_nothing_holds_stay(ways, monkeypatch):
    """Angles of masses that springs hold at their centres."""
    scene, bodies = spring_lattice(12, 4, fm.joint.Planar("z"))
    expected = dense(monkeypatch, scene)
    found = scene.equilibrium()
    assert ways == [True]
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-9)
    assert abs(found.x[2::3]).max() < 1e-15  # the angles, which stay
    assert sorted(found.neutral) == sorted(expected.neutral)
    assert len(found.neutral) == len(bodies)


def test_loops_as_by_dense_matrices(ways, monkeypatch):
    scene = linked_pendulums(40)
    expected = dense(monkeypatch, scene)
    found = scene.equilibrium()
    assert ways == [True]
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.multipliers, expected.multipliers, rtol=0, atol=1e-7)
    assert found.unstable == expected.unstable == 0


def test_an_unstable_one_is_counted(ways):
    """Beside the lattice stands a body above its hinge, pressed down."""
    scene, _ = spring_lattice(14, 5, fm.joint.Generic("xy"))
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="top")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame((0, 9, 0)), body.frame((0, -1, 0)), name="tipping")
    scene.add_force(fm.force.FrameForce(body.frame(), (0, -3, 0)))
    with pytest.warns(fm.EquilibriumWarning, match="tipping"):
        found = scene.equilibrium()
    assert ways == [False]
    assert found.unstable == 1


def test_what_nothing_carries_is_refused_at_once(monkeypatch):
    """Where a part of its way down has shown that nothing changes there."""
    scene, _ = spring_lattice(14, 5, fm.joint.Generic("xy"))
    loose = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="loose")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame((0, 9, 0)), loose.frame(), name="slide")
    scene.add_force(fm.force.FrameForce(loose.frame(), (2.5, 0.0, 0.0)))
    counted, forces = [], SparseStiffness.force
    monkeypatch.setattr(SparseStiffness, "force", lambda *given: counted.append(1) or forces(*given))
    monkeypatch.setattr(sparse_equilibrium, "_DENSE_UP_TO", 100)
    with pytest.raises(fm.errors.SceneError, match=r"'slide\.displacement'.* 2\.5 .* stays unbalanced"):
        scene.equilibrium()
    assert len(counted) < 20


def test_what_nothing_carries_is_refused(ways, monkeypatch):
    scene, _ = spring_lattice(14, 5, fm.joint.Generic("xy"))
    loose = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="loose")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame((0, 9, 0)), loose.frame(), name="slide")
    scene.add_force(fm.force.FrameForce(loose.frame(), (2.5, 0.0, 0.0)))
    with pytest.raises(fm.errors.SceneError, match=r"'slide\.displacement'.* 2\.5 .* stays unbalanced"):
        scene.equilibrium()
    assert ways == [False]
    monkeypatch.setattr(sparse_equilibrium, "_DENSE_UP_TO", 100)  # as of a machine that is too large for dense matrices
    with pytest.raises(fm.errors.SceneError, match=r"'slide\.displacement'.* 2\.5 .* stays unbalanced"):
        scene.equilibrium()


def test_the_matrix_and_its_solutions():
    """Entries lie across the diagonal where they should; what is held stays, the rest is solved for."""
    scene, _ = spring_lattice(12, 4, fm.joint.Planar("z"))
    compiled = scene.compile().scene
    stiffness = sparse_stiffness(compiled, new_work(compiled.plan))
    x = compiled.start
    force = stiffness.force(x, np.zeros(0))
    stiffness.assemble(x, np.zeros(0))
    values, size = stiffness.values(), np.ones(compiled.nv)
    entries = stiffness.entries
    assert entries.skewness(values, size, least=1e-8) < 1e-9
    matrix = np.zeros((compiled.nv, compiled.nv))
    matrix[entries.row, entries.column] = values
    np.testing.assert_array_equal(matrix.T[entries.row, entries.column], values[entries.mirrored])
    assert stiffness.factor(1e-3 * entries.nearby(entries.energies(values, size)))
    step, _ = stiffness.solve(-force)
    held = stiffness.held() > 0.0
    assert held.sum() == compiled.nv // 3
    moved = ~held
    exact = np.linalg.solve(matrix[np.ix_(moved, moved)], -force[moved])
    np.testing.assert_allclose(step[moved], exact, rtol=1e-9)


def test_what_is_compiled_for_equilibria_is_announced(monkeypatch):
    """By the way that is gone: the first equilibrium of a large machine compiles for a quarter of a minute."""
    told = []
    monkeypatch.setattr(compiling, "announce_compilation", lambda purpose: told.append(purpose))
    scene, _ = spring_lattice(12, 6, fm.joint.PlanarPoint("z"))
    scene.equilibrium()
    assert sparse_equilibrium.BALANCING_MANY in told
    assert DERIVING not in told
    told.clear()
    scene, _ = spring_lattice(3, 2, fm.joint.PlanarPoint("z"))
    point = scene.equilibrium()
    assert DERIVING in told
    assert sparse_equilibrium.BALANCING_MANY not in told
    told.clear()
    scene.linearize(about=point)
    assert DERIVING in told
