"""Geometric stiffness: beam theory in closed form, the full model's static responses, any frame and ranks."""

import types

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import ufl
from bracket import GROUPS, bracket
from coupled_part import AVERAGED, RIGID, coupled
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.forms import solid_linear
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.reduction import Keep, craig_bampton, guyan
from flexmbd.reduction.stiffening.stress_stiffness import stress_stiffness

LENGTH, WIDTH, HEIGHT = 1.0, 0.012, 0.02
MATERIAL = solid_linear.Parameters(E=2.0e9, nu=0.0, rho=1000.0)
AREA = WIDTH * HEIGHT
# of bending along y
SOFT = HEIGHT * WIDTH**3 / 12


@pytest.fixture(scope="module")
def beam():
    """A slender cantilever along x without Poisson's effect."""
    mesh = meshes.beam(
        LENGTH, WIDTH, HEIGHT, h=LENGTH / 20, cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    model = ContinuumModel(
        mesh, solid_linear, MATERIAL, degree=2, interfaces=[Interface("start"), Interface("end")]
    )
    return craig_bampton(model, modes=40, frame="start")


def of(body, load):
    return body.geometric.K[body.geometric.loads.index(load)]


def test_buckling_under_a_force_of_fixed_direction(beam):
    """Euler's load of a cantilever, pi^2 E I / 4 L^2; E I by the record's own deflection under a tip force."""
    loads = scipy.linalg.eigh(of(beam, "end.x"), np.diag(beam.stiffness), eigvals_only=True)
    compliance = tip_compliance(beam)
    for found, component in zip(1.0 / loads[:-3:-1], (1, 2), strict=True):
        stiffness = LENGTH**3 / (3 * compliance[component, component])
        assert found == pytest.approx(np.pi**2 * stiffness / (4 * LENGTH**2), rel=2e-4)


def tip_compliance(beam):
    """(6, 6) motion of the tip per unit force and moment on it."""
    rows = beam.interface("end").modes
    return (rows / beam.stiffness) @ rows.T


@pytest.mark.parametrize("part", [-0.9, -0.5, 0.5, 3.0])
def test_frequency_under_an_axial_force(beam, part):
    """The lowest one, against the characteristic equation of the Bernoulli beam."""
    stiffness = MATERIAL.E * SOFT
    force = part * np.pi**2 * stiffness / (4 * LENGTH**2)
    found = np.linalg.eigvalsh(np.diag(beam.stiffness) + force * of(beam, "end.x"))[0]
    assert np.sqrt(found) == pytest.approx(_bernoulli(stiffness, force), rel=2e-3)


def _bernoulli(stiffness, force):
    """Lowest angular frequency of E I w'''' - N w'' = rho A omega^2 w, clamped and free."""
    line = MATERIAL.rho * AREA

    def determinant(omega):
        half, root = force / (2 * stiffness), np.sqrt((force / (2 * stiffness)) ** 2 + line * omega**2 / stiffness)
        a, b = np.sqrt(root + half), np.sqrt(root - half)
        # w = A (cosh ax - cos bx) + B (sinh ax / a - sin bx / b)
        sh, ch, s, c = np.sinh(a), np.cosh(a), np.sin(b), np.cos(b)
        moment = [a**2 * ch + b**2 * c, a * sh + b * s]
        shear = [a**3 * sh - b**3 * s, a**2 * ch + b**2 * c]
        slope = [a * sh + b * s, ch - c]
        tip = [stiffness * shear[i] - force * slope[i] for i in range(2)]
        return moment[0] * tip[1] - moment[1] * tip[0]

    grid = np.linspace(0.05, 60.0, 3000)
    values = np.array([determinant(omega) for omega in grid])
    first = int(np.flatnonzero(values[1:] * values[:-1] < 0)[0])
    return scipy.optimize.brentq(determinant, grid[first], grid[first + 1])


def clamped_mode():
    """First mode of a clamped and free beam of length 1, and its slope, at the middles of 4000 parts."""
    root = 1.8751040687119611
    x = (np.arange(4000) + 0.5) / 4000
    ratio = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
    shape = np.cosh(root * x) - np.cos(root * x) - ratio * (np.sinh(root * x) - np.sin(root * x))
    slope = np.sinh(root * x) + np.sin(root * x) - ratio * (np.cosh(root * x) - np.cos(root * x))
    return x, shape, root * slope


def test_stiffening_of_a_spinning_cantilever(beam):
    """Southwell's coefficient by the clamped mode, 1.193 out of the plane of rotation and 0.193 in it."""
    x, shape, slope = clamped_mode()
    southwell = 0.5 * np.mean((1 - x**2) * slope**2) / np.mean(shape**2)
    assert southwell == pytest.approx(1.193, abs=5e-4)
    phi = beam.gram[4:, 4:].reshape(beam.n_modes, 3, beam.n_modes, 3)
    # the first mode bends along y, the second along z
    for axis, mode, lag in (("yy", 0, 0.0), ("zz", 0, 1.0), ("yy", 1, 1.0), ("zz", 1, 0.0)):
        stiffening = of(beam, f"angular velocity {axis}")[mode, mode]
        assert stiffening == pytest.approx(southwell, rel=2e-3)
        # the centrifugal force at the displaced position
        softening = sum(phi[mode, k, mode, k] for k in range(3) if "xyz"[k] != axis[0])
        assert stiffening - softening == pytest.approx(southwell - lag, abs=3e-3)


def test_weight_along_the_beam(beam):
    """N = -rho A a (L - x) under an acceleration along the beam, by the clamped mode."""
    x, shape, slope = clamped_mode()
    expected = np.mean((1 - x) * slope**2) / np.mean(shape**2)
    for mode in (0, 1):
        assert of(beam, "acceleration x")[mode, mode] == pytest.approx(-expected, rel=2e-3)


def test_lateral_buckling(beam):
    """A tip force along the stiffer direction, 4.0126 sqrt(E I G J) / L^2 (Timoshenko & Gere 1961, section 6.3).

    E I of the softer direction and G J are those of the record's own deflection and twist.
    """
    compliance = tip_compliance(beam)
    product = LENGTH**3 / (3 * compliance[1, 1]) * LENGTH / compliance[3, 3]
    loads = scipy.linalg.eigh(of(beam, "end.z"), np.diag(beam.stiffness), eigvals_only=True)
    assert 1.0 / loads.max() == pytest.approx(4.0126 * np.sqrt(product) / LENGTH**2, rel=3e-3)


def expected_group(model, body, names):
    """K_l for each load from the full model's static response, solved densely, with the loads by their definition."""
    full = FullModel(model)
    order = node_numbers(model)
    frame = model.interface(body.frame) if body.frame else None
    p, R = (frame.p, frame.R) if frame else (_com(full), np.eye(3))
    rigid = full.rigid(p) @ np.kron(np.eye(2), R)
    r = (full.x - p) @ R

    held, bound = [], []
    for one in model.interfaces:
        if not hasattr(one, "average"):
            bound.append((GROUPS[one.name](full.x.T), one.p))
    t = full.bound(bound).toarray()
    rows = {}
    at = 0
    for one in model.interfaces:
        if hasattr(one, "average"):
            c = np.zeros((6, len(t)))
            c[:, 3 * order[one.dofs // 3] + one.dofs % 3] = one.average.T
            rows[one.name] = c @ t
        else:
            rows[one.name] = np.eye(6, t.shape[1], at)
            at += 6
        rows[one.name] = np.kron(np.eye(2), R).T @ rows[one.name]

    forces = []
    for name in names:
        if name.startswith("acceleration"):
            field = -rigid[:, "xyz".index(name[-1])]
        elif name.startswith("angular acceleration"):
            field = -rigid[:, 3 + "xyz".index(name[-1])]
        elif name.startswith("angular velocity"):
            a, b = ("xyz".index(axis) for axis in name[-2:])
            e = np.eye(3)
            pairs = [(a, a)] if a == b else [(a, b), (b, a)]
            # -w x (w x r) for w_i w_j = 1
            field = sum(-np.cross(e[i], np.cross(e[j], r)) for i, j in pairs)
            field = (field @ R.T).reshape(-1)
        else:
            interface, dof = name.split(".")
            forces.append(rows[interface][FRAME_DOFS.index(dof)])
            continue
        forces.append(t.T @ (full.M @ field))
    f = np.array(forces).T

    k, m = t.T @ full.K @ t, t.T @ full.M @ t
    if frame:
        held = rows[frame.name]
    else:
        # in the free coordinates: the rigid motions, what they take off the loads, and the mean-axis conditions
        s = np.linalg.lstsq(t, full.rigid(p), rcond=None)[0]
        f = f - m @ s @ np.linalg.solve(s.T @ m @ s, s.T @ f)
        held = s.T @ m
    scale = abs(np.diag(k)).mean() / abs(held).max()
    whole = np.block([[k, scale * held.T], [scale * held, np.zeros((6, 6))]])
    u = t @ np.linalg.solve(whole, np.vstack([f, np.zeros((6, f.shape[1]))]))[: len(k)]
    local = (3 * order[:, None] + np.arange(3)).reshape(-1)
    return stress_stiffness(model, u[local], nodal_modes(body, model))


def _com(full):
    mass = full.M @ np.tile(np.eye(3), (len(full.x), 1))
    share = mass.reshape(-1, 3, 3)[:, 0, 0]
    return share @ full.x / share.sum()


COUPLINGS = [
    {"root": RIGID, "tip": RIGID, "pad": RIGID},
    {"root": AVERAGED, "tip": RIGID, "pad": AVERAGED},
]


@pytest.mark.parametrize("couplings", COUPLINGS, ids=["rigid", "mixed"])
@pytest.mark.parametrize("frame", ["root", "tip", None])
def test_responses_are_those_of_the_full_model(couplings, frame):
    """Every load of a body that lies askew, its frame on a rigid or averaged interface, or floating."""
    model = coupled(couplings, degree=1)
    body = craig_bampton(model, modes=3, frame=frame, keep=Keep(modes=True))
    moving = [one.name for one in body.interfaces if one.name != frame]
    accelerations = [f"{kind} {axis}" for kind in ("acceleration", "angular acceleration") for axis in "xyz"]
    names = [f"angular velocity {pair}" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")]
    names += [f"{name}.{dof}" for name in moving for dof in FRAME_DOFS]
    if frame:
        names = accelerations + names
    assert body.geometric.loads == tuple(names)
    expected = expected_group(model, body, names)
    for name, found, k in zip(names, body.geometric.K, expected, strict=True):
        assert abs(found - k).max() < 1e-7 * abs(k).max(), name
        assert np.array_equal(found, found.T)


@pytest.mark.mpi
@pytest.mark.parametrize("frame", ["root", None])
def test_any_number_of_ranks(frame):
    world, alone = (
        craig_bampton(bracket(comm=comm, degree=1), modes=3, frame=frame)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    assert world.geometric.loads == alone.geometric.loads
    size = abs(alone.geometric.K).max(axis=(1, 2), keepdims=True)
    assert (abs(world.geometric.K - alone.geometric.K) / size).max() < 1e-9
    assert len(set(MPI.COMM_WORLD.allgather(world.fingerprint()))) == 1


def test_without_and_with_a_quadratic_energy():
    def strain_energy(u, p):
        (_, rule), *_ = solid_linear.strain_energy(u, p)
        return [(ufl.inner(solid_linear.stress(u, None, p), ufl.grad(u)) / 2, rule)]

    form = types.ModuleType("quadratic")
    public = {name: value for name, value in vars(solid_linear).items() if not name.startswith("__")}
    form.__dict__.update(public, strain_energy=strain_energy)
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    interfaces = [Interface("x_min"), Interface("x_max")]
    linear, full = (ContinuumModel(mesh, f, MATERIAL, degree=1, interfaces=interfaces) for f in (form, solid_linear))
    body = guyan(linear, frame="x_min")
    assert body.geometric is None
    assert body.provenance["geometric stiffness"].startswith("none: the strain energy is quadratic")
    assert guyan(full, frame="x_min", geometric_stiffness=False).geometric is None
    assert guyan(full, frame="x_min").provenance["geometric stiffness"] == "18 loads, 3 membrane strains"
