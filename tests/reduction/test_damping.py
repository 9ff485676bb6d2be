"""Damping of a reduced body: ratios of modes, and viscous stress against matrices of the unreduced model."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from bracket import ALUMINIUM, bracket
from full_model import FullModel

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, SymmetryPlane
from flexmbd.errors import InterfaceError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.record.summary import damping_ratios
from flexmbd.reduction import Keep, KelvinVoigtDamping, ModalDamping, RayleighDamping, craig_bampton, guyan

RUBBER = solid_linear.Parameters(E=5.0e6, nu=0.4, rho=1100.0)


def sandwich(core=RUBBER, face=ALUMINIUM, *, comm=MPI.COMM_WORLD):
    """A plate of aluminium with a layer of rubber."""
    mesh = meshes.block(
        0.3, 0.05, 0.02, divisions=(4, 1, 2), layers=("face", "core"), cell="tetrahedron", comm=comm
    )
    pairs = {"face": (solid_linear, face), "core": (solid_linear, core)}
    return ContinuumModel(mesh, pairs, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])


def modes_of(body):
    """(3 n, modes) in the mesh's axes, by the numbers of the nodes."""
    return np.einsum("ab,kbn->kan", body.R_MB, body.modes.phi).reshape(-1, body.n_modes)


@pytest.mark.parametrize("frame", ["root", None])
@pytest.mark.parametrize("reduction", [guyan, lambda model, **more: craig_bampton(model, modes=3, **more)])
def test_modal_ratios(frame, reduction):
    """Each mode decays by its own ratio, with no mode coupled to another."""
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    plain = reduction(model, frame=frame)
    assert not plain.damping.any()
    ratios = np.linspace(0.0, 1.0, plain.n_modes)
    held = () if frame is None else [frame]
    body = reduction(model, frame=frame, damping=ModalDamping(ratios, held=held))
    omega = np.sqrt(body.stiffness)
    assert np.array_equal(body.stiffness, plain.stiffness)
    expected = np.diag(2.0 * ratios * omega)
    np.testing.assert_allclose(body.damping, expected, rtol=1e-13, atol=1e-13 * expected.max())
    same = reduction(model, frame=frame, damping=ModalDamping(0.02, held=held))
    roots = np.linalg.eigvals(
        np.block([[np.zeros((len(omega),) * 2), np.eye(len(omega))], [-np.diag(omega**2), -same.damping]])
    )
    assert -roots.real / abs(roots) == pytest.approx(0.02, rel=1e-10)


@pytest.mark.parametrize("frame", ["root", None])
def test_rayleigh(frame):
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    held = () if frame is None else [frame]
    damping = RayleighDamping(alpha=30.0, beta=2e-5, held=held)
    body = craig_bampton(model, modes=4, frame=frame, damping=damping, keep=Keep(modes=True))
    full, phi = FullModel(model), modes_of(body)
    expected = phi.T @ (30.0 * full.M + 2e-5 * full.K) @ phi
    assert abs(body.damping - expected).max() < 1e-9 * abs(expected).max()
    state = "of the free body" if frame is None else "of the body held at root"
    assert body.provenance["damping"] == f"Rayleigh, alpha 30 1/s, beta 2e-05 s, {state}"


DAMPINGS = [
    ModalDamping(0.05),
    ModalDamping(0.05, held=["root"]),
    ModalDamping(0.05, held=["root", "tip"]),
    RayleighDamping(alpha=30.0, beta=2e-5),
    RayleighDamping(alpha=30.0, beta=2e-5, held=["tip"]),
    KelvinVoigtDamping(1e-5),
]


def vibrations(body, clamped):
    """Eigenvalues (1/s) of what swings in a machine, the lowest first."""
    scene = fm.System()
    part = scene.add(fm.FlexibleBody(body), name="part")
    for name in clamped:
        face = body.interface(name)
        scene.connect(fm.joint.Fixed(), scene.ground.frame(p=face.p_BI_B, R=face.R_BI), part.frame(name), name=name)
    if not clamped:
        scene.connect(fm.joint.Free(), scene.ground.frame(), part.frame())
    found = scene.linearize().eigenvalues()
    swinging = found[found.imag > 1.0]
    return swinging[np.argsort(swinging.imag)]


