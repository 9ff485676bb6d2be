"""A linear mesh that turns with its frames: wrenches are derivatives of an energy, bonding needs no multipliers."""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dof_keys import everywhere, keys
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.interior.corotated_interior import CorotatedInterior
from flexmbd.continuum.interior.rotational_dofs import condensed_rotations, lumped_rotations
from flexmbd.errors import ConvergenceError, InterfaceError
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.forms import plate_mitc as plate
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import ExplicitInterior, FrameMotion

RULES = [condensed_rotations, lumped_rotations]
BAR = beam.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0))
SHEET = plate.Parameters(E=2.1e11, nu=0.3, rho=7800.0, t=0.01)
PART = RigidBody(2.0, np.array([[0.2, 0.02, 0.0], [0.02, 0.25, -0.03], [0.0, -0.03, 0.3]]), (-0.1, 0.05, 0.02))
AXES = Rotation.from_rotvec((0.3, -0.4, 0.5)).as_matrix()


def rod(cells=6, interfaces=("start", "end"), comm=MPI.COMM_WORLD):
    found = [Interface(name, axes=AXES) for name in interfaces]
    return ContinuumModel(meshes.line(1.0, divisions=cells, comm=comm), beam, BAR, degree=1, interfaces=found)


def square(interfaces=("x_min", "x_max"), comm=MPI.COMM_WORLD):
    found = [Interface(name, axes=AXES) for name in interfaces]
    return ContinuumModel(
        meshes.sheet(1.0, 1.0, divisions=(3, 3), comm=comm), plate, SHEET, degree=1, interfaces=found
    )


def interior(rule, make=rod, **options):
    model = make(**options)
    return CorotatedInterior(rule(model), rigid_parts={one.name: PART for one in model.interfaces})


def placed(body, *, turned=(1.0, 2.0, -0.5), v=0.0, w=(0.0, 0.0, 0.0)):
    """The frames of an undeformed body somewhere, in a rigid motion."""
    Q = Rotation.from_rotvec(turned).as_matrix()
    p = np.array([1.0, -2.0, 3.0]) + np.array([frame.p_BI_B for frame in body.frames]) @ Q.T
    w = np.tile(w, (len(p), 1))
    rest = np.zeros_like(p)
    return FrameMotion(
        p, np.array([Q @ frame.R_BI for frame in body.frames]), v + np.cross(w, p - p[0]), w, rest, rest
    )


def still(motion):
    rest = np.zeros_like(motion.p)
    return FrameMotion(motion.p, motion.R, rest, rest, rest, rest)


def deformed(body, motion, *, size=1e-3):
    """What it remembers, at rest, with nodes moved at random."""
    body.begin(0.0, still(motion), np.zeros(3))
    memory = dict(body.snapshot())
    rng = np.random.default_rng(5)
    memory["x"] = memory["x"] + size * rng.standard_normal(memory["x"].shape)
    if len(memory["e"]):
        turns = Rotation.from_rotvec(0.05 * rng.standard_normal((len(memory["e"]), 3)))
        found = turns * Rotation.from_quat(memory["e"], scalar_first=True)
        memory["e"] = found.as_quat(scalar_first=True)
    return {**memory, "a": 0 * memory["a"]}


def pushed(body, memory, motion):
    """Wrenches and elastic energy with the nodes as remembered and the frames where `motion` has them."""
    body.restore(memory)
    motion = still(motion)
    push = body.advance(1e-12, motion, motion)
    return push.end, body.energies()["elastic"]


def moved(motion, frame, shift, turn):
    p, R = motion.p.copy(), motion.R.copy()
    p[frame] += shift
    R[frame] = Rotation.from_rotvec(turn).as_matrix() @ R[frame]
    return motion._replace(p=p, R=R)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("make", [rod, square])
