"""ExtPtfm's superelement: openfast_io reads the numbers back; its self-weight is that of the weighed body."""

import numpy as np
import pytest
import scipy.linalg
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError, InterfaceError


def read_by_openfast(path):
    reader = pytest.importorskip("openfast_io.FAST_reader", reason="no openfast_io: pip install openfast_io")
    openfast = reader.InputReader_OpenFAST()
    openfast.fst_vt["ExtPtfm"]["FlexASCII"] = {}
    openfast.read_Superelement(str(path))
    return openfast.fst_vt["ExtPtfm"]["FlexASCII"]


def test_openfast_io_reads_the_same_numbers(tmp_path):
    body = small_body()
    left = fm.export.openfast(body, tmp_path / "se.dat")
    assert not any("interface" in item for item in left)
    found, element = read_by_openfast(tmp_path / "se.dat"), fm.export.superelement(body)
    assert found["nDOF"] == 6 + body.n_modes
    R = np.kron(np.eye(2), body.interface("big_end").R_BI)
    turn = np.block([[R, np.zeros((6, 2))], [np.zeros((2, 6)), np.eye(2)]])
    for name, matrix in (("MassMatrix", element.M), ("StiffnessMatrix", element.K), ("DampingMatrix", element.D)):
        wanted = turn.T @ matrix @ turn
        np.testing.assert_allclose(found[name], wanted, rtol=0.0, atol=1e-14 * abs(wanted).max())
    assert not np.any(found["StiffnessMatrix"][:6])


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_other_interfaces_are_left_free(tmp_path, make):
    body = make()
    with pytest.raises(ExportError, match=r"interfaces: it takes 1, the body has 2"):
        fm.export.openfast(body, tmp_path / "se.dat")
    assert not (tmp_path / "se.dat").exists()
    other = body.interfaces[1].name
    fm.export.openfast(body, tmp_path / "se.dat", interface=other, lossy=True)
    back = fm.export.read_openfast(tmp_path / "se.dat")
    assert [frame.name for frame in back.interfaces] == [other]
    np.testing.assert_allclose(back.frequencies(), body.frequencies(), rtol=1e-9)
    np.testing.assert_allclose(back.frequencies([other]), body.frequencies([other]), rtol=1e-9)
    np.testing.assert_allclose(back.mass, body.mass, rtol=1e-12)


