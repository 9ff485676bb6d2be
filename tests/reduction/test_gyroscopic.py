"""Kinetic energy linear in the rates, from a form to machines: whirling shafts, gyroscopes, free flight."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NonlinearModel, homogeneous_energy, load_form
from flexmbd.errors import ExportError, FlexmbdError, FormulationError, RecordError
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.reduction import craig_bampton, prestressed

FILE = Path(__file__).parents[1] / "data" / "spinning_shaft.py"
TEXT = FILE.read_text()
FORM = load_form(FILE)
LENGTH = 1.0
ROD = beam.Parameters.tube(2.1e11, 0.3, 7850.0, outer_radius=0.05, orientation=(0.0, 1.0, 0.0))
EIGHT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
INTEGRATORS = [
    fm.GeneralizedAlpha(), fm.RadauIIA(), fm.ExplicitRungeKutta(),
    fm.EnergyMomentum(),
]  # fmt: skip


def model(spin, *, divisions=12, comm=MPI.COMM_SELF, form=FORM):
    mesh = meshes.line(LENGTH, divisions=divisions, comm=comm)
    ends = [Interface("start"), Interface("end")]
    return ContinuumModel(mesh, form, form.Parameters(ROD, spin), degree=2, interfaces=ends)


def shaft(spin, *, modes=6, divisions=12, frame="start", comm=MPI.COMM_SELF):
    return craig_bampton(model(spin, divisions=divisions, comm=comm), modes=modes, frame=frame)


def polar_momentum(spin):
    """N m s: of the whole shaft's sections."""
    return ROD.rho * (ROD.Iy + ROD.Iz) * spin * LENGTH


def whirl(spin, k):
    """rad/s, of the wave number k: Timoshenko's beam on hinges, its sections spinning; z = y + i z turns.

    rho A z'' = -S k (k z - phi), rho I phi'' - i rho Ip spin phi' = S (k z - phi) - E I k^2 phi.
    """
    inertia, shear = ROD.rho * ROD.Iy, ROD.ky * ROD.E / (2 * (1 + ROD.nu)) * ROD.A
    mass = np.diag([ROD.rho * ROD.A, inertia])
    stiffness = np.array([[shear * k**2, -shear * k], [-shear * k, shear + ROD.E * ROD.Iy * k**2]])
    turning = np.diag([0.0, -1j * ROD.rho * (ROD.Iy + ROD.Iz) * spin])
    below = [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, turning)]
    first = np.block([[np.zeros((2, 2)), np.eye(2)], below])
    return np.sort(np.linalg.eigvals(first).imag)