def test_wrenches_are_the_derivatives_of_the_energy(rule, make):
    """By the places and rotations of both frames, turned finitely, the far one bent and twisted by a tenth."""
    body = interior(rule, make)
    assert isinstance(body, ExplicitInterior)
    motion = moved(placed(body), 1, (1e-3, 2e-3, -1e-3), (0.05, -0.04, 0.1))
    memory = deformed(body, motion)
    wrenches, _ = pushed(body, memory, motion)
    for frame in range(2):
        for i in range(6):
            step = 1e-6 * np.eye(6)[i]
            ends = [pushed(body, memory, moved(motion, frame, s * step[:3], s * step[3:]))[1] for s in (1, -1)]
            expected = -(ends[0] - ends[1]) / 2e-6
            assert wrenches[frame, i] == pytest.approx(expected, abs=1e-6 * abs(wrenches).max())


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_no_momentum_is_made_and_turning_changes_nothing(rule):
    """Forces on frames and nodes, and their moments, sum to nothing; turned as a whole, the wrenches turn along."""
    found = []
    for turned in ((0.0, 0.0, 0.0), (1.0, 2.0, -0.5)):
        body = interior(rule)
        motion = moved(placed(body, turned=turned), 1, 0.0, (0.0, 0.0, 0.0))
        Q = Rotation.from_rotvec(turned).as_matrix()
        body.begin(0.0, motion, np.zeros(3))
        bent = moved(motion, 1, Q @ (1e-3, 2e-3, -1e-3), Q @ (0.05, -0.04, 0.1))
        memory = body.snapshot()
        # one step from rest: impulses on the nodes are seen in their velocities
        h = 1e-9
        rest = still(bent)
        body.restore(memory)
        first = body.advance(h, rest, rest).end
        after = body.snapshot()
        masses = own_masses(body)
        force = masses @ after["a"]
        moment = (masses[:, None] * np.cross(after["x"], after["a"])).sum(axis=0)
        if len(after["alpha"]):
            moment += own_inertia(body) @ after["alpha"]
        scale = abs(first).max()
        assert abs(first[:, :3].sum(axis=0) + force).max() < 1e-12 * scale
        total = (np.cross(bent.p, first[:, :3]) + first[:, 3:]).sum(axis=0) + moment
        assert abs(total).max() < 1e-11 * scale
        found.append(np.concatenate([first[:, :3] @ Q, first[:, 3:] @ Q]))
    assert abs(found[1] - found[0]).max() < 1e-9 * abs(found[0]).max()


def own_masses(body):
    """Of the nodes that are not bonded, in the order of a snapshot."""
    operator = body.operator
    nodes = operator.model.displacement_dofs[: operator.model.n_owned_nodes, 0]
    return np.concatenate(operator.model.comm.allgather(operator.masses[nodes[operator.moving[nodes]]]))


def own_inertia(body):
    operator = body.operator
    turns = operator.rotations[:, 0]
    return np.concatenate(operator.model.comm.allgather(operator.masses[turns[operator.moving[turns]]]))


def rigid_matrix(part, origin, R):
    """(6, 6) mass matrix of a rigid part about an origin, its centre of mass at `origin` + R com."""
    c = R @ np.asarray(part.com)
    cross = np.cross(np.eye(3), c)
    inertia = R @ np.asarray(part.inertia) @ R.T
    return np.block(
        [[part.mass * np.eye(3), part.mass * cross.T], [part.mass * cross, inertia + part.mass * cross @ cross.T]]
    )


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("make", [rod, square])
def test_eliminated_bonding_moves_as_with_explicit_multipliers(rule, make):
    """Eq. 51 and 56 with the frame in the centre of the rigid part and its nodes: divided by a constant diagonal.

    Against a rigid part of its own and bonded nodes with equations of their own, held together by multipliers.
    """
    model = make(interfaces=("start",) if make is rod else ("x_min",), comm=MPI.COMM_SELF)
    operator = rule(model)
    body = CorotatedInterior(operator, rigid_parts={model.interfaces[0].name: PART})
    (frame,), (bond,) = body.frames, operator.bonds
    n, own, m = len(operator.masses), operator.moving, operator.masses
    principal, turn = np.linalg.eigh(frame.inertia)
    R = frame.R_BI @ turn
    centre = frame.R_BI @ frame.com
    # of the frame in the centre along the principal axes, about the interface's origin: (t, r) there
    to_origin = np.zeros((6, 6))
    to_origin[:3, :3], to_origin[3:, 3:] = R, R
    to_origin[:3, 3:] = np.cross(centre, R.T).T
    columns = bond.columns @ to_origin
    diagonal = np.append(np.full(3, frame.mass), principal)
    # all of it by the matrix of the rigid part and of the nodes: diagonal indeed
    whole = to_origin.T @ rigid_matrix(PART, model.interfaces[0].p, frame.R_BI) @ to_origin
    whole += columns.T @ (m[bond.dofs, None] * columns)
    assert abs(whole - np.diag(diagonal)).max() < 1e-12 * diagonal.max()
    # multipliers: own dofs, bonded dofs, rigid part about the interface's origin
    kept = np.flatnonzero(own | np.isin(np.arange(n), bond.dofs))
    at = np.searchsorted(kept, bond.dofs)
    size, ties = len(kept) + 6, len(bond.dofs)
    kkt = np.zeros((size + ties, size + ties))
    kkt[: len(kept), : len(kept)] = np.diag(m[kept])
    kkt[len(kept) : size, len(kept) : size] = rigid_matrix(PART, model.interfaces[0].p, frame.R_BI)
    kkt[size + np.arange(ties), at] = -1.0
    kkt[size:, len(kept) : size] = bond.columns
    kkt[:size, size:] = kkt[size:, :size].T
    inverse = np.linalg.inv(kkt)

    u, q, rate = np.zeros(n), np.zeros(6), np.zeros(6)
    rate[:] = 0.3, -0.2, 0.1, 1.0, -2.0, 0.5
    v = np.zeros(n)
    other, other_v = np.zeros(size), np.zeros(size)
    other_v[at] = columns @ rate
    other_v[len(kept) :] = to_origin @ rate
    h = 0.5 * operator.stable_step([rigid_matrix(PART, model.interfaces[0].p, frame.R_BI)])
    for _ in range(400):
        # central differences in leapfrog's form, both alike
        u[bond.dofs] = columns @ q
        operator.complete(u)
        f = operator.force(u)
        v[own] -= h * f[own] / m[own]
        rate -= h * (columns.T @ f[bond.dofs]) / diagonal
        u[own] += h * v[own]
        q += h * rate

        w = np.zeros(n)
        w[kept] = other[: len(kept)]
        operator.complete(w)
        load = np.zeros(size + ties)
        load[: len(kept)] = -operator.force(w)[kept]
        other_v += h * (inverse @ load)[:size]
        other += h * other_v
    u[bond.dofs] = columns @ q
    assert abs(u[kept] - other[: len(kept)]).max() < 1e-9 * abs(u).max()
    assert abs(u[kept]).max() > 1e-3


