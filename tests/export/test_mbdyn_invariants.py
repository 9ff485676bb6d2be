"""MBDyn's groups 12 to 19: the invariants from lumped masses, bodies of rigid inertia alone, its own equations."""

from dataclasses import replace

import numpy as np
import pytest
from particles import particle_body
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.record.reduced_body import GeometricStiffness


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def stiffened(seed=3, modes=3, *, floating=False):
    """Particles, with stiffening by loads of which some are there."""
    particles = particle_body(seed, modes=modes, damping=0.5)
    spins, rest = ("angular velocity yz", "angular velocity xx"), ("acceleration z", "angular acceleration y")
    loads = (spins[0], rest[0], "tip.rx", spins[1], rest[1], "tip.y")
    half = np.random.default_rng(seed).standard_normal((len(loads), modes, modes))
    record = replace(particles.record, geometric=GeometricStiffness(loads, half + half.transpose(0, 2, 1)))
    if floating:
        record = replace(record, frame=None, geometric=None)
    return particles, record


def groups_of(path):
    """Numbers of each group behind its heading, by the layout alone."""
    found = {}
    for part in path.read_text().split("** RECORD GROUP ")[1:]:
        head, *lines = part.split("\n")
        words = " ".join(line for line in lines if not line.startswith("**")).split()
        found[int(head.split(",")[0])] = words
    return found


def lumped_invariants(m, x, phi):
    """3, 4, 5, 8 and 9 node by node, as MBDyn sums them."""
    n = phi.shape[2]
    i3, i4 = np.zeros((3, n)), np.zeros((3, n))
    i5, i8, i9 = np.zeros((3, n, n)), np.zeros((3, n, 3)), np.zeros((3, n, n, 3))
    for mi, xi, fi in zip(m, x, phi, strict=True):
        i3 += mi * fi
        i4 += mi * skew(xi) @ fi
        for j in range(n):
            i8[:, j] += -mi * skew(xi) @ skew(fi[:, j])
            for k in range(n):
                i5[:, j, k] += mi * skew(fi[:, j]) @ fi[:, k]
                i9[:, j, k] += mi * skew(fi[:, j]) @ skew(fi[:, k])
    return {14: i3, 15: i4, 16: i8, 17: i5, 18: i9}


def test_the_invariants_are_those_of_lumped_masses(tmp_path):
    particles, record = stiffened()
    assert fm.export.mbdyn(record, tmp_path / "body.fem", invariants=True) == ()
    groups = groups_of(tmp_path / "body.fem")
    assert sorted(groups) == [*range(1, 11), *range(12, 20)]
    assert groups[1][-5:] == ["2", "3", "0", "0", "0"]
    for group, right in lumped_invariants(particles.mass, particles.x, particles.phi).items():
        found = np.array(groups[group], dtype=float).reshape(right.shape)
        np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-13 * np.abs(right).max())
    m, x = particles.mass, particles.x
    centre = m @ x / m.sum()
    inertia = sum(-mi * skew(xi - centre) @ skew(xi - centre) for mi, xi in zip(m, x, strict=True))
    right = np.concatenate([[m.sum()], centre, inertia.ravel()])
    np.testing.assert_allclose(np.array(groups[12], dtype=float), right, rtol=1e-13, atol=1e-14)
    # the loads' numbers in MBDyn's manual: products xx yy zz xy yz xz, angular and linear accelerations, interfaces
    numbers = [int(groups[19][1 + at * 10]) for at in range(int(groups[19][0]))]
    wanted = {1: "angular velocity xx", 5: "angular velocity yz", 8: "angular acceleration y", 12: "acceleration z",
              14: "tip.y", 16: "tip.rx"}  # fmt: skip
    assert numbers == list(wanted)
    for at, name in enumerate(wanted.values()):
        K = record.geometric.K[record.geometric.loads.index(name)]
        assert np.array_equal(np.array(groups[19][2 + at * 10 : 11 + at * 10], dtype=float), K.ravel())


