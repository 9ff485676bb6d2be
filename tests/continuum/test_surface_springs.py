"""Springs and mass on facets of bodies with history: rods of one dimension, in slow loading, explicit and implicit."""

import types
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    RegularCheckpoints,
    Support,
    TractionOnFacets,
    follow,
    load_form,
    lumped_mass,
    prescribed_dofs,
)
from flexmbd.continuum.history.history_file import load_body, save_body
from flexmbd.errors import FormulationError, SceneError
from flexmbd.forms import st_venant_kirchhoff, updated_lagrangian

FILE = Path(__file__).parents[1] / "data" / "founded_solid.py"
FORM = load_form(FILE)
MASS_ALONE = types.ModuleType("mass_alone")
MASS_ALONE.__dict__.update({name: value for name, value in vars(FORM).items() if name != "surface_energy"})
MASS_ALONE.__dict__.update({"__name__": "mass_alone", "__file__": None})
E, RHO = 2.0e9, 1000.0
L, B, H = 0.2, 0.02, 0.02
SOLIDS = {
    "initial": (st_venant_kirchhoff, st_venant_kirchhoff.Parameters(E=E, nu=0.0, rho=RHO)),
    "updated": (updated_lagrangian, updated_lagrangian.Parameters(E=E, nu=0.0, rho=RHO, yield_stress=1e12)),
}


def rod(surfaces=None, *, solid="initial", ends=(), divisions=(6, 1, 1), comm=MPI.COMM_WORLD):
    mesh = meshes.block(L, B, H, divisions=divisions, comm=comm)
    form, p = SOLIDS[solid]
    interfaces = [Interface(name) for name in ends]
    return NonlinearModel(mesh, form, p, degree=1, interfaces=interfaces, surfaces=surfaces)


def ramp(t):
    return t


def on_facets(form=FORM, **values):
    return form, form.Parameters(E=E, nu=0.0, rho=RHO, **values)


@pytest.mark.mpi
@pytest.mark.parametrize("solid", SOLIDS)
def test_a_rod_pulled_against_springs(solid):
    """Its end moves by t / (E / L + k) under the traction t; in two steps, of which the second begins displaced."""
    k, t = 1.5e10, 1e5
    body = rod({"x_max": on_facets(normal=k)}, solid=solid)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    end = body.layout.nodes_on(2, body.mesh.facets("x_max"))
    pull = TractionOnFacets("x_max", (t, 0.0, 0.0), factor=ramp)
    expected = t / (E / L + k)
    follow(body, [0.5, 1.0], prescribed=held, loads=[pull])
    found = body.displacement[body.displacement_dofs[end, 0]]
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    energies = body.energies()
    assert energies["springs"] == pytest.approx(k * B * H * expected**2 / 2, rel=2e-4)
    assert energies["elastic"] == pytest.approx(E / L * B * H * expected**2 / 2, rel=1e-3)


@pytest.mark.mpi
def test_springs_that_harden(tmp_path):
    """c u^3 on the end, against the root of E / L u + c u^3 = t; Newton's method converges as by a tangent."""
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "hardening.py"))
    if MPI.COMM_WORLD.rank == 0:
        text = FILE.read_text()
        assert "energy = p.normal / 2 * along**2" in text
        Path(path).write_text(text.replace("energy = p.normal / 2 * along**2", "energy = p.normal / 4 * along**4"))
    MPI.COMM_WORLD.barrier()
    c, t = 5e20, 1e5
    body = rod({"x_max": on_facets(load_form(Path(path)), normal=c)})
    held = prescribed_dofs(body, {"x_min": "xyz"})
    done = follow(body, [1.0], prescribed=held, loads=[TractionOnFacets("x_max", (t, 0.0, 0.0), factor=ramp)])
    exact = scipy.optimize.brentq(lambda u: E / L * u + c * u**3 - t, 0.0, t / (E / L))
    assert exact < 0.7 * t / (E / L)
    end = body.layout.nodes_on(2, body.mesh.facets("x_max"))
    np.testing.assert_allclose(body.displacement[body.displacement_dofs[end, 0]], exact, rtol=1e-4)
    assert len(done.steps[0].residuals) < 10


