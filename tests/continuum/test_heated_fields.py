"""Forms with fields beside the displacement are heated: walls, enhanced bricks, ceramics; against closed forms."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    ContinuumModel,
    Electrode,
    ExplicitContinuum,
    Heating,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    follow,
    prescribed_dofs,
    wall_form,
)
from flexmbd.forms import solid_enhanced, solid_piezo, solid_shell, solid_shell_plasticity
from flexmbd.reduction import Keep, TemperatureRise, craig_bampton, guyan, linear_buckling

COMM = MPI.COMM_WORLD
ALPHA, E, NU, YIELD = 1.2e-5, 2e11, 0.3, 2e8
STEEL = {"E": E, "nu": NU, "rho": 7800.0, "alpha": ALPHA}
LENGTH, WIDTH, THICK = 0.2, 0.1, 0.004
PLASTIC = solid_shell_plasticity.Parameters(**STEEL, yield_stress=YIELD)
PZT = dataclasses.replace(solid_piezo.reference().parameters, alpha11=4e-6, alpha33=-2e-6)
FORMS = [
    (solid_enhanced, solid_enhanced.Parameters(**STEEL)),
    (solid_shell, solid_shell.Parameters(**STEEL)),
    (wall_form("j2_plasticity", layers=2), forms.j2_plasticity.Parameters(**STEEL, yield_stress=YIELD)),
    (solid_shell_plasticity, PLASTIC),
]


def plate(form, parameters, *, divisions=(3, 2), size=(LENGTH, WIDTH), thick=THICK, comm=COMM, layers=1):
    """A flat wall in cells that are askew in its plane; `heated` comes with what is made of the mesh."""
    mesh = meshes.wall(meshes.sheet(*size, divisions=divisions, comm=comm), thick, layers=layers)
    x = mesh.mesh.geometry.x
    bump = np.sin(np.pi * x[:, 0] / size[0]) * np.cos(np.pi * x[:, 1] / size[1])
    x[:, :2] += 0.05 * min(size) * bump[:, None] * np.array([1.0, -0.6])
    return mesh, form, parameters


def heated(mesh, form, parameters, **options):
    return NonlinearModel(mesh, form, parameters, degree=1, heated=True, **options)


def largest(comm, values):
    return comm.allreduce(float(abs(np.asarray(values)).max(initial=0.0)), op=MPI.MAX)


def corner(body, *, lift=True):
    """Dofs that leave a plate free: the corner nodes nearest to one."""
    x = body.layout.node_x
    found = []
    for place, components in (((0, -1, -1), (0, 1, 2)), ((1, -1, -1), (1, 2)), ((0, 1, -1), (2,))):
        wanted = np.array([place[0] * LENGTH, place[1] * WIDTH / 2, place[2] * THICK / 2])
        node = np.flatnonzero(np.linalg.norm(x - wanted, axis=1) < 1e-9)
        found.append(body.displacement_dofs[node][:, list(components)].ravel())
    dofs = np.concatenate(found)
    return np.sort(dofs[dofs < body.n_owned]).astype(np.int32)


@pytest.mark.parametrize(("form", "parameters"), FORMS)
def test_a_plate_free_or_held_in_its_plane_has_the_stress_of_closed_forms(form, parameters):
    """None when free, and -E alpha T / (1 - nu) when held in its plane: it thickens, with (1 + nu) / (1 - nu)."""
    rise, mesh = 2.0, plate(form, parameters, comm=MPI.COMM_SELF)
    body = heated(*mesh)
    rest = body.snapshot()
    loads = [Heating(lambda x: np.full(len(x), rise), lambda t: t)]
    follow(body, [1.0], prescribed=corner(body), loads=loads)
    moved = body.displacement[body.displacement_dofs]
    x = body.layout.node_x - np.array([0.0, -WIDTH / 2, -THICK / 2])
    assert abs(moved - rise * ALPHA * x).max() < 1e-8 * rise * ALPHA * LENGTH
    assert max(abs(part).max() for part in body.stress()) < 1e-6 * E * ALPHA * rise
    body.restore(rest)
    edges = [*mesh[0].facet_groups.keys() - {"top", "bottom"}]
    held = prescribed_dofs(body, {**dict.fromkeys(edges, "xy"), "bottom": "z"})
    inside = np.setdiff1d(body.displacement_dofs[:, :2].ravel(), held)
    follow(body, [1.0], prescribed=np.union1d(held, inside).astype(np.int32), loads=loads)
    wanted = np.diag([1.0, 1.0, 0.0]) * -E * ALPHA * rise / (1.0 - NU)
    found = np.concatenate([part.reshape(-1, 3, 3) for part in body.stress()])
    assert abs(found - wanted).max() < 3e-4 * abs(wanted).max()
    lifted = body.displacement[body.displacement_dofs[:, 2]].max()
    assert lifted == pytest.approx(THICK * rise * ALPHA * (1.0 + NU) / (1.0 - NU), rel=3e-4)


def test_a_wall_that_is_held_yields_and_is_pulled_when_it_is_cold_again():
    """In its plane all round: von Mises' stress is that of either direction."""
    mesh = plate(solid_shell_plasticity, PLASTIC, comm=MPI.COMM_SELF, divisions=(2, 1))
    body = heated(*mesh)
    held = np.union1d(body.displacement_dofs[:, :2].ravel(), prescribed_dofs(body, {"bottom": "z"})).astype(np.int32)
    heat = Heating(100.0, lambda t: t if t < 1.0 else 2.0 - t)
    follow(body, [0.5, 1.0], prescribed=held, loads=[heat])
    assert body.stress()[0][..., 0, 0] == pytest.approx(-YIELD, rel=3e-3)  # Kirchhoff's is the law's
    follow(body, [1.5, 2.0], prescribed=held, loads=[heat], reached=1.0)
    left = E * 100.0 * ALPHA / (1.0 - NU) - YIELD
    assert body.stress()[0][..., 0, 0] == pytest.approx(left, rel=4e-3)
    assert left > 0.7 * YIELD