def potential(body, frame, theta, q):
    """Weight's potential when the interface is turned by a rotation vector, modes q, g = 1 along its z axis."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(theta).as_matrix()
    moment = frame.R_BI.T @ (body.gram[0, 1:4] - body.mass * frame.p_BI_B + q @ body.gram[0, 4:].reshape(-1, 3))
    return float((R @ moment)[2])


def test_the_self_weight_is_the_potentials_derivative(tmp_path):
    """Forces along the axes that turn with the interface, against differences of the potential of the turned body."""
    body, h = small_body(), 1e-4
    frame = body.interface("big_end")
    fm.export.openfast(body, tmp_path / "se.dat", gravity=1.0)
    found = read_by_openfast(tmp_path / "se.dat")
    W0, K_W = found["WeightConstant"][0], found["WeightStiffness"]
    # the file's modes are the body's up to their signs, by the mass coupling
    element = fm.export.superelement(body)
    signs = np.sign(np.einsum("im,im->m", element.M[:6, 6:], body.mass_matrix()[:6, 6:]))

    def modal_force(theta, q):
        steps = np.eye(body.n_modes) * signs
        ahead, behind = ([potential(body, frame, theta, q + s * step) for step in steps] for s in (1.0, -1.0))
        return (np.array(behind) - np.array(ahead)) / 2.0

    zero = np.zeros(body.n_modes)
    np.testing.assert_allclose(W0[6:], modal_force(np.zeros(3), zero), rtol=1e-10)
    for i in range(3):
        turn = h * np.eye(3)[i]
        change = (modal_force(turn, zero) - modal_force(-turn, zero)) / (2.0 * h)
        np.testing.assert_allclose(-K_W[6:, 3 + i], change, atol=1e-7 * abs(W0[6:]).max())
    m, mz = body.mass, W0[2]
    x, y, z = frame.R_BI.T @ (body.com - frame.p_BI_B)
    # the entries that OpenFAST's manual names
    assert mz == pytest.approx(-m, rel=1e-12)
    np.testing.assert_allclose(W0[[0, 1, 5]], 0.0, atol=1e-12 * m)
    np.testing.assert_allclose(W0[3:5], [mz * y, -mz * x], rtol=0.0, atol=1e-12 * m)
    expected = {(0, 4): mz, (1, 3): -mz, (3, 3): mz * z, (4, 4): mz * z, (5, 3): -mz * x, (5, 4): -mz * y}
    rigid = np.zeros((6, 6))
    for place, value in expected.items():
        rigid[place] = value
    np.testing.assert_allclose(K_W[:6, :6], rigid, rtol=0.0, atol=1e-12 * m)
    # a load's work is symmetric: what a mode moves of the weight's arm is what a rotation does to the mode's force
    np.testing.assert_allclose(K_W[3:5, 6:], K_W[6:, 3:5].T, rtol=1e-12)
    assert not np.any(K_W[:, [0, 1, 2, 5]])


def written(tmp_path, *changes):
    fm.export.openfast(small_body(), tmp_path / "part.dat")
    text = (tmp_path / "part.dat").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "se.dat").write_text(text)
    return tmp_path / "se.dat"


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("!Dimension: 8", "!Dimension: 9", "not of 9 rows"),
        ("!Dimension: 8", "!Dimension: 99999", "99999 rows"),
        ("!Dimension: 8", "!Dimension: x", "not a whole number"),
        ("!Dimension: 8", "", "0 rows"),
        ("!Mass", "!Mess", "0 matrices '!mass'"),
        ("E+0", "E+0x", "could not convert"),
        ('"position": [0.0', '"position": [NaN', "comment about an interface is damaged"),
    ],
)
def test_files_that_do_not_fit(tmp_path, old, new, match):
    with pytest.raises(ExportError, match=match):
        fm.export.read_openfast(written(tmp_path, (old, new)))


def test_a_file_without_our_comment(tmp_path):
    path = written(tmp_path)
    path.write_text("\n".join(line for line in path.read_text().splitlines() if "flexmbd" not in line))
    body = fm.export.read_openfast(path)
    assert (body.frame, body.interfaces[0].name) == ("platform", "platform")
    np.testing.assert_allclose(body.frequencies(), small_body().frequencies(), rtol=1e-10)
    with pytest.raises(InterfaceError, match="nose"):
        fm.export.openfast(small_body(), tmp_path / "x", interface="nose")


def test_damaged_files(tmp_path):
    data = written(tmp_path).read_bytes()
    assert survive(fm.export.read_openfast, tmp_path / "x", data, count=2000) < 1000


def connections(path):
    """Places and displacements as ExtPtfm's ReadConnFile takes them: each matrix follows its keyword's line."""
    lines = path.read_text().splitlines()
    at = {line.upper().split(":")[0].split()[0]: k for k, line in enumerate(lines) if line.startswith("!") and k > 0}
    count = int(lines[at["!NCONN"]][7:])
    matrices = []
    for keyword, rows in (("!CONNECTIONS", count), ("!DISPLACEMENT", 3 * count)):
        first = at[keyword] + 1
        matrices.append(np.array([[float(word) for word in line.split()] for line in lines[first : first + rows]]))
    return matrices


@pytest.mark.parametrize(("make", "chosen"), [(soft_bar, "x_min"), (damped_rod, "small_end"), (floating_bar, "x_max")])
def test_connection_points(tmp_path, make, chosen):
    """Rigid columns as ExtPtfm checks them; pulled there, the platform held, it moves as the body's modes say."""
    body, reference = make(), np.array([0.0, 1.0, -20.0])
    names = fm.export.openfast_connections(body, tmp_path / "c.dat", interface=chosen, reference=reference)
    fm.export.openfast(body, tmp_path / "se.dat", interface=chosen, lossy=True)
    held, (point,) = body.interface(chosen), [frame for frame in body.interfaces if frame.name != chosen]
    assert names == (point.name,)
    places, moved = connections(tmp_path / "c.dat")
    x, y, z = places[0] - reference
    np.testing.assert_allclose(held.R_BI @ (x, y, z), point.p_BI_B - held.p_BI_B, atol=1e-12)
    rigid = np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])
    np.testing.assert_allclose(moved[:, :6], rigid, atol=1e-9)
    element = fm.export.superelement(fm.export.read_openfast(tmp_path / "se.dat"))
    flexible = moved[:, 6:] @ np.linalg.solve(element.K[6:, 6:], moved[:, 6:].T)
    # the same flexibility from the record, both interfaces free: minus the rigid motion that brings the held one back
    both = fm.export.superelement(body, interfaces=[chosen, point.name])
    wanted = held.R_BI.T @ np.linalg.inv(both.K[6:12, 6:12])[:3, :3] @ held.R_BI
    np.testing.assert_allclose(flexible, wanted, rtol=0.0, atol=1e-8 * abs(wanted).max())
    with pytest.raises(ExportError, match="reference"):
        fm.export.openfast_connections(body, tmp_path / "d.dat", reference=(0.0, 1.0))