@pytest.mark.parametrize("floating", [False, True])
def test_comes_back(tmp_path, floating):
    _, record = stiffened(floating=floating)
    fm.export.mbdyn(record, tmp_path / "body.fem", invariants=True)
    back = fm.export.read_mbdyn(tmp_path / "body.fem")
    scale = np.sqrt(np.outer(np.diag(record.gram), np.diag(record.gram)))
    assert (abs(back.gram - record.gram) / scale).max() < 1e-12
    for what in ("stiffness", "damping", "frame"):
        assert np.array_equal(getattr(back, what), getattr(record, what)), what
    assert [one.name for one in back.interfaces] == ["root", "tip"]
    assert np.array_equal(back.interface("tip").modes, record.interface("tip").modes)
    if record.geometric is not None:
        for load in record.geometric.loads:
            found = back.geometric.K[back.geometric.loads.index(load)]
            assert np.array_equal(found, record.geometric.K[record.geometric.loads.index(load)])
    again = tmp_path / "again.fem"
    fm.export.mbdyn(back, again, invariants=True)
    for group, words in groups_of(tmp_path / "body.fem").items():
        if group in (2, *range(9, 20)):
            right = np.array([float(w) for w in words if w[0] in "-0123456789"])
            found = np.array([float(w) for w in groups_of(again)[group] if w[0] in "-0123456789"])
            np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-12 * max(abs(right).max(initial=0.0), 1e-300))


def mbdyn_flight(groups, n, *, start, gravity, t):
    """A body in flight by the equations of MBDyn's modal joint and the numbers of a file's groups 9 to 18.

    The state is position, velocity, orientation as a quaternion, angular velocity in the body's axes, q and its rate.
    """
    shapes = {9: (n, n), 10: (n, n), 13: (n, n), 14: (3, n), 15: (3, n), 16: (3, n, 3), 17: (3, n, n), 18: (3, n, n, 3)}
    M, K, C, i3, i4, i8, i5, i9 = (np.array(groups[g], dtype=float).reshape(s) for g, s in shapes.items())
    twelve = np.array(groups[12], dtype=float)
    m, c = twelve[0], twelve[1:4]
    i7 = twelve[4:].reshape(3, 3) - m * skew(c) @ skew(c)

    def rates(_, y):
        R = Rotation.from_quat(y[6:10]).as_matrix()
        w, q, b = y[10:13], y[13 : 13 + n], y[13 + n :]
        i8q, i8b = np.einsum("ajb,j->ab", i8, q), np.einsum("ajb,j->ab", i8, b)
        i9qq, i9qb = np.einsum("ajkb,j,k->ab", i9, q, q), np.einsum("ajkb,j,k->ab", i9, q, b)
        S, J = m * c + i3 @ q, i7 + i8q + i8q.T - i9qq
        turning = i4 + np.einsum("ajk,j->ak", i5, q)
        g = R.T @ gravity
        mass = np.block([[m * np.eye(3), -skew(S), i3], [skew(S), J, turning], [i3.T, turning.T, M]])
        force = np.concatenate(
            [
                m * g - np.cross(w, np.cross(w, S)) - 2.0 * np.cross(w, i3 @ b),
                np.cross(S, g) - np.cross(w, J @ w) - 2.0 * (i8b - i9qb) @ w,
                i3.T @ g - C @ b - K @ q - 2.0 * np.einsum("ajk,j->ak", i5, b).T @ w
                + np.einsum("b,bjc,c->j", w, np.einsum("cjb->bjc", i8) - np.einsum("bjkc,k->bjc", i9, q), w),
            ]
        )  # fmt: skip
        a = np.linalg.solve(mass, force)
        x, s = y[6:9], y[9]
        turn = 0.5 * np.concatenate([s * w + np.cross(x, w), [-x @ w]])
        return np.concatenate([y[3:6], R @ a[:3], turn, a[3:6], b, a[6:]])

    return solve_ivp(rates, (t[0], t[-1]), start, t_eval=t, method="DOP853", rtol=1e-12, atol=1e-12).y


