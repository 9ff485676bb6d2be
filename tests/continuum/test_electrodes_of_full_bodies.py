"""Electrodes of bodies that are loaded slowly, or move with all their nodes: closed forms, and reduced bodies."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ContinuumModel,
    Electrode,
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    TractionOnFacets,
    Voltage,
    equilibrium_path,
    follow,
    prescribed_dofs,
)
from flexmbd.continuum.history.history_file import load_body, save_body
from flexmbd.errors import FormulationError, MeshError, SceneError
from flexmbd.forms import solid_linear, solid_piezo
from flexmbd.reduction import craig_bampton

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD
LENGTH, WIDTH, THICK = 0.012, 0.002, 0.001
YOUNG, KAPPA, RHO, E31 = 6e10, 1.5e-8, 7500.0, -10.0
GROUND, TOP = Electrode("z_min", grounded=True), Electrode("z_max")
FREE = {"x_min": "x", "y_min": "y", "z_min": "z"}


def material(e31=E31, axis=(0.0, 0.0, 1.0)):
    """Without lateral contraction, and with e31 alone: what one dimension says of a bar is exact."""
    plain = solid_piezo.elastic(E=YOUNG, nu=0.0, rho=RHO, kappa=KAPPA)
    return dataclasses.replace(plain, e31=e31, axis=axis)


def bar(conditions, *, divisions=(4, 1, 1), interfaces=()):
    mesh = meshes.block(LENGTH, WIDTH, THICK, divisions=divisions)
    return NonlinearModel(
        mesh, solid_piezo, material(), degree=2, interfaces=list(interfaces), conditions=conditions
    )


def moved(body, face, axis):
    """(m) mean displacement of a face along an axis."""
    nodes = body.layout.nodes_on(2, body.mesh.facets(face))
    nodes = nodes[nodes < body.layout.n_owned_nodes]
    part = body.displacement[body.displacement_dofs[nodes, axis]]
    return COMM.allreduce(part.sum()) / COMM.allreduce(len(part))


def test_charge_and_stretch_of_a_free_plate_at_a_voltage(tmp_path):
    """Q = (kappa33 + 2 e31^2 / Y) V A / t, strain -e31 V / (Y t) along both sides; energy V Q / 2."""
    body = bar([GROUND, TOP])
    held, volts = prescribed_dofs(body, FREE), 0.1
    path = follow(body, [0.5, 1.0], prescribed=held, loads=[Voltage("z_max", lambda t: volts * t)])
    assert body.ports == ("z_max",)
    charge = (KAPPA + 2 * E31**2 / YOUNG) * volts * LENGTH * WIDTH / THICK
    assert body.charges == pytest.approx([charge], rel=1e-7)
    assert moved(body, "x_max", 0) == pytest.approx(-E31 * volts / (YOUNG * THICK) * LENGTH, rel=1e-7)
    energies = body.energies()
    assert energies["elastic"] == pytest.approx(charge * volts / 2, rel=1e-6)
    assert energies["voltages"] == pytest.approx(-charge * volts / 2, rel=1e-6)
    assert len(path.steps) == 2
    # the state comes back, voltage and charge with it
    place = COMM.bcast(tmp_path) / "body.npz"
    save_body(body, place, t=1.0)
    other = bar([GROUND, TOP])
    load_body(other, place)
    assert other.port_states()["z_max"] == pytest.approx(body.port_states()["z_max"], rel=1e-14)
    # along the arc of a path, on which the voltage is the factor
    equilibrium_path(
        body, fm.Continuation(to=1.5), prescribed=held, loads=[Voltage("z_max", lambda t: volts * t)], reached=1.0
    )
    assert body.charges == pytest.approx([1.5 * charge], rel=1e-7)


@pytest.mark.parametrize("conditions", [[GROUND, Electrode("z_max", floating=True)], []])
def test_a_bar_in_open_circuit_is_stiffer(conditions):
    """E_3 = -e31 s / (Y kappa + 2 e31^2) under the stress s along the bar, with electrodes and with none at all."""
    body, stress = bar(conditions), 1e4
    pull = TractionOnFacets("x_max", (stress, 0.0, 0.0), lambda t: t)
    follow(body, [1.0], prescribed=prescribed_dofs(body, FREE), loads=[pull])
    field = -E31 * stress / (YOUNG * KAPPA + 2 * E31**2)
    assert moved(body, "x_max", 0) == pytest.approx((stress + E31 * field) / YOUNG * LENGTH, rel=1e-6)
    assert abs(E31 * field) > 0.05 * stress
    nodes = body.layout.fields[-1]
    tops = body.displacement[nodes.dofs] * material().potential_scale
    reach = COMM.allreduce(tops.max(), op=MPI.MAX) - COMM.allreduce(tops.min(), op=MPI.MIN)
    assert reach == pytest.approx(abs(field) * THICK, rel=1e-6)
    assert body.charges.size == 0


def bender(kind, *, volts, omega, t_end, **how):
    """A bimorph on the ground at a voltage over time: a trajectory, its body and the scene."""
    conditions, mesh = [GROUND, TOP], meshes.block(LENGTH, WIDTH, THICK, divisions=(4, 1, 2), layers=("low", "high"))
    pairs = {"low": (solid_piezo, material()), "high": (solid_piezo, material(axis=(0.0, 0.0, -1.0)))}
    given = {"degree": 2, "interfaces": [Interface("x_min")], "conditions": conditions}
    scene, drive = fm.System(gravity=(0.0, 0.0, 0.0), team=MpiTeam(COMM)), fm.Sine(volts, omega)
    if kind is None:
        body = fm.FlexibleBody(craig_bampton(ContinuumModel(mesh, pairs, **given), modes=12, frame="x_min"))
    else:
        body = fm.ContinuumBody(kind(NonlinearModel(mesh, pairs, **given), loads=[Voltage("z_max", drive)]))
    scene.add(body, name="bender")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    if kind is None:
        body.port("z_max").voltage = drive
    return scene.simulate(t_end, **how), body, scene


@pytest.mark.parametrize("kind", [ImplicitContinuum, ExplicitContinuum])
def test_a_bimorph_that_is_driven_is_the_reduced_one(kind, tmp_path):
    """Charge over a swing at 0.4 of the first frequency, 20.3 kHz in short circuit; what comes in is kept."""
    omega = 2 * np.pi * 0.4 * 20331.4
    t_end = (1.2 if kind is ImplicitContinuum else 0.08) * 2 * np.pi / omega
    how = {"h": t_end / 120} if kind is ImplicitContinuum else {"integrator": fm.CentralDifference()}
    run, body, scene = bender(kind, volts=5.0, omega=omega, t_end=t_end, **how)
    reduced, other, _ = bender(None, volts=5.0, omega=omega, t_end=t_end, rtol=1e-6)
    found = run.ports(body)["z_max"]
    assert found.effort == pytest.approx(5.0 * np.sin(omega * found.t), abs=1e-7)
    wanted = reduced.port(other.port("z_max"), t=found.t).flow
    assert abs(found.flow - wanted).max() < 3e-3 * abs(wanted).max()
    energies = run.energies(body)
    total = sum(energies.values())
    assert abs(total - total[0]).max() < 1e-4 * abs(energies["voltages"]).max()
    assert -energies["voltages"][-1] == pytest.approx(found.work[-1], rel=1e-9)
    path = COMM.bcast(tmp_path) / "run.h5"
    run.save(path)
    again = fm.Trajectory.load(path, scene)
    np.testing.assert_array_equal(again.ports(body)["z_max"].flow, found.flow)


def test_wrong_electrodes_and_voltages():
    body = bar([GROUND, TOP], interfaces=[Interface("x_min")])
    for load, told in (
        (Voltage("z_min", 1.0), r"no electrode 'z_min' whose voltage is given; it has: 'z_max'.*conditions="),
        (Voltage("side", 1.0), r"no electrode 'side' whose voltage is given"),
    ):
        with pytest.raises(SceneError, match=told):
            follow(body, [1.0], prescribed=prescribed_dofs(body, FREE), loads=[load])
        with pytest.raises(SceneError, match=told):
            ImplicitContinuum(body, loads=[load])
    with pytest.raises(SceneError, match=r"'z_max': a signal, as of controllers.*reduce the body"):
        Voltage("z_max", fm.Signal("u"))
    with pytest.raises(FormulationError, match="voltages are 1 finite numbers"):
        body.set_voltages([1.0, 2.0])
    with pytest.raises(MeshError, match="touch: they share nodes"):
        bar([TOP, Electrode("x_max")])
    with pytest.raises(MeshError, match="no such group"):
        bar([Electrode("top")])
    mesh = meshes.block(LENGTH, WIDTH, THICK, divisions=(1, 1, 1))
    steel = solid_linear.Parameters(E=YOUNG, nu=0.3, rho=RHO)
    with pytest.raises(FormulationError, match=r"solid_linear has no gauge 'potential'"):
        NonlinearModel(mesh, solid_linear, steel, degree=2, conditions=[TOP])
