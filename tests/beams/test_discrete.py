"""Discrete elements: the finite element's stiffness, lumped mass, their records in the machine, what is refused."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from stiffness_method import assembled, axes_of, local_mass, local_stiffness

import flexmbd as fm
from flexmbd.beams import PLANE, DiscreteFrame, Lumping, discrete_body
from flexmbd.errors import SceneError


@dataclasses.dataclass(frozen=True)
class Bar:
    """A section, which needs no more than these names."""

    E: float = 2.0e9
    nu: float = 0.3
    rho: float = 1500.0
    A: float = 1.2e-3
    Iy: float = 1.6e-7
    Iz: float = 0.9e-7
    Iyz: float = 0.0
    J: float = 1.9e-7
    ky: float = 0.85
    kz: float = 0.8
    orientation: tuple[float, float, float] = (0.2, 1.0, 0.1)


BAR = Bar()
SLENDER = dataclasses.replace(BAR, ky=np.inf, kz=np.inf)
# a beam of Euler and Bernoulli with unit length, mass and bending stiffness, which bends along y
UNIT = Bar(E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1.0, Iz=1.0, J=1.0, ky=np.inf, kz=np.inf, orientation=(0.0, 1.0, 0.0))

POINTS = {"foot": (0.0, 0.0, 0.0), "head": (0.0, 0.3, 1.2), "left": (0.3, 1.5, 1.0), "right": (0.5, -1.1, 0.7)}
BEAMS = {"mast": [("foot", "head")], "arms": [("head", "left"), ("head", "right")], "stay": [("right", "foot")]}
SECTIONS = {"mast": BAR, "arms": SLENDER, "stay": dataclasses.replace(BAR, orientation=(1.0, 1.0, 0.0), rho=900.0)}


def frame(**more):
    return DiscreteFrame(POINTS, BEAMS, SECTIONS, **{"divisions": {"mast": 2, "arms": 3, "stay": 1}, **more})


DAMPED = {"damping_ratio": 0.05, "damping_held": ["root"]}


def rod(divisions, section=BAR, **more):
    """Along x from 0 to 1 m."""
    ends = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    return DiscreteFrame(ends, {"rod": [("root", "tip")]}, {"rod": section}, divisions=divisions, **more)


def stations(divisions):
    """Nodes of `rod` from root to tip."""
    return [0, *range(2, divisions + 1), 1]


def test_stiffness_is_that_of_hermites_finite_element():
    """Whose interpolation is exact for loads in the nodes; with shear by Przemieniecki's, and without."""
    lumped = frame()
    mesh = lumped.mesh
    sections = [SECTIONS[mesh.groups[group]] for group in mesh.group]

    def local(section, length):
        return local_stiffness(section, length, shear=np.isfinite(section.ky))

    exact = assembled(mesh.x, mesh.elements, sections, local)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert abs((lumped.K - exact) / size).max() < 1e-13


def test_stiffness_of_axes_that_are_not_principal():
    c, s = np.cos(0.6), np.sin(0.6)
    section = dataclasses.replace(SLENDER, orientation=(0.0, 1.0, 0.0))
    turned = dataclasses.replace(
        section,
        Iy=c * c * section.Iy + s * s * section.Iz,
        Iz=s * s * section.Iy + c * c * section.Iz,
        Iyz=s * c * (section.Iy - section.Iz),
        orientation=(0.0, c, s),
    )
    one, other = rod(3, section), rod(3, turned)
    assert abs(one.K - other.K).max() < 1e-13 * abs(one.K).max()
    assert abs(one.M - other.M).max() < 1e-13 * abs(one.M).max()