def test_the_momentum_lies_along_the_shaft():
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    mesh = meshes.line(LENGTH, divisions=3, comm=MPI.COMM_SELF)
    mesh.mesh.geometry.x[:] = mesh.mesh.geometry.x[:, :1] * axis
    part = ContinuumModel(mesh, FORM, FORM.Parameters(ROD, 2000.0), degree=2, interfaces=[Interface("start")])
    rotors = craig_bampton(part, modes=0, frame="start").gyroscopic
    exact = polar_momentum(2000.0) * axis
    np.testing.assert_allclose(rotors.momentum, exact, rtol=0, atol=1e-12 * np.linalg.norm(exact))


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # pairs are kept whole
@pytest.mark.mpi
def test_the_record_has_the_rotors_momentum_and_a_skew_matrix():
    body = shaft(2000.0, comm=MPI.COMM_WORLD)
    rotors = body.gyroscopic
    np.testing.assert_allclose(rotors.momentum, [polar_momentum(2000.0), 0, 0], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(rotors.G, -rotors.G.T)
    still = shaft(0.0, comm=MPI.COMM_WORLD)
    np.testing.assert_allclose(body.stiffness, still.stiffness, rtol=1e-12)
    for name in ("momentum", "slope", "G"):
        assert not getattr(still.gyroscopic, name).any()


@pytest.mark.parametrize("frame", ["start", None])
def test_forward_and_backward_whirl(frame):
    """Of a shaft on hinges that no twist passes: the lowest four, split by the spin; undamped."""
    spin = 2000.0
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(shaft(spin, modes=20, divisions=24, frame=frame)), name="shaft")
    scene.connect(fm.joint.Universal("y", "z"), scene.ground.frame(), body.frame("start"))
    scene.connect(fm.joint.PointOnLine("x"), scene.ground.frame(), body.frame("end"))
    values = np.array(scene.linearize().eigenvalues())
    found = np.unique(values.imag[values.imag > 1.0].round(6))[:4]
    exact = np.sort(np.concatenate([abs(whirl(spin, n * np.pi / LENGTH))[1:3] for n in (1, 2)]))
    assert exact[1] / exact[0] > 1.015
    np.testing.assert_allclose(found, exact, rtol=5e-5)
    assert abs(values.real).max() < 1e-9 * abs(values).max()


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: type(one).__name__)
def test_a_horizontal_gyroscope_precesses(integrator):
    """Held at one end under gravity it turns about the vertical by m g l / h, and does not fall."""
    spin, g = 3000.0, 9.81
    record = shaft(spin, modes=0)
    weight = record.mass * g * LENGTH / 2
    rate = weight / polar_momentum(spin)
    scene = fm.System(gravity=(0.0, 0.0, -g))
    body = scene.add(fm.FlexibleBody(record), name="gyroscope")
    pivot = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame("start"))
    pivot.velocity = (0.0, 0.0, rate)
    run = scene.simulate(1.0, rtol=1e-5, integrator=integrator)
    tip = run.position(body.frame("end"))
    sag = 1.5e-4  # m: bends by its weight, and vibrates about that
    assert abs(tip[:, 2]).max() < 2 * sag
    np.testing.assert_allclose(tip[:, 0], np.cos(rate * run.t), atol=2 * sag)
    np.testing.assert_allclose(tip[:, 1], np.sin(rate * run.t), atol=2 * sag)
    assert np.ptp(run.energy().total) < 1e-3 * weight * LENGTH


def tumbling(spin=3000.0):
    """A soft shaft in free flight, its end pushed aside, that turns about all axes."""
    soft = replace(ROD, E=2e8)
    mesh = meshes.line(LENGTH, divisions=8, comm=MPI.COMM_SELF)
    ends = [Interface("start"), Interface("end")]
    record = craig_bampton(
        ContinuumModel(mesh, FORM, FORM.Parameters(soft, spin), degree=2, interfaces=ends), modes=2, frame=None
    )
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="shaft")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.velocity = (0.3, -0.2, 0.1, 2.0, 5.0, -3.0)
    return scene, body, record


def test_free_flight_keeps_energy_and_the_whole_angular_momentum():
    """That of the mass and h + H q of the rotors; neither alone is kept."""
    scene, body, record = tumbling()
    run = scene.simulate(0.1, rtol=1e-10, integrator=EIGHT)
    whole = run.momentum().angular
    rotors = record.gyroscopic.momentum + run.q(body) @ record.gyroscopic.slope.T
    own = whole - np.einsum("tij,tj->ti", run.rotation(body.frame()), rotors)
    size = np.linalg.norm(whole[0])
    assert np.ptp(own, axis=0).max() > 0.1 * size
    assert np.ptp(whole, axis=0).max() < 1e-8 * size
    energy = run.energy()
    assert np.ptp(energy.elastic) > 1e-3 * energy.total[0]
    assert np.ptp(energy.total) < 1e-8 * energy.total[0]


@pytest.mark.parametrize("integrator", INTEGRATORS[:2] + INTEGRATORS[3:], ids=lambda one: type(one).__name__)
def test_implicit_methods_fly_alike(integrator):
    scene, *_ = tumbling()
    exact = scene.simulate(0.05, rtol=1e-9, integrator=EIGHT)
    run = tumbling()[0].simulate(0.05, rtol=1e-6, integrator=integrator)
    found, expected = run.x[-1], exact.x[-1]
    np.testing.assert_allclose(found, expected, atol=2e-4 * abs(expected).max())
    total = run.energy().total
    assert np.ptp(total) < (1e-9 if isinstance(integrator, fm.EnergyMomentum) else 1e-3) * total[0]