@pytest.mark.mpi
@pytest.mark.parametrize("solid", SOLIDS)
def test_mass_on_an_end_in_both_mass_matrices(solid):
    """Of the end's nodes a quarter each of m A; the whole is rho V + m A."""
    m = 40.0
    bodies = [rod(given, solid=solid) for given in (None, {"x_max": on_facets(mass=m)})]
    total = [body.comm.allreduce(lumped_mass(body).sum()) / 3 for body in bodies]
    assert total == pytest.approx([RHO * L * B * H, RHO * L * B * H + m * B * H], rel=1e-12)
    added = np.subtract(*(lumped_mass(body) for body in bodies[::-1]))
    x = bodies[0].layout.node_x[: bodies[0].layout.n_owned_nodes, 0]
    np.testing.assert_allclose(added.reshape(-1, 3)[x > 0.99 * L], m * B * H / 4, rtol=1e-12)
    np.testing.assert_allclose(added.reshape(-1, 3)[x < 0.99 * L], 0.0, atol=1e-15)
    ones = bodies[1].mass().createVecs()[0]
    ones.set(1.0)
    image = ones.duplicate()
    bodies[1].mass().mult(ones, image)
    assert image.dot(ones) / 3 == pytest.approx(total[1], rel=1e-12)


def first_root(ratio):
    """x tan x = ratio, the rod's mass over that on its end; omega = x c / L (Rao 2007, section 9.2)."""
    return scipy.optimize.brentq(lambda x: x * np.tan(x) - ratio, 1e-6, np.pi / 2 - 1e-6)


def test_an_explicit_rod_with_mass_on_its_end_vibrates_as_it_should():
    """From the first mode's velocities: after a quarter of its period the end is at rest, v / omega away."""
    m, v = 0.5 * RHO * L, 0.1
    root = first_root(RHO * L / m)
    omega = root * np.sqrt(E / RHO) / L
    body = rod({"x_max": on_facets(MASS_ALONE, mass=m)}, divisions=(40, 1, 1), comm=MPI.COMM_SELF)
    shape = np.sin(root) ** -1

    def velocity(x):
        return np.column_stack([v * shape * np.sin(root * x[:, 0] / L), 0 * x[:, 0], 0 * x[:, 0]])

    run = ExplicitRun(body, velocity=velocity, supports=[Support("x_min", x=True, y=True, z=True)])
    X = run.motion.x.copy()
    account = run.simulate(np.pi / 2 / omega)
    moved = (run.motion.x - X)[X[:, 0] > 0.99 * L, 0]
    np.testing.assert_allclose(moved, v / omega, rtol=2e-3)
    square = 0.5 - np.sin(2 * root) / (4 * root)
    kinetic = v**2 / 2 * B * H * (m + RHO * L * square * shape**2)
    assert account["kinetic"][0] == pytest.approx(kinetic, rel=1e-3)
    assert account["kinetic"][-1] < 1e-3 * kinetic
    # without the mass it would have come back by then
    assert root < 0.7 * np.pi / 2