def test_flexibility_by_castigliano_over_the_whole_beam():
    """Eq. 19: the integral of the resultants per unit load, by a rule of its own from root to tip."""
    n = 4
    places = np.arange(1, n + 1) / n
    shear = BAR.E / (2 * (1 + BAR.nu))
    compliance = 1 / np.array(
        [BAR.E * BAR.A, shear * BAR.A * BAR.ky, shear * BAR.A * BAR.kz, shear * BAR.J, BAR.E * BAR.Iy, BAR.E * BAR.Iz]
    )
    axes = axes_of(np.array([1.0, 0, 0]), BAR.orientation)
    at, weight = np.polynomial.legendre.leggauss(3)
    exact = np.zeros((6 * n,) * 2)
    for element in range(n):
        for s, w in zip((element + (at + 1) / 2) / n, weight / (2 * n), strict=True):
            resultants = np.zeros((6, 6 * n))
            for i, place in enumerate(places):
                if place > s:
                    lever = np.cross([place - s, 0, 0], np.eye(3)).T
                    resultants[:, 6 * i : 6 * i + 6] = np.block(
                        [[axes, np.zeros((3, 3))], [axes @ lever, axes]]
                    )
            exact += w * resultants.T @ (compliance[:, None] * resultants)
    rows = np.concatenate([6 * node + np.arange(6) for node in stations(n)[1:]])
    found = np.linalg.inv(rod(n).K[np.ix_(rows, rows)])
    assert abs(found - exact).max() < 1e-12 * abs(exact).max()


def test_mass_is_not_that_of_hermites_finite_element():
    """But the whole of it is: lumped and consistent mass differ in what is no rigid motion."""
    lumped = rod(3, SLENDER)
    consistent = assembled(lumped.mesh.x, lumped.mesh.elements, [SLENDER] * 3, local_mass)
    assert abs(lumped.M - consistent).max() > 0.1 * abs(consistent).max()
    along_y = np.zeros(24)
    along_y[1::6] = 1.0
    assert along_y @ lumped.M @ along_y == pytest.approx(along_y @ consistent @ along_y, rel=1e-13)
    # no mass between one node and the next
    blocks = lumped.M.reshape(4, 6, 4, 6)
    assert not any(blocks[i, :, j].any() for i in range(4) for j in range(4) if i != j)


@pytest.mark.parametrize("lumping", Lumping)
def test_mass_and_inertia(lumping):
    """Of pieces those of the beams; of points with (1 / 12 + 1 / (6 n^2)) m L^2 for n elements, and nothing across."""
    divisions = {"mast": 2, "arms": 3, "stay": 1}
    points = lumping is Lumping.POINTS
    body = discrete_body(frame(lumping=lumping), interfaces=["foot"], frame="foot")
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for group, members in BEAMS.items():
        p = SECTIONS[group]
        for a, b in members:
            a, b = np.array(POINTS[a]), np.array(POINTS[b])
            one, (_, y, z) = p.rho * p.A * np.linalg.norm(b - a), axes_of(b - a, p.orientation)
            middle = (a + b) / 2
            mass += one
            first += one * middle
            across = 0 if points else (p.Iz * np.outer(y, y) + p.Iy * np.outer(z, z)) / p.A
            along = 1 / 12 + points / (6 * divisions[group] ** 2)
            second += one * (np.outer(middle, middle) + along * np.outer(b - a, b - a) + across)
    com = first / mass
    about = second - mass * np.outer(com, com)
    assert body.mass == pytest.approx(mass, rel=1e-13)
    assert body.com == pytest.approx(com, rel=1e-12)
    assert body.inertia == pytest.approx(np.trace(about) * np.eye(3) - about, rel=1e-10)


BETA = np.array([1.87510406871, 4.69409113297, 7.85475743824])
# signed errors of a cantilever's frequencies, its translational mass lumped and its rotations condensed
LUMPED = {
    4: (-2.787e-2, -8.823e-2, -0.1377),
    8: (-7.118e-3, -2.419e-2, -3.920e-2),
    16: (-1.789e-3, -6.181e-3, -1.012e-2),
    32: (-4.479e-4, -1.553e-3, -2.549e-3),
    64: (-1.120e-4, -3.889e-4, -6.384e-4),
}


@pytest.mark.parametrize("divisions", LUMPED)
def test_table_of_lumped_masses(divisions):
    lumped = rod(divisions, UNIT, lumping=Lumping.POINTS, coordinates=("y", "rz"))
    body = discrete_body(lumped, interfaces=["root"], frame="root")
    errors = np.sqrt(body.stiffness[:3]) / BETA**2 - 1
    assert errors == pytest.approx(LUMPED[divisions], rel=1e-3)


def hencky(divisions):
    """Angular frequencies of rigid uniform segments, with springs E I / h between them and 2 E I / h at the clamp."""
    n, h = divisions, 1 / divisions
    k = 1 / h * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    k[0, 0], k[-1, -1] = 3 / h, 1 / h
    middles = h * (np.tril(np.ones((n, n)), -1) + np.eye(n) / 2)
    m = h * middles.T @ middles + h**3 / 12 * np.eye(n)
    return np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True))