@pytest.mark.mpi
@pytest.mark.parametrize("form", [solid_enhanced, solid_shell])
def test_a_plate_that_is_warm_on_one_side_bends_freely(form):
    """To a bowl of the curvature alpha dT/dz in both directions, without stress; reduced, and slowly."""
    slope = 500.0  # K/m
    rise = TemperatureRise("heat", lambda x: slope * x[:, 2])
    mesh = plate(form, form.Parameters(**STEEL), divisions=(8, 4))
    model = ContinuumModel(*mesh, degree=1, interfaces=[Interface("x_min")])
    assert model.condensed is not None
    body = heated(*mesh)
    follow(body, [1.0], prescribed=corner(body), loads=[Heating(rise.rise, lambda t: t)])
    x, moved = body.layout.node_x, body.displacement[body.displacement_dofs]
    # w = -k (x^2 + y^2) / 2 but for a rigid motion
    dofs = np.column_stack([np.ones(len(x)), x[:, :2], x[:, :2] ** 2, x[:, 0] * x[:, 1]])
    middle = abs(x[:, 2] + THICK / 2) < 1e-9
    normal = body.comm.allreduce(dofs[middle].T @ dofs[middle]), body.comm.allreduce(dofs[middle].T @ moved[middle, 2])
    bend = np.linalg.solve(*normal)
    assert bend[3:5] == pytest.approx(-0.5 * ALPHA * slope, rel=1e-2)
    assert abs(bend[5]) < 1e-2 * ALPHA * slope
    assert max(largest(COMM, part) for part in body.stress()) < 0.03 * E * ALPHA * slope * THICK / 2