@pytest.mark.mpi
def test_an_implicit_rod_in_a_machine_feels_the_mass():
    """Held as a rigid pendulum would be: its reaction at rest is the weight of rod and end."""
    m, g = 0.5 * RHO * L, 500.0
    body = rod({"x_max": on_facets(MASS_ALONE, mass=m)}, ends=["x_min"], divisions=(10, 1, 1))
    scene = fm.System(gravity=(g, 0.0, 0.0), team=MpiTeam(MPI.COMM_WORLD))
    part = scene.add(fm.ContinuumBody(ImplicitContinuum(body)), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), part.frame("x_min"))
    end = scene.equilibrium().position(part.frame("x_min"))
    np.testing.assert_allclose(end, 0.0, atol=1e-12)
    # u(L) = (m g + rho g L / 2) L / E
    now = body.displacement[body.displacement_dofs[body.layout.nodes_on(2, body.mesh.facets("x_max")), 0]]
    np.testing.assert_allclose(now, (m * g + RHO * g * L / 2) * L / E, rtol=2e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("solid", SOLIDS)
def test_an_explicit_block_bounces_on_springs(solid):
    """As a rigid one: v sin(w t) / w with w^2 = k A / (m + added), and up and down by as much; the account closes.

    The springs are soft beside the block, so that it hardly bends, and nothing else holds it.
    """
    k, m, v = 2e7, 60.0, 0.5
    body = rod({"z_min": on_facets(normal=k, mass=m)}, solid=solid, divisions=(4, 1, 1))
    omega = np.sqrt(k / (RHO * H + m))
    run = ExplicitRun(body, velocity=(0.0, 0.0, v))
    X = run.motion.x.copy()
    account = run.simulate(2.3 / omega, outputs=4)
    moved = (run.motion.x - X)[:, 2]
    np.testing.assert_allclose(moved, v / omega * np.sin(2.3), rtol=0, atol=5e-3 * v / omega)
    kinetic = (RHO * L * B * H + m * L * B) * v**2 / 2
    assert account["kinetic"][0] == pytest.approx(kinetic, rel=1e-9)
    assert account["springs"][-1] == pytest.approx(kinetic * np.sin(2.3) ** 2, rel=1e-2)
    assert account.error < 1e-3


def test_the_stable_step_knows_of_stiff_springs():
    """2 / omega of the largest eigenvalue of the lumped masses, stiffness and springs; without springs it is longer."""
    given = {"z_min": on_facets(normal=1e14)}
    body = rod(given, divisions=(2, 1, 1), comm=MPI.COMM_SELF)
    matrix = body.tangent(np.zeros(body.layout.n_local), dt=0.0)
    start, columns, values = matrix.getValuesCSR()
    K = np.zeros(matrix.getSize())
    K[np.repeat(np.arange(len(K)), np.diff(start)), columns] = values
    exact = 2 / np.sqrt(scipy.linalg.eigvalsh(K, np.diag(lumped_mass(body)))[-1])
    found = ExplicitRun(body).stable_step
    assert found == pytest.approx(exact, rel=1e-3)
    assert found < 0.3 * ExplicitRun(rod(divisions=(2, 1, 1), comm=MPI.COMM_SELF)).stable_step


def test_an_explicit_run_restarts_to_the_bit_and_only_with_its_surfaces(tmp_path):
    given = {"z_min": on_facets(normal=2e7, mass=60.0)}

    def run(surfaces):
        return ExplicitRun(rod(surfaces, divisions=(4, 1, 1), comm=MPI.COMM_SELF), velocity=(0.0, 0.1, 0.5))

    whole, path = run(given), tmp_path / "run.npz"
    t_end = 40 * whole.stable_step
    every = RegularCheckpoints(path, every=0.45 * t_end)
    account = whole.simulate(t_end, outputs=4, checkpoints=every)
    again = run(given)
    assert again.simulate(t_end, outputs=4, restart=path).rows == account.rows
    assert (again.motion.x == whole.motion.x).all()
    other = {"z_min": on_facets(normal=2e7, mass=61.0)}
    with pytest.raises(SceneError, match="the checkpoint was made by another run"):
        run(other).simulate(t_end, outputs=4, restart=path)


@pytest.mark.mpi
def test_a_loading_against_springs_goes_on_from_a_file(tmp_path):
    """As one that was not broken off; of a body on other springs it is refused."""
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "body.npz"))
    pull = TractionOnFacets("x_max", (1e5, 0.0, 0.0), factor=ramp)

    def loaded(times, *, k=1.5e10, begun=False):
        body = rod({"x_max": on_facets(normal=k)}, solid="updated")
        reached = load_body(body, path) if begun else 0.0
        follow(body, times, prescribed=prescribed_dofs(body, {"x_min": "xyz"}), loads=[pull], reached=reached)
        return body

    save_body(loaded([0.5]), path, t=0.5)
    np.testing.assert_allclose(loaded([1.0], begun=True).displacement, loaded([0.5, 1.0]).displacement, atol=1e-13)
    with pytest.raises(SceneError, match="is of another body"):
        loaded([1.0], k=1.6e10, begun=True)


def test_explicit_springs_that_harden_are_refused(tmp_path):
    path = tmp_path / "hardening.py"
    path.write_text(FILE.read_text().replace("p.normal / 2 * along**2", "p.normal / 4 * along**4"))
    body = rod({"x_max": on_facets(load_form(path), normal=1.0)}, comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match=r"springs on facets of .* are not linear in the displacement"):
        ExplicitRun(body)


def test_what_has_no_axes_at_rest_refuses_springs():
    body = rod({"x_max": on_facets(normal=1e9)}, ends=["x_min"], comm=MPI.COMM_SELF)
    for build, told in (
        (lambda: ImplicitContinuum(body), "which a machine does not hold still"),
        (lambda: ExplicitContinuum(body), "which a machine does not hold still"),
    ):
        with pytest.raises(FormulationError, match=told):
            build()