@pytest.mark.parametrize("divisions", LUMPED)
def test_henckys_chain_has_the_same_spectrum(divisions):
    assert hencky(divisions)[:3] / BETA**2 - 1 == pytest.approx(LUMPED[divisions], rel=1e-3)
    lumped = rod(divisions, UNIT, lumping=Lumping.POINTS, coordinates=("y", "rz"))
    body = discrete_body(lumped, interfaces=["root"], frame="root")
    assert np.sqrt(body.stiffness) == pytest.approx(hencky(divisions), rel=1e-8)


def test_rigid_pieces_converge_with_h_squared_and_the_consistent_mass_with_h_to_the_fourth():
    """The price of an inconsistent mass. What rotary inertia the pieces have along the beam is of order h^2 too."""
    thin = dataclasses.replace(UNIT, Iz=1e-8, E=1e8)
    by_pieces, consistent = [], []
    for divisions in (8, 16):
        lumped = rod(divisions, thin, coordinates=("y", "rz"))
        rows = np.concatenate([6 * node + np.array([1, 5]) for node in stations(divisions)[1:]])
        mass = assembled(lumped.mesh.x, lumped.mesh.elements, [thin] * divisions, local_mass)
        for m, found in ((lumped.M, by_pieces), (mass, consistent)):
            values = scipy.linalg.eigh(lumped.K[np.ix_(rows, rows)], m[np.ix_(rows, rows)], eigvals_only=True)
            found.append(np.sqrt(values[:3]) / BETA**2 - 1)
    coarse, fine = by_pieces
    assert coarse / fine == pytest.approx(4, rel=0.1)
    coarse, fine = consistent
    assert (fine > 0).all()
    assert coarse / fine == pytest.approx(16, rel=0.1)


def full(lumped, clamped):
    """Frequencies, Hz, and flexibility of all nodal coordinates with some nodes held, by scipy."""
    free = lumped.active.copy()
    for name in clamped:
        node = lumped.node(name)
        free[6 * node : 6 * node + 6] = False
    k, m = (a[np.ix_(free, free)] for a in (lumped.K, lumped.M))
    values = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(np.maximum(values, 0)) / (2 * np.pi)


@pytest.mark.parametrize("body_frame", ["foot", None])
def test_record_without_reduction(body_frame):
    lumped = frame()
    body = discrete_body(lumped, interfaces=["left", "foot"], frame=body_frame)
    assert abs(body.modal_mass() - np.eye(body.n_modes)).max() < 1e-9
    assert body.frequencies()[:20] == pytest.approx(full(lumped, [])[6:26], rel=1e-7)
    for clamped in (["foot"], ["left"], ["left", "foot"]):
        assert body.frequencies(clamped)[:20] == pytest.approx(full(lumped, clamped)[:20], rel=1e-7)


@pytest.mark.parametrize("body_frame", ["foot", None])
def test_craig_bampton_is_exact_in_statics_and_converges_from_above(body_frame):
    lumped = frame(divisions=4)
    bodies = [discrete_body(lumped, interfaces=["foot", "left"], frame=body_frame, modes=n) for n in (0, 6, 20)]
    exact = full(lumped, ["foot"])[:4]
    errors = [body.frequencies(["foot"])[:4] / exact - 1 for body in bodies]
    assert (errors[0] > errors[1]).all()
    assert (errors[1] > errors[2]).all()
    assert (errors[2] > -1e-9).all()
    assert errors[2].max() < 1e-4
    assert [body.n_modes for body in bodies] == [6, 12, 26]
    held = [discrete_body(lumped, interfaces=["foot", "left"], frame="foot", modes=n) for n in (0, 6)]
    loads = [lumped.load("left", **{what: np.eye(3)[i]}) for what in ("force", "moment") for i in range(3)]
    moved = np.array([lumped.displaced(load, clamped=["foot"])[lumped.node("left")] for load in loads])
    for body in held:
        rows = body.interface("left").modes
        assert abs((rows / body.stiffness) @ rows.T - moved).max() < 1e-10 * abs(moved).max()