@pytest.mark.mpi
@pytest.mark.parametrize("form", [solid_enhanced, solid_shell])
def test_a_bimetal_strip_of_one_cell_a_layer_bends_as_timoshenko_says(form):
    """Two layers of unlike stiffness and height, without lateral contraction: reduced, in steps, and by a machine."""
    length, low, high, rise = 0.2, 0.003, 0.002, 60.0
    mesh = meshes.wall(meshes.sheet(length, 0.01, divisions=(10, 1)), low + high, layers=2)
    x = mesh.mesh.geometry.x
    x[abs(x[:, 2]) < 1e-9, 2] = (low - high) / 2
    mesh = in_layers(mesh, (low - high) / 2)
    below, above = ({"E": e, "nu": 0.0, "rho": 7800.0, "alpha": a} for e, a in ((1e11, 2.4e-5), (2e11, 1e-6)))
    pairs = {"below": (form, form.Parameters(**below)), "above": (form, form.Parameters(**above))}
    m, n = low / high, below["E"] / above["E"]
    curvature = 6.0 * (below["alpha"] - above["alpha"]) * rise * (1.0 + m) ** 2
    curvature /= (low + high) * (3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n)))
    ends = [Interface("x_min", coupling=fm.Coupling.AVERAGED), Interface("x_max", coupling=fm.Coupling.AVERAGED)]
    model = ContinuumModel(mesh, pairs, degree=1, interfaces=ends)
    record = guyan(model, frame="x_min", loads=[TemperatureRise("heat", rise)])
    turned = record.interface("x_max").modes[4] @ (record.loads.modal[0] / record.stiffness)
    assert turned == pytest.approx(-curvature * length, rel=5e-3)
    body = NonlinearModel(mesh, pairs, degree=1, heated=True)
    held = np.union1d(prescribed_dofs(body, {"x_min": "x"}), corner_line(body)).astype(np.int32)
    follow(body, [0.5, 1.0], prescribed=held, loads=[Heating(rise, lambda t: t)])
    end = abs(body.layout.node_x[:, 0] - length) < 1e-9
    sag = -largest(COMM, body.displacement[body.displacement_dofs[end, 2]])
    assert sag == pytest.approx(-(1.0 - np.cos(curvature * length)) / curvature, rel=5e-3)


def in_layers(mesh, height):
    """The mesh with the cell groups below and above a height, m."""
    import dolfinx.mesh

    cells = mesh.mesh.topology.index_map(3)
    every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    up = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, every)[:, 2] > height
    tags = dolfinx.mesh.meshtags(mesh.mesh, 3, every, np.where(up, 2, 1).astype(np.int32))
    return dataclasses.replace(mesh, cell_tags=tags, cell_groups={"below": 1, "above": 2})


def corner_line(body):
    """Dofs that hold a strip whose end x = 0 may not move along x: its lower edge there along z, a corner along y."""
    x = body.layout.node_x
    edge = (abs(x[:, 0]) < 1e-9) & (x[:, 2] < x[:, 2].min() + 1e-9)
    dofs = np.concatenate([body.displacement_dofs[edge, 2], body.displacement_dofs[edge & (x[:, 1] < 0.0), 1]])
    return dofs[dofs < body.n_owned]


@pytest.mark.mpi
def test_a_strip_between_clamps_buckles_as_it_is_heated():
    """Euler's strain (2 pi / L)^2 i^2, but for the strips at the clamps that cannot widen; by condensed fields."""
    length, thick = 0.4, 0.004
    mesh = meshes.wall(meshes.sheet(length, 0.02, divisions=(32, 1)), thick)
    loose = solid_shell.Parameters(E=E, nu=0.0, rho=7800.0, alpha=ALPHA)
    model = ContinuumModel(mesh, solid_shell, loose, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    critical = (2.0 * np.pi / length) ** 2 * thick**2 / 12.0 / ALPHA
    load = TemperatureRise("heat", critical)
    found = linear_buckling(model, clamped=["x_min", "x_max"], loads=[(load, 1.0)])
    assert found.factors[0] == pytest.approx(1.0, rel=8e-3)


def raised(t):
    """K/m, a gradient through the thickness that comes and goes within 20 ms."""
    return 4000.0 * np.sin(300.0 * t) ** 2


def swung(body, load=None):
    """Where the tip of a strip is that is held at one end, m along z, after 8 ms."""
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    strip = scene.add(body, name="strip")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), strip.frame("x_min"))
    if load is not None:
        scene.add_force(fm.force.DistributedLoad(strip, "heat", load))
    return scene, strip


