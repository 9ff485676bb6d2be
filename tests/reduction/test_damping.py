"""Damping of a reduced body: ratios of modes, and viscous stress against matrices of the unreduced model."""

from mpi4py import MPI

import numpy as np
import pytest
from bracket import ALUMINIUM, bracket
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ReductionError
from flexmbd.forms import solid_linear
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
    body = reduction(model, frame=frame, damping=ModalDamping(ratios))
    omega = np.sqrt(body.stiffness)
    assert np.array_equal(body.stiffness, plain.stiffness)
    assert body.damping == pytest.approx(np.diag(2.0 * ratios * omega), rel=1e-14)
    same = reduction(model, frame=frame, damping=ModalDamping(0.02))
    roots = np.linalg.eigvals(
        np.block([[np.zeros((len(omega),) * 2), np.eye(len(omega))], [-np.diag(omega**2), -same.damping]])
    )
    assert -roots.real / abs(roots) == pytest.approx(0.02, rel=1e-10)


@pytest.mark.parametrize("frame", ["root", None])
def test_rayleigh(frame):
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    damping = RayleighDamping(alpha=30.0, beta=2e-5)
    body = craig_bampton(model, modes=4, frame=frame, damping=damping, keep=Keep(modes=True))
    full, phi = FullModel(model), modes_of(body)
    expected = phi.T @ (30.0 * full.M + 2e-5 * full.K) @ phi
    assert abs(body.damping - expected).max() < 1e-9 * abs(expected).max()
    assert body.provenance["damping"] == "Rayleigh, alpha 30 1/s, beta 2e-05 s"


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


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("damping", "match"),
    [
        (0.02, r"write ModalDamping\(0\.02\)"),
        (ModalDamping([0.1, 0.2]), "2 damping ratios for 6 modes"),
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