@pytest.fixture(scope="module")
def framed():
    """One body by each choice of its frame, for a damping."""
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    return lambda damping: [
        craig_bampton(model, modes=4, frame=frame, damping=damping, geometric_stiffness=False)
        for frame in ("root", "tip", None)
    ]


@pytest.mark.parametrize("damping", DAMPINGS, ids=str)
def test_a_machine_does_not_see_what_carries_the_frame(framed, damping):
    """Free, clamped at either end and at both: frequencies and decays are the same."""
    bodies = framed(damping)
    for clamped in ((), ("root",), ("tip",), ("root", "tip")):
        first, *others = (vibrations(body, clamped) for body in bodies)
        assert (first.real < 0.0).all()
        for other in others:
            assert abs(other - first).max() < 1e-7 * abs(first).max()
            np.testing.assert_allclose(other.real[:4], first.real[:4], rtol=1e-6)


@pytest.mark.parametrize(("held", "clamped"), [((), ()), (["tip"], ("tip",)), (["root", "tip"], ("root", "tip"))])
def test_ratios_are_those_of_the_body_in_the_state_that_is_named(framed, held, clamped):
    """By the definition of a ratio; the stiffness' part of Rayleigh's in every state, the mass' in that one."""
    for body in framed(ModalDamping(0.05, held=held)):
        found = vibrations(body, clamped)
        assert -found.real / abs(found) == pytest.approx(0.05, rel=1e-6)
    for body in framed(RayleighDamping(30.0, 2e-5, held=held)):
        found = vibrations(body, clamped)
        size = abs(found)
        assert -found.real == pytest.approx((30.0 + 2e-5 * size**2) / 2.0, rel=1e-6)


def test_the_free_bodys_damping_against_all_of_its_modes():
    """A cantilever by the unreduced matrices: free modes of 5 %, each with its own force, on the clamped body."""
    model = sandwich(comm=MPI.COMM_SELF)
    full = FullModel(model)
    bound = full.bound([(abs(full.x[:, 0] - one.p[0]) < 1e-9, one.p) for one in model.interfaces]).toarray()
    K, M = bound.T @ full.K @ bound, bound.T @ full.M @ bound
    values, modes = scipy.linalg.eigh(K, M)
    forces = M @ modes[:, 6:]
    D = (forces * (0.1 * np.sqrt(values[6:]))) @ forces.T
    values, modes = scipy.linalg.eigh(K[6:, 6:], M[6:, 6:])  # the first interface at rest
    expected = np.einsum("im,ij,jm->m", modes, D[6:, 6:], modes) / 2.0 / np.sqrt(values)
    assert expected[0] < 0.01
    body = craig_bampton(model, modes=30, frame="x_max", damping=ModalDamping(0.05))
    assert damping_ratios(body)["x_min"][:3] == pytest.approx(expected[:3], rel=3e-3)


def test_half_of_a_part_is_damped_as_the_whole():
    """A symmetry plane leaves the half free along itself alone; symmetric modes have the ratios of the whole part."""
    ends = [Interface("x_min"), Interface("x_max")]
    whole = meshes.block(0.3, 0.05, 0.02, divisions=(4, 2, 1), cell="hexahedron")
    half = meshes.block(0.3, 0.025, 0.02, divisions=(4, 1, 1), cell="hexahedron")
    symmetry = [SymmetryPlane("y_min", (0.0, 1.0, 0.0))]
    models = (
        ContinuumModel(half, solid_linear, ALUMINIUM, degree=1, interfaces=ends, supports=symmetry),
        ContinuumModel(whole, solid_linear, ALUMINIUM, degree=1, interfaces=ends),
    )
    found = []
    for model, parts, modes in zip(models, (2.0, 1.0), (20, 40), strict=True):
        how = {"damping": ModalDamping(0.05), "geometric_stiffness": False}
        body = craig_bampton(model, modes=modes, frame="x_min", **how)
        # the power of the whole that moves as unit forces on its end, in the plane, deform it
        rates = body.interface("x_max").modes[[0, 2, 4]] / body.stiffness / parts
        found.append(parts * np.diag(rates @ body.damping @ rates.T))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("frame", ["x_min", None])