def test_mass_integrals_are_those_of_the_lumps():
    """Gram matrix of {1, x, modes} by points in each rigid piece, moved with its node."""
    lumped = rod(2, orientation := dataclasses.replace(BAR, Iyz=0.5e-7))
    body = discrete_body(lumped, interfaces=["tip"], frame="tip", modes=3)
    _, y, z = axes_of(np.array([1.0, 0, 0]), orientation.orientation)
    spread = np.linalg.cholesky(np.array([[BAR.Iz, 0.5e-7], [0.5e-7, BAR.Iy]]) / BAR.A)
    whole = discrete_body(lumped, interfaces=["tip", "root", "rod.1"], frame="tip", modes=None)
    # the modes at the nodes, by the other record's interfaces: its coordinates are a basis of all motions
    gauss, weight = np.polynomial.legendre.leggauss(2)
    expected = np.zeros((4 + 3 * whole.n_modes,) * 2)
    for name, start, end in (("root", 0, 0.25), ("rod.1", 0.25, 0.75), ("tip", 0.75, 1)):
        moving = whole.interface(name).modes
        node = whole.interface(name).p_BI_B
        for s, w in zip((start + end) / 2 + gauss * (end - start) / 2, weight * (end - start) / 2, strict=True):
            for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                offset = spread @ signs
                at = np.array([s, 0, 0]) - [1, 0, 0] + offset[0] * y + offset[1] * z
                phi = moving[:3] + np.cross(moving[3:].T, at - node).T
                fields = np.concatenate([[1.0], at, phi.T.ravel()])
                expected += BAR.rho * BAR.A * w / 4 * np.outer(fields, fields)
    assert abs(whole.gram - expected).max() < 1e-12 * abs(expected).max()
    assert body.mass_matrix()[:6, :6] == pytest.approx(whole.mass_matrix()[:6, :6], rel=1e-12, abs=1e-12)


def test_in_the_plane():
    """The lowest bending of a frame in the plane, and nothing out of it."""
    points = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0), "c": (1.0, 0.8, 0.0)}
    beams = {"knee": [("a", "b"), ("b", "c")]}
    section = dataclasses.replace(BAR, orientation=(0.0, 0.0, 1.0))
    space, plane = (
        discrete_body(
            DiscreteFrame(points, beams, {"knee": section}, divisions=4, **more), interfaces=["a", "c"], frame="a"
        )
        for more in ({}, {"coordinates": PLANE})
    )
    assert (space.n_modes, plane.n_modes) == (48, 24)
    assert not plane.interface("c").modes[[2, 3, 4]].any()
    inside = [i for i in range(48) if abs(space.interface("c").modes[[0, 1, 5], i]).max() > 1e-6]
    assert plane.stiffness == pytest.approx(space.stiffness[inside], rel=1e-8)
    free = discrete_body(
        DiscreteFrame(points, beams, {"knee": section}, divisions=4, coordinates=PLANE), frame=None, modes=5
    )
    assert free.frequencies()[:5] == pytest.approx(plane.frequencies()[:5], rel=1e-8)


def test_modal_damping():
    how = {"damping_ratio": 0.03, "damping_held": ["root"]}
    body = discrete_body(rod(4), interfaces=["root"], frame="root", modes=5, **how)
    assert body.damping == pytest.approx(np.diag(0.06 * np.sqrt(body.stiffness)))


def test_in_the_machine():
    """A cantilever's tip under a force that comes at once: the sum of its modes' answers, as long as it is small."""
    body = discrete_body(rod(3), interfaces=["root", "tip"], frame="root", modes=2, **DAMPED)
    scene = fm.System()
    arm = scene.add(fm.FlexibleBody(body), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), arm.frame("root"))
    force = 1.0
    scene.add_force(fm.force.FrameForce(arm.frame("tip"), force=(0.0, 0.0, force)))
    run = scene.simulate(t_end=0.1, rtol=1e-7)
    phi, omega = body.interface("tip").modes[2], np.sqrt(body.stiffness)
    damped = omega * np.sqrt(1 - 0.05**2)
    t = np.asarray(run.t)[:, None]
    answer = 1 - np.exp(-0.05 * omega * t) * (np.cos(damped * t) + 0.05 * omega / damped * np.sin(damped * t))
    exact = (phi**2 / omega**2 * answer).sum(axis=1) * force
    found = np.asarray(run.position(arm.frame("tip")))[:, 2]
    assert abs(found - exact).max() < 1e-5 * abs(exact).max()