def test_it_is_in_the_file_and_in_the_fingerprint(tmp_path):
    record = shaft(500.0, modes=2)
    record.save(tmp_path / "shaft.h5")
    back = fm.ReducedBody.load(tmp_path / "shaft.h5")
    for name in ("momentum", "slope", "G"):
        np.testing.assert_array_equal(getattr(back.gyroscopic, name), getattr(record.gyroscopic, name))
    assert back.fingerprint() == record.fingerprint() != replace(record, gyroscopic=None).fingerprint()
    assert "angular momentum" in record.inspect()
    wrong = replace(record.gyroscopic, G=np.eye(record.n_modes))
    with pytest.raises(RecordError, match="not skew"):
        replace(record, gyroscopic=wrong)


def test_formats_carry_it_or_refuse(tmp_path):
    record = shaft(500.0, modes=2)
    assert fm.export.npz(record, tmp_path / "shaft.npz") == ()
    back = fm.export.read_npz(tmp_path / "shaft.npz")
    np.testing.assert_array_equal(back.gyroscopic.G, record.gyroscopic.G)
    with pytest.raises(ExportError, match="lost would be the gyroscopic forces of the rotors"):
        fm.export.mbdyn(record, tmp_path / "shaft.fem")
    lost = fm.export.mbdyn(record, tmp_path / "shaft.fem", lossy=True)
    assert "the gyroscopic forces of the rotors inside it" in lost


@pytest.mark.parametrize(
    ("density", "told"),
    [
        ("momentum * ufl.dot(_turn(v), _tangent(u))", "must be linear in u and in v"),
        ("momentum * ufl.dot(_turn(v), _turn(v))", "must be linear in u and in v"),
        ("momentum * ufl.dot(_turn(v), _turn(u))", "is symmetric in u and v, and makes no force"),
        ("momentum * ufl.dot(_tangent(u), ufl.cross(v_(v), v_(u)))", "acts on translations of the whole body"),
        ("momentum * _turn(u)", "the integrand must be scalar"),
    ],
)
def test_what_is_no_gyroscopic_energy_is_refused(tmp_path, density, told):
    density_now = "momentum / 2 * ufl.dot(_tangent(u), ufl.cross(_turn(v), _turn(u)))"
    assert density_now in TEXT
    path = tmp_path / "my_form.py"
    more = "\n\ndef v_(u):\n    return ufl.as_vector([u[i] for i in range(3)])\n"
    path.write_text(TEXT.replace(density_now, density) + more)
    with pytest.raises(FormulationError, match=f"gyroscopic: .*{told}"):
        load_form(path)


def test_a_part_linear_in_the_rates_belongs_there(tmp_path):
    path = tmp_path / "my_form.py"
    path.write_text(TEXT.replace("return beam.kinetic_energy(v, p.beam)", 'return [(v[0], beam.Quadrature(2))]'))
    with pytest.raises(FormulationError, match=r"a part linear in v: write what is linear .* as gyroscopic\(u, v, p\)"):
        load_form(path)


def test_what_would_leave_it_out_refuses_it():
    one = model(500.0)
    loaded = prestressed(one, frame="start", angular_velocity=(0.0, 0.0, 1.0))
    refused = [
        (lambda: craig_bampton(loaded, modes=2, frame="start"), "about a loaded state"),
        (lambda: NonlinearModel(one.mesh, FORM, FORM.Parameters(ROD, 1.0), degree=2), "a body with history would"),
    ]
    for attempt, told in refused:
        with pytest.raises(FlexmbdError, match=told):
            attempt()


def test_a_pseudo_rigid_body_refuses_it(tmp_path):
    path = tmp_path / "my_form.py"
    text = (FILE.parent / "viscous_solid.py").read_text().replace("def dissipation", "def _unused")
    more = "\n\ndef gyroscopic(u, v, p):\n    return [(p.rho * ufl.curl(u)[0] * ufl.curl(v)[1], Quadrature(2))]\n"
    path.write_text(text + more)
    form = load_form(path)
    with pytest.raises(FormulationError, match="a pseudo-rigid body would leave out"):
        homogeneous_energy(form, form.Parameters(mu=8.0e10, bulk=1.7e11, rho=7850.0, eta=1.0, zeta=1.0))