@pytest.mark.parametrize("form", [solid_enhanced, solid_shell])
def test_a_strip_that_is_heated_on_one_side_in_motion_moves_as_a_reduced_one(form):
    """By generalized-alpha, by central differences, and condensed with modes up to its load's response."""
    soft = form.Parameters(E=2e9, nu=0.3, rho=7800.0, alpha=ALPHA)
    mesh = meshes.wall(meshes.sheet(0.1, 0.02, divisions=(6, 1), comm=MPI.COMM_SELF), 0.004)
    options = {"degree": 1, "interfaces": [Interface("x_min"), Interface("x_max")]}
    model = ContinuumModel(mesh, form, soft, **options)
    record = craig_bampton(model, modes=12, frame="x_min", loads=[TemperatureRise("heat", lambda x: x[:, 2])])
    scene, strip = swung(fm.FlexibleBody(record), raised)
    t_end = 6e-3
    wanted = scene.simulate(t_end, rtol=1e-6).position(strip.frame("x_max"), t=[t_end])[0, 2]
    assert abs(wanted) > 1e-5
    heat = Heating(lambda x: x[:, 2], raised)
    for kind, method, h, off in (
        (ImplicitContinuum, fm.GeneralizedAlpha(), 5e-5, 1e-2),
        (ExplicitContinuum, fm.CentralDifference(), None, 3e-2),
    ):
        body = NonlinearModel(mesh, form, soft, heated=True, **options)
        scene, strip = swung(fm.ContinuumBody(kind(body, loads=[heat])))
        run = scene.simulate(t_end, integrator=method, h=h)
        assert run.position(strip.frame("x_max"))[-1, 2] == pytest.approx(wanted, rel=off), kind


def test_a_ceramic_that_is_held_and_heated_has_the_stress_and_the_charge_of_the_law():
    """In open circuit D = 0 brings a field, in short circuit a charge; reduced and slowly."""
    rise, side = 3.0, 0.01
    mesh = meshes.block(side, side, side, divisions=(2, 2, 2), comm=MPI.COMM_SELF)
    pulled = (2.0 * PZT.e31 * PZT.alpha11 + PZT.e33 * PZT.alpha33) * rise  # C/m^2
    held = ((PZT.c11 + PZT.c12) * PZT.alpha11 + PZT.c13 * PZT.alpha33) * rise
    along = (2.0 * PZT.c13 * PZT.alpha11 + PZT.c33 * PZT.alpha33) * rise
    every = dict.fromkeys(("x_min", "x_max", "y_min", "y_max", "z_min", "z_max"), "xyz")
    for field, electrodes in (
        (pulled / PZT.kappa33, []),
        (0.0, [Electrode("z_min", grounded=True), Electrode("z_max", grounded=True)]),
        (0.0, [Electrode("z_min", grounded=True), Electrode("z_max")]),
    ):
        wanted = np.diag([-held - PZT.e31 * field] * 2 + [-along - PZT.e33 * field])
        options = {"degree": 1, "conditions": electrodes}
        body = NonlinearModel(mesh, solid_piezo, PZT, heated=True, **options)
        inside = body.displacement_dofs.ravel()
        assert len(prescribed_dofs(body, every)) < len(inside)
        loads = [Heating(rise, lambda t: t)]
        follow(body, [1.0], prescribed=np.sort(inside).astype(np.int32), loads=loads)
        assert body.stress()[0] == pytest.approx(np.broadcast_to(wanted, body.stress()[0].shape), rel=1e-3, abs=1.0)
        if "z_max" in body.ports:
            charge = body.charges[body.ports.index("z_max")]
            assert charge == pytest.approx(pulled * side**2, rel=1e-3)
            continue
        model = ContinuumModel(mesh, solid_piezo, PZT, interfaces=[Interface("x_min")], **options)
        heat = TemperatureRise("heat", rise)
        record = craig_bampton(model, modes=1, frame="x_min", loads=[heat], keep=Keep(modes=True))
        found = model.stress_field(record, np.zeros(record.n_modes), heat={"heat": 1.0}).stress
        turned = record.R_MB.T @ wanted @ record.R_MB
        assert found == pytest.approx(np.broadcast_to(turned, found.shape), rel=1e-9, abs=1e-6 * abs(wanted).max())


def test_coefficients_of_expansion_are_finite_numbers():
    for make in (
        lambda alpha: solid_enhanced.Parameters(**{**STEEL, "alpha": alpha}),
        lambda alpha: solid_shell.Parameters(**{**STEEL, "alpha": alpha}),
        lambda alpha: dataclasses.replace(PLASTIC, alpha=alpha),
        lambda alpha: dataclasses.replace(PZT, alpha11=alpha),
        lambda alpha: dataclasses.replace(PZT, alpha33=alpha),
        lambda alpha: solid_piezo.elastic(E=E, nu=NU, rho=7800.0, alpha=alpha),
    ):
        for wrong in (float("nan"), float("inf"), "warm", None):
            with pytest.raises(ValueError, match="alpha"):
                make(wrong)