def test_viscous_layers(frame):
    """The stiffness of each layer from two models whose layer differs in Young's modulus."""
    tau = {"face": 1e-6, "core": 3e-4}
    model = sandwich()
    body = craig_bampton(
        model, modes=4, frame=frame, damping=KelvinVoigtDamping(tau), keep=Keep(modes=True)
    )
    stiff = solid_linear.Parameters(E=2 * RUBBER.E, nu=RUBBER.nu, rho=RUBBER.rho)
    K, more = FullModel(model).K, FullModel(sandwich(stiff)).K
    of_core = more - K
    phi = modes_of(body)
    expected = phi.T @ (tau["core"] * of_core + tau["face"] * (K - of_core)) @ phi
    assert abs(body.damping - expected).max() < 1e-9 * abs(expected).max()
    assert abs(body.damping - np.diag(np.diag(body.damping))).max() > 0.01 * abs(expected).max()
    assert np.linalg.eigvalsh(body.damping)[0] > 0.0
    assert len(set(MPI.COMM_WORLD.allgather(body.damping.tobytes()))) == 1
    alike = dict.fromkeys(tau, 1e-5)
    both = [
        craig_bampton(model, modes=4, frame=frame, damping=KelvinVoigtDamping(one))
        for one in (1e-5, alike)
    ]
    assert both[0].damping == pytest.approx(np.diag(1e-5 * both[0].stiffness), rel=1e-14)
    assert abs(both[1].damping - both[0].damping).max() < 1e-9 * both[0].damping.max()


def test_saved_and_loaded(tmp_path):
    body = guyan(sandwich(comm=MPI.COMM_SELF), frame="x_min", damping=KelvinVoigtDamping({"face": 0.0, "core": 1e-4}))
    body.save(tmp_path / "body.h5")
    again = type(body).load(tmp_path / "body.h5")
    assert np.array_equal(again.damping, body.damping)
    assert again.provenance["damping"] == "Kelvin-Voigt, tau 0 s in face, 0.0001 s in core"


@pytest.mark.parametrize("ratio", [-0.01, 1.01, np.nan, np.inf, "2 %", None, [0.1, -0.1], [[0.1]]])
def test_bad_ratios_are_refused(ratio):
    with pytest.raises(ReductionError, match="damping ratio must"):
        ModalDamping(ratio)


@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf, "x", None])
def test_bad_coefficients_are_refused(value):
    with pytest.raises(ReductionError, match="alpha of a Rayleigh damping must be a finite number from 0 on"):
        RayleighDamping(value, 0.0)
    with pytest.raises(ReductionError, match="beta of a Rayleigh damping must be a finite number from 0 on"):
        RayleighDamping(0.0, value)
    for tau in (value, {"face": 1.0, "core": value}):
        with pytest.raises(ReductionError, match="tau of a Kelvin-Voigt damping must be a finite number from 0 on"):
            KelvinVoigtDamping(tau)


@pytest.mark.parametrize("held", ["root", None, 3, [1], ["root", "root"]])
def test_what_is_no_list_of_interfaces_is_refused(held):
    for make in (lambda: ModalDamping(0.1, held), lambda: RayleighDamping(1.0, 0.0, held)):
        with pytest.raises(ReductionError, match=r"held (must be a list of interfaces'|names an interface twice)"):
            make()


def test_an_interface_that_is_not_there_is_refused():
    with pytest.raises(InterfaceError, match="no interface 'x_mean'; it has: 'x_min', 'x_max'"):
        guyan(sandwich(comm=MPI.COMM_SELF), frame="x_min", damping=ModalDamping(0.1, held=["x_mean"]))


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("damping", "match"),
    [
        (0.02, r"write ModalDamping\(0\.02\)"),
        (ModalDamping([0.1, 0.2]), "2 damping ratios for 6 modes"),
        (ModalDamping([0.1] * 6, held=["x_min", "x_max"]), "6 damping ratios for 0 modes"),
        (KelvinVoigtDamping({"face": 1.0}), "one for each cell group of the model: 'face', 'core'"),
        (KelvinVoigtDamping({"face": 1.0, "core": 1.0, "lid": 1.0}), "cell group of the model: 'face', 'core'"),
    ],
)
def test_damping_that_does_not_fit_is_refused_on_every_rank(damping, match):
    with pytest.raises(ReductionError, match=match):
        guyan(sandwich(), frame="x_min", damping=damping)


def test_groups_of_a_body_that_has_none():
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    with pytest.raises(ReductionError, match="which has none"):
        guyan(model, frame="root", damping=KelvinVoigtDamping({"a": 1.0}))