@pytest.mark.parametrize("rule", RULES)
def test_bonding_equals_multipliers_in_a_finite_spin(rule):
    """Accelerations of a rigid part that spins, with the centripetal ones of its bonded nodes (eq. 50, s_omega)."""
    body = interior(rule, square)
    operator, (_, frame), (_, bond) = body.operator, body.frames, body.operator.bonds
    motion = moved(placed(body), 1, (1e-3, 2e-3, -1e-3), (0.0, 0.0, 0.0))
    wrenches, _ = pushed(body, deformed(body, motion), motion)
    R, w = motion.R[1], np.array([7.0, -3.0, 5.0])
    # as the machine has it: Newton and Euler of one rigid body
    c, inertia = R @ frame.com, R @ frame.inertia @ R.T
    force = wrenches[1, :3]
    torque = wrenches[1, 3:] - np.cross(c, force) - np.cross(w, inertia @ w)
    alpha = np.linalg.solve(inertia, torque)
    a_com = force / frame.mass

    # the part, and each bonded node, with multipliers: unknowns (a, alpha) of the part's centre, of nodes, ties
    model, Q = operator.model, R @ frame.R_BI.T
    nodes = [k for k, dofs in enumerate(model.displacement_dofs) if dofs[0] in bond.dofs]
    f = -operator.force(body.displacements())
    arms = (model.node_x[nodes] - frame.p_BI_B) @ Q.T
    own_c, own_inertia = R @ np.asarray(PART.com), R @ np.asarray(PART.inertia) @ R.T
    count = len(nodes)
    size = 6 + 6 * count
    kkt, load = np.zeros((2 * size - 6, 2 * size - 6)), np.zeros(2 * size - 6)
    kkt[:3, :3], kkt[3:6, 3:6] = PART.mass * np.eye(3), own_inertia
    load[3:6] = -np.cross(w, own_inertia @ w)
    for i, k in enumerate(nodes):
        at, tie = 6 + 6 * i, size + 6 * i
        dofs = model.displacement_dofs[k]
        kkt[at : at + 6, at : at + 6] = np.diag(operator.masses[np.append(dofs, dofs + 3)])
        load[at : at + 3], load[at + 3 : at + 6] = Q @ f[dofs], Q @ f[dofs + 3]
        arm = arms[i] - own_c
        # alpha x arm, as a matrix on alpha
        kkt[tie : tie + 3, :3], kkt[tie : tie + 3, 3:6] = np.eye(3), np.cross(np.eye(3), arm).T
        kkt[tie + 3 : tie + 6, 3:6] = np.eye(3)
        kkt[tie : tie + 6, at : at + 6] = -np.eye(6)
        load[tie : tie + 3] = -np.cross(w, np.cross(w, arm))
    kkt[:size, size:] = kkt[size:, :size].T
    found = np.linalg.solve(kkt, load)
    assert found[3:6] == pytest.approx(alpha, rel=1e-8)
    expected = a_com + np.cross(alpha, own_c - c) + np.cross(w, np.cross(w, own_c - c))
    assert found[:3] == pytest.approx(expected, rel=1e-8)


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_a_held_cantilever_swings_under_its_weight(rule):
    """Against the modes of the lumped model, the body standing at an angle."""
    body = interior(rule, rod, interfaces=("start",), cells=5)
    motion = placed(body, turned=(0.5, -0.3, 0.8))
    Q = Rotation.from_rotvec((0.5, -0.3, 0.8)).as_matrix()
    gravity = np.array([1.0, 2.0, -9.81])
    body.begin(0.0, motion, gravity)
    h, steps = 0.1 * body.stable_step(), 3000
    for _ in range(steps):
        push = body.advance(h, motion, motion)
    model = rod(interfaces=("start",), cells=5, comm=MPI.COMM_SELF)
    operator = rule(model)
    every = np.arange(len(operator.masses))
    chosen = np.flatnonzero(operator.moving)
    columns = []
    for i in chosen:
        u = (every == i).astype(float)
        operator.complete(u)
        columns.append(operator.force(u)[chosen])
    m = operator.masses[chosen]
    values, modes = scipy.linalg.eigh(np.array(columns), np.diag(m))
    weight = np.where(chosen % 6 < 3, m * (Q.T @ gravity)[chosen % 6 % 3], 0.0)
    swing = modes @ ((1 - np.cos(np.sqrt(values) * h * steps)) / values * (modes.T @ weight))
    u = np.zeros(len(every))
    u[chosen] = swing
    operator.complete(u)
    order = np.lexsort(np.round(keys(model), 9).T[::-1])
    found = everywhere(body.operator.model, body.displacements())
    assert abs(found - u[order]).max() < 2e-3 * abs(u).max()
    # seen from the frame: what the nodes weigh and how they are accelerated
    assert abs(push.end[0, 3:]).max() > 1.0
    assert set(body.energies()) == {"kinetic", "elastic", "gravitational"}


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_several_steps_in_one_and_back_to_the_bit(rule):
    body = interior(rule, square)
    motion = placed(body)
    memory = deformed(body, motion)
    body.restore(memory)
    h = 0.9 * body.stable_step()
    pushes = [body.advance(h, motion, motion) for _ in range(4)]
    for one, other in itertools.pairwise(pushes):
        assert other.mean == pytest.approx((one.end + other.end) / 2, rel=1e-12)
    far = body.snapshot()
    body.restore(memory)
    once = body.advance(4 * h * (1 - 1e-12), motion, motion)
    assert once.end == pytest.approx(pushes[-1].end, rel=1e-6)
    assert once.mean == pytest.approx(sum(push.mean for push in pushes) / 4, rel=1e-6)
    body.restore(memory)
    for _ in range(4):
        body.advance(h, motion, motion)
    again = body.snapshot()
    assert all((np.asarray(again[name]) == np.asarray(far[name])).all() for name in far)