def test_a_load_away_from_a_node_is_refused():
    lumped = rod(4)
    assert np.flatnonzero(lumped.load((0.25, 0, 0), force=(0, 2.0, 0))).tolist() == [6 * lumped.node("rod.1") + 1]
    with pytest.raises(SceneError, match=r"joints go to nodes alone; the nearest is 'rod\.2' at .* 0\.06 m away"):
        lumped.load((0.56, 0.0, 0.0), force=(0.0, 1.0, 0.0))
    with pytest.raises(SceneError, match=r"no node 'middle'; the points are: 'root', 'tip'; inside .* 'rod\.1'"):
        lumped.load("middle", force=(0.0, 1.0, 0.0))
    with pytest.raises(SceneError, match="no node 'middle'"):
        discrete_body(lumped, interfaces=["root", "middle"], frame="root")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": 0.0}, "section of 'rod': A must be positive and finite, got 0"),
        ({"Iyz": 1.3e-7}, r"Iyz\^2 must be less than Iy Iz"),
        ({"kz": 0.0}, "kz must be positive"),
        ({"E": np.inf}, "E must be positive and finite"),
        ({"nu": 0.5}, "nu must lie between"),
        ({"orientation": (1.0, 0.0, 0.0)}, "orientation .* along a beam of the group"),
        ({"orientation": (0.0, 0.0, 0.0)}, "orientation .* along a beam of the group"),
    ],
)
def test_sections_that_are_none(change, message):
    with pytest.raises(SceneError, match=message):
        rod(2, dataclasses.replace(BAR, **change))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rod(2, coordinates=("x", "y", "turn")), "coordinates must be some of"),
        (lambda: rod(2, lumping="points"), "lumping must be"),
        (lambda: DiscreteFrame(POINTS, BEAMS, {"mast": BAR}, divisions=1), "sections are given for 'mast'; give one"),
        (lambda: discrete_body(rod(2), interfaces=["tip"], frame="root"), "'root' is not among the interfaces: 'tip'"),
        (lambda: discrete_body(rod(2), interfaces=["tip", "tip"], frame="tip"), "given twice"),
        (lambda: discrete_body(rod(2), interfaces=["tip"], frame="tip", modes=13), "13 modes .* has 12"),
        (lambda: discrete_body(rod(2), frame=None, modes=13), "13 modes .* has 12"),
        (lambda: discrete_body(rod(2), interfaces=["tip"], frame="tip", damping_ratio=1.2), "ratio must lie between"),
        (lambda: discrete_body(rod(2), frame=None, modes=1, damping_held=["root"]), "'root' is not among"),
        (lambda: discrete_body(rod(1), interfaces=["tip"], frame="tip", damping_ratio=[0.1]), "1 damping ratios for 6"),
        (lambda: rod(2).displaced(np.zeros(18), clamped=[]), "clamp a node"),
        (lambda: rod(2).node((0.0, 0.0)), "three finite coordinates"),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(SceneError, match=message):
        call()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [2.0**-24, 2.0**24])
def test_bodies_of_any_size(size):
    """Lengths times a power of two, and density and modulus such that frequencies stay: they do, without a warning."""
    ends = {"root": (0.0, 0.0, 0.0), "tip": (size, 0.3 * size, 0.0)}
    areas = {"A": BAR.A * size**2, **{name: getattr(BAR, name) * size**4 for name in ("Iy", "Iz", "J")}}
    section = dataclasses.replace(BAR, E=BAR.E * size**2, **areas)
    lumped = DiscreteFrame(ends, {"rod": [("root", "tip")]}, {"rod": section}, divisions=4)
    body = discrete_body(lumped, interfaces=["root", "tip"], frame="root", modes=3)
    ends["tip"] = (1.0, 0.3, 0.0)
    lumped = DiscreteFrame(ends, {"rod": [("root", "tip")]}, {"rod": BAR}, divisions=4)
    usual = discrete_body(lumped, interfaces=["root", "tip"], frame="root", modes=3)
    np.testing.assert_allclose(body.frequencies(("root",)), usual.frequencies(("root",)), rtol=1e-10)