def test_connection_points_are_other_interfaces(tmp_path):
    with pytest.raises(ExportError, match="beside the one at the platform"):
        fm.export.openfast_connections(small_body(), tmp_path / "c.dat")


def on_soil(tmp_path):
    """The file of a rod with a stiffness of its soil, K and M of it, its weight, and the soil's damping."""
    body = damped_rod()
    fm.export.openfast(body, tmp_path / "free.dat", interface="small_end", lossy=True)
    lines = (tmp_path / "free.dat").read_text().splitlines()

    def rows(title, count):
        at = next(i for i, line in enumerate(lines) if line.startswith(title)) + 1
        return at, np.array([line.split() for line in lines[at : at + count]], dtype=float)

    n = 6 + body.n_modes
    half = np.random.default_rng(1).standard_normal((6, 6))
    soil = np.diag([1e6, 1e6, 1e6, 1e4, 1e4, 1e4]) ** 0.5
    soil = soil @ (np.eye(6) + 0.1 * half @ half.T) @ soil
    at, K = rows("!Stiffness", n)
    K[:6, :6] += soil
    lines[at : at + n] = ["".join(f"{value:25.16E}" for value in row) for row in K.tolist()]
    (tmp_path / "jacket.dat").write_text("\n".join(lines))
    return tmp_path / "jacket.dat", K, rows("!Mass", n)[1], rows("!Weight constant", 1)[1][0]


def test_a_structure_on_its_foundation(tmp_path):
    """Held at the ground its frequencies are those of K and M, and its sag is K^-1 of the file's weight."""
    path, K, M, weight = on_soil(tmp_path)
    rod = damped_rod()
    with pytest.raises(ExportError, match=r"Of a structure on its foundation say so: foundation='seabed'"):
        fm.export.read_openfast(path)
    with pytest.raises(ExportError, match=r"are given by rigid=fm.RigidBody"):
        fm.export.read_openfast(path, foundation="seabed")
    rigid = fm.RigidBody(rod.mass, rod.inertia, rod.com)
    with pytest.raises(ExportError, match="its stiffness does not hold it"):
        fm.export.read_openfast(tmp_path / "free.dat", foundation="seabed", rigid=rigid)
    body = fm.export.read_openfast(path, foundation="seabed", rigid=rigid)
    exact = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)) / 2.0 / np.pi
    np.testing.assert_allclose(body.frequencies(["seabed"]), exact, rtol=1e-9)
    np.testing.assert_allclose(body.mass, rod.mass, rtol=1e-12)
    np.testing.assert_allclose(body.inertia, rod.inertia, atol=1e-12 * np.trace(rod.inertia))
    scene = fm.System(gravity=(0.0, 0.0, -9.80665))
    part = scene.add(fm.FlexibleBody(body), name="jacket")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), part.frame("seabed"))
    sag = np.linalg.solve(K, weight)
    found = body.interface("small_end").modes @ scene.equilibrium().q(part)
    np.testing.assert_allclose(found, sag[:6], rtol=0.0, atol=1e-9 * abs(sag[:6]).max())