@pytest.mark.mpi
@pytest.mark.parametrize("rule", RULES)
def test_the_same_on_all_ranks(rule):
    """The far frame is pulled away at once; wrenches after a hundred steps."""
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        body = interior(rule, square, comm=comm)
        motion = placed(body)
        body.begin(0.0, motion, np.array([0.0, 0.0, -9.81]))
        away = moved(motion, 1, (1e-3, 2e-3, -1e-3), (0.01, -0.01, 0.02))
        for _ in range(100):
            push = body.advance(4e-5, away, away)
        found.append(push.end)
    assert abs(found[0] - found[1]).max() < 1e-9 * abs(found[1]).max()


def test_frames_weigh_what_is_bonded():
    """Mass, centre and inertia of the rigid part and its nodes, by the parallel axes."""
    model = rod(cells=4, interfaces=("start",), comm=MPI.COMM_SELF)
    operator = lumped_rotations(model)
    (frame,) = CorotatedInterior(operator, rigid_parts={"start": PART}).frames
    node = BAR.rho * BAR.A / 8
    assert frame.mass == pytest.approx(PART.mass + node, rel=1e-12)
    com = PART.mass * np.asarray(PART.com) / frame.mass
    assert frame.com == pytest.approx(com, rel=1e-12)
    d = np.asarray(PART.com)
    reduced = PART.mass * node / frame.mass
    turning = operator.masses[operator.bonds[0].dofs[3]]
    expected = np.asarray(PART.inertia) + reduced * (d @ d * np.eye(3) - np.outer(d, d)) + turning * np.eye(3)
    assert abs(frame.inertia - expected).max() < 1e-12


def test_bad_input():
    with pytest.raises(InterfaceError, match="a body in a machine needs an interface"):
        CorotatedInterior(lumped_rotations(rod(interfaces=())))
    with pytest.raises(InterfaceError, match=r"rigid parts \['tip'\] on interfaces \['start', 'end'\]"):
        CorotatedInterior(lumped_rotations(rod()), rigid_parts={"tip": PART})
    with pytest.raises(InterfaceError, match="no inertia about an axis"):
        CorotatedInterior(condensed_rotations(rod()))
    body = interior(lumped_rotations)
    motion = placed(body)
    memory = deformed(body, motion)
    for speed in (1e9, np.nan):
        body.restore({**memory, "v": 0 * memory["v"] + speed})
        with pytest.raises(ConvergenceError, match="nodes are 100 times the body's size away"):
            body.advance(1e-6, motion, motion)