@pytest.mark.filterwarnings("ignore::flexmbd.errors.RangeWarning")  # of a record without stiffening that spins
def test_a_file_moves_here_as_by_mbdyns_equations(tmp_path):
    """Large turns and deformations, gravity, damping; the file's own numbers against a machine with the body read."""
    n = 3
    particles = particle_body(11, modes=n, damping=0.5)
    fm.export.mbdyn(particles.record, tmp_path / "body.fem", invariants=True)
    body = fm.FlexibleBody(fm.export.read_mbdyn(tmp_path / "body.fem"))
    gravity, w, v = np.array([0.0, 0.0, -9.81]), np.array([3.0, -2.0, 4.0]), np.array([1.0, 0.5, 2.0])
    body.q, body.q_rate = [0.02, -0.03, 0.01], [0.2, 0.1, -0.3]
    scene = fm.System(gravity=tuple(gravity))
    scene.add(body, name="body")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    free.velocity = [*v, *w]
    run = scene.simulate(0.5, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    t = np.linspace(0.0, 0.5, 11)
    start = np.concatenate([np.zeros(3), v, [0.0, 0.0, 0.0, 1.0], w, body.q, body.q_rate])
    right = mbdyn_flight(groups_of(tmp_path / "body.fem"), n, start=start, gravity=gravity, t=t)
    assert np.abs(right[13 : 13 + n]).max() > 0.03
    np.testing.assert_allclose(run.position(body.frame("root"), t=t), right[:3].T, rtol=0.0, atol=1e-9)
    tip = particles.record.interface("tip")
    turned = Rotation.from_quat(right[6:10].T)
    place = right[:3].T + turned.apply(tip.p_BI_B + right[13 : 13 + n].T @ tip.modes[:3].T)
    np.testing.assert_allclose(run.position(body.frame("tip"), t=t), place, rtol=0.0, atol=1e-9)


BARBELL = """** MBDyn MODAL DATA FILE
** RECORD GROUP 1, HEADER
** counts
REV0 2 1 0 0 0
** RECORD GROUP 2, LABELS
left right
** RECORD GROUP 5, X
-1 1
** RECORD GROUP 6, Y
0 0
** RECORD GROUP 7, Z
0 0
** RECORD GROUP 8, SHAPES
** mode 1
-1 0 0 0 0 0
1 0 0 0 0 0
** RECORD GROUP 9, MODAL MASS
4
** RECORD GROUP 10, MODAL STIFFNESS
400
"""
NODES = "** RECORD GROUP 11, NODES\n2 2 2 0 0 0\n2 2 2 0 0 0\n"
INERTIA = "** RECORD GROUP 12, INERTIA\n4\n0.5 0 0\n1 0 0\n0 4 0\n0 0 4\n"


def read(tmp_path, text, **arguments):
    (tmp_path / "body.fem").write_text(text)
    return fm.export.read_mbdyn(tmp_path / "body.fem", **arguments)


def test_rigid_inertia_alone(tmp_path):
    """The modes of a free body have no momentum, of its turns nothing changes, and its frequency is sqrt(k / m)."""
    body = read(tmp_path, BARBELL + INERTIA)
    assert body.mass == 4.0
    np.testing.assert_allclose(body.com, [0.5, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(body.inertia, np.diag([1.0, 4.0, 4.0]), atol=1e-14)
    assert not body.mass_matrix()[:6, 6:].any()
    np.testing.assert_allclose(body.frequencies(), [10.0 / 2.0 / np.pi], rtol=1e-12)
    assert body.provenance["inertia of the modes"] == "rigid inertia alone: modes without momentum"
    by_hand = read(tmp_path, BARBELL, rigid=fm.RigidBody(4.0, (1.0, 4.0, 4.0), (0.5, 0.0, 0.0)))
    np.testing.assert_allclose(by_hand.gram, body.gram, atol=1e-14)
    with pytest.raises(ExportError, match="leave rigid= out"):
        read(tmp_path, BARBELL + INERTIA, rigid=fm.RigidBody(4.0, (1.0, 4.0, 4.0)))
    with pytest.raises(ExportError, match=r"neither group 11, nodal masses, nor group 12"):
        read(tmp_path, BARBELL)
    held = BARBELL.replace("-1 0 0 0 0 0\n", "0 0 0 0 0 0\n")
    with pytest.raises(ExportError, match=r"its modes vanish at node 'left', so they belong to a body"):
        read(tmp_path, held + INERTIA)
    assert read(tmp_path, held + INERTIA, uncoupled=True).mass == 4.0


def test_the_rigid_inertia_goes_before_that_of_the_nodes(tmp_path):
    body = read(tmp_path, BARBELL + NODES + INERTIA)
    np.testing.assert_allclose(body.com, [0.5, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(body.inertia, np.diag([1.0, 4.0, 4.0]), atol=1e-14)
    np.testing.assert_allclose(body.modal_mass(), [[1.0]], atol=1e-14)


def test_nodes_on_a_line(tmp_path):
    """Without inertia about their line: read, told its frequency, and refused by a machine where it could turn so."""
    body = read(tmp_path, BARBELL + NODES, interfaces=["left"])
    assert np.array_equal(body.inertia, np.diag([0.0, 4.0, 4.0]))
    np.testing.assert_allclose(body.frequencies(), [10.0 / 2.0 / np.pi], rtol=1e-12)
    scene = fm.System()
    part = scene.add(fm.FlexibleBody(body), name="barbell")
    scene.connect(fm.joint.Free(), scene.ground.frame(), part.frame("left"))
    with pytest.raises(fm.FlexmbdError, match="moves no mass"):
        scene.simulate(0.1)


def test_rows_behind_the_nodes(tmp_path):
    wanted = read(tmp_path, BARBELL + NODES)
    assert np.array_equal(read(tmp_path, BARBELL + NODES + "0 0 0 0 0 0\n").gram, wanted.gram)
    with pytest.raises(ExportError, match="those after the 2 of the file have mass"):
        read(tmp_path, BARBELL + NODES + "1 1 1 0 0 0\n")
    with pytest.raises(ExportError, match="group 11, nodal masses, has 15 numbers"):
        read(tmp_path, BARBELL + NODES + "0 0 0\n")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (BARBELL.replace("MASS\n4\n", "MASS\n0\n") + NODES, "modes 1 have no mass in group 9"),
        (BARBELL + NODES.replace("2 2 2", "0 0 0"), "none of its nodes has a mass"),
        (BARBELL.replace("MASS\n4\n", "MASS\n4.1\n") + NODES, r"mode 1: 4.1 and 4\), so they are of two bodies"),
        (BARBELL + NODES + "** RECORD GROUP 14, I3\n0 0 0\n", "which MBDyn adds to each other"),
        (BARBELL + INERTIA + "** RECORD GROUP 20, NEW\n0\n", "record groups 20, which are not known"),
        (BARBELL + INERTIA + "** RECORD GROUP 14, I3\n0 0\n", "group 14, invariant 3, has 2 numbers, expected 3"),
        (BARBELL + INERTIA + "** RECORD GROUP 19, K0\n1\n25\n1.0\n", "load 25, twice or beyond the 24 of 2 interfaces"),
        (BARBELL + INERTIA + "** RECORD GROUP 19, K0\n999999999\n1\n1.0\n", "has not .* matrices"),
        (
            BARBELL + INERTIA + "** RECORD GROUP 15, I4\n0 3 0\n** RECORD GROUP 16, I8\n" + "0 " * 9 + "\n",
            "15, invariant 4, and 16, invariant 8",
        ),
    ],
)
def test_what_does_not_fit(tmp_path, text, match):
    with pytest.raises(ExportError, match=match):
        read(tmp_path, text)


def test_momentum_of_the_nodes_with_the_modal_mass_of_the_file(tmp_path):
    """As MBDyn takes a file whose modal mass is not that of its nodes: the mass matrix at rest is the two together."""
    _, record = stiffened()
    fm.export.mbdyn(record, tmp_path / "body.fem")
    text = (tmp_path / "body.fem").read_text()
    at = text.index("** RECORD GROUP 9")
    end = text.index("** RECORD GROUP 10")
    more = np.array([[1.5, 0.1, 0.0], [0.1, 1.2, 0.0], [0.0, 0.0, 1.1]])
    text = text[:at] + "** RECORD GROUP 9, M\n" + "\n".join(" ".join(map(str, row)) for row in more) + "\n" + text[end:]
    with pytest.raises(ExportError, match="momentum_alone=True"):
        read(tmp_path, text)
    body = read(tmp_path, text, momentum_alone=True)
    right = record.mass_matrix()
    right[6:, 6:] = more
    change = np.eye(6 + 3)
    change[6:, 6:] = body.partition
    np.testing.assert_allclose(body.mass_matrix(), change.T @ right @ change, rtol=0.0, atol=1e-12)


def test_some_invariants_alone(tmp_path):
    """Without 5 and 9 the mass matrix at rest and the levers x_a phi_b are those of the file all the same."""
    _, record = stiffened()
    fm.export.mbdyn(record, tmp_path / "body.fem", invariants=True)
    text = (tmp_path / "body.fem").read_text()
    cut = text[: text.index("** RECORD GROUP 17")]
    found = read(tmp_path, cut)
    np.testing.assert_allclose(found.mass_matrix(), record.mass_matrix(), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.gram[:4], record.gram[:4], rtol=0.0, atol=1e-13)
    values = np.linalg.eigvalsh(found.gram)
    assert values[0] > -1e-12 * values[-1]


def test_damping_that_is_not_symmetric(tmp_path):
    """Its skew part takes no power, and is kept as such; the forces - C q' are the same."""
    _, record = stiffened()
    fm.export.mbdyn(record, tmp_path / "body.fem")
    text = (tmp_path / "body.fem").read_text()
    skewed = np.array([[0.0, 0.7, -0.2], [-0.7, 0.0, 0.1], [0.2, -0.1, 0.0]])
    text = text[: text.index("** RECORD GROUP 13")] + "** RECORD GROUP 13, C\n"

    def with_damping(C):
        return read(tmp_path, text + "\n".join(" ".join(map(repr, row)) for row in C.tolist()))

    body = with_damping(record.damping + skewed)
    np.testing.assert_allclose(body.damping, record.damping, atol=1e-15)
    np.testing.assert_allclose(body.gyroscopic.G, skewed, atol=1e-15)
    assert not body.gyroscopic.slope.any()
    assert with_damping(record.damping + 1e-9 * skewed).gyroscopic is None


@pytest.mark.parametrize("inertia", [False, True])
def test_rigid_motions_among_the_modes(tmp_path, inertia):
    """A mixture of three free modes and six rigid motions: the body is that of the free modes, mass and all."""
    particles = particle_body(5, modes=3)
    m, x = particles.mass, particles.x
    rigid = np.zeros((len(m), 3, 6))
    rigid[:, :, :3] = np.eye(3)
    rigid[:, :, 3:] = np.array([-skew(xi) for xi in x])
    weight = np.repeat(np.sqrt(m), 3)[:, None]
    Q = np.linalg.qr(weight * rigid.reshape(-1, 6))[0]
    elastic = weight * particles.phi.reshape(-1, 3)
    elastic = np.linalg.qr(elastic - Q @ (Q.T @ elastic))[0]
    k = np.array([90.0, 120.0, 300.0])
    mix = np.random.default_rng(0).standard_normal((9, 9))
    modes = (np.hstack([rigid.reshape(-1, 6), elastic / weight]) @ mix).reshape(len(m), 3, 9)
    M = np.einsum("k,kai,kaj->ij", m, modes, modes)
    K = mix.T @ np.diag([0.0] * 6 + list(k)) @ mix

    def lines(array):
        return "\n".join(" ".join(map(repr, row)) for row in np.atleast_2d(array).tolist()) + "\n"

    text = f"** file\n** RECORD GROUP 1, HEADER\n**\nREV0 {len(m)} 9 0 0 0\n** RECORD GROUP 2, LABELS\n"
    text += " ".join(f"n{i}" for i in range(len(m))) + "\n"
    for group, column in zip((5, 6, 7), x.T, strict=True):
        text += f"** RECORD GROUP {group}, X\n" + lines(column)
    text += "** RECORD GROUP 8, SHAPES\n"
    for i in range(9):
        text += "** mode\n" + lines(np.hstack([modes[:, :, i], np.zeros((len(m), 3))]))
    text += "** RECORD GROUP 9, M\n" + lines(M) + "** RECORD GROUP 10, K\n" + lines(K)
    if inertia:
        text += "** RECORD GROUP 11, MASSES\n" + lines(np.hstack([np.tile(m[:, None], 3), np.zeros((len(m), 3))]))
    body = read(tmp_path, text)
    assert body.mass == pytest.approx(m.sum(), rel=1e-9)
    np.testing.assert_allclose(body.com, particles.record.com, atol=1e-9)
    np.testing.assert_allclose(body.inertia, particles.record.inertia, atol=1e-9 * np.trace(particles.record.inertia))
    np.testing.assert_allclose(body.frequencies(), np.sqrt(k) / 2.0 / np.pi, rtol=1e-9)
    with pytest.raises(ExportError, match=r"5 of six|4 of six|rigid motions"):
        read(tmp_path, text.replace(lines(K), lines(mix.T @ np.diag([0.0] * 5 + [1.0, *k]) @ mix)))


def test_a_deck_for_files_of_invariants(tmp_path):
    _, record = stiffened()
    record = replace(record, frame="root")
    fm.export.mbdyn_deck(record, tmp_path / "x.fem", tmp_path / "x.mbd", invariants=True)
    text = (tmp_path / "x.mbd").read_text()
    assert "use automatic differentiation;" in text
    assert "invariant" not in text
    assert '"tip", 2, null;' in text
    with pytest.raises(ExportError, match="this body has none"):
        fm.export.mbdyn(replace(record, interfaces=(), frame=None, geometric=None), tmp_path / "y.fem", invariants=True)
