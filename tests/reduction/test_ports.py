"""Electrodes: reduced piezoelectric bodies against closed forms of bars and bimorphs, and against each other."""

import dataclasses
import re
import types
from pathlib import Path

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ContinuumModel,
    Electrode,
    Interface,
    NonlinearModel,
    TractionOnFacets,
    Voltage,
    clamped_dofs,
    follow,
)
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.errors import FormulationError, MeshError, ReductionError
from flexmbd.forms import solid_linear, solid_piezo
from flexmbd.reduction import (
    Keep,
    ModalDerivatives,
    TemperatureRise,
    Traction,
    Truncation,
    craig_bampton,
    guyan,
    load_vectors,
    prestressed,
)

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD
PZT = solid_piezo.reference().parameters
LENGTH, WIDTH, THICK = 0.012, 0.002, 0.001
SLENDER = 0.06
GROUND, TOP = Electrode("z_min", grounded=True), Electrode("z_max")
ROOT, TIP = Interface("x_min"), Interface("x_max", coupling=fm.Coupling.AVERAGED)

# without lateral contraction, and with e31 alone, what one dimension says of a bar is exact
YOUNG, KAPPA, RHO = 6e10, 1.5e-8, 7500.0


def bar_material(e31, axis=(0.0, 0.0, 1.0)):
    plain = solid_piezo.elastic(E=YOUNG, nu=0.0, rho=RHO, kappa=KAPPA)
    return dataclasses.replace(plain, e31=e31, axis=axis)


def bar(parameters, conditions, *, interfaces=(), divisions=(8, 1, 1), layers=("block",), form=solid_piezo, **how):
    mesh = meshes.block(how.pop("length", LENGTH), WIDTH, THICK, divisions=divisions, layers=layers)
    source = form if parameters is not None else how.pop("pairs")
    return ContinuumModel(
        mesh, source, parameters, degree=2, interfaces=list(interfaces), conditions=conditions, **how
    )


# Round-off of the softest stiffness is eps times that of the fastest vibration over it: 1e-10 of a short bar, 1e-7 of a
# slender one; on two ranks it differs from run to run, for the factor adds in the order in which messages come.
ROUND_OFF = 1e-9

PLAIN = {"geometric_stiffness": False}


def free_capacity(body):
    """With its interfaces free and its frame held."""
    ports = body.ports
    return ports.capacity + ports.load @ (ports.load / body.stiffness).T


def test_tip_of_a_series_bimorph():
    """3 d31 V L^2 / (2 t^2), of a field that the strain does not change (Smits 1991, of weak coupling)."""
    e31 = 0.1
    pairs = {"low": (solid_piezo, bar_material(e31)), "high": (solid_piezo, bar_material(e31, (0.0, 0.0, -1.0)))}
    how = {"interfaces": [ROOT, TIP], "divisions": (8, 1, 2), "layers": ("low", "high"), "pairs": pairs}
    model = bar(None, [GROUND, TOP], length=SLENDER, **how)
    expected = -1.5 * e31 / YOUNG * SLENDER**2 / THICK**2
    for body in (guyan(model, frame="x_min", **PLAIN), craig_bampton(model, modes=4, frame="x_min", **PLAIN)):
        tip = body.interface("x_max").modes @ (body.ports.load[0] / body.stiffness)
        np.testing.assert_allclose(tip[2], expected, rtol=2e-4)
        np.testing.assert_allclose(tip[4], -2 * expected / SLENDER, rtol=2e-4)
    assert body.ports.efforts == ("voltage",)
    assert body.ports.flow_units == ("C",)


def test_capacity_of_a_free_plate():
    """(kappa33 + 2 e31^2 / Y) A / t where the plate is free, the same for any number of modes and any frame."""
    e31 = -10.0
    expected = (KAPPA + 2 * e31**2 / YOUNG) * LENGTH * WIDTH / THICK
    free = craig_bampton(bar(bar_material(e31), [GROUND, TOP]), modes=9, frame=None, **PLAIN)
    np.testing.assert_allclose(free_capacity(free), expected, rtol=ROUND_OFF)
    model = bar(bar_material(e31), [GROUND, TOP], interfaces=[ROOT, TIP])
    bodies = [craig_bampton(model, modes=n, frame=frame, **PLAIN) for n in (0, 5) for frame in ("x_min", None)]
    held = bar(bar_material(e31), [GROUND, TOP], interfaces=[ROOT])
    bodies += [craig_bampton(held, modes=3, frame="x_min", residual_vectors=flag, **PLAIN) for flag in (False, True)]
    capacities = np.array([free_capacity(body) for body in bodies])
    np.testing.assert_allclose(capacities, capacities[0, 0, 0], rtol=ROUND_OFF)
    # with residual vectors the modes have all of the deformation, and what is left is the condenser of a body at rest
    clamped, resolved = (body.ports.capacity[0, 0] for body in bodies[-2:])
    np.testing.assert_allclose(resolved, KAPPA * LENGTH * WIDTH / THICK, rtol=ROUND_OFF)
    assert clamped > 1.01 * resolved
    assert KAPPA * LENGTH * WIDTH / THICK < capacities[0, 0, 0] < expected


def test_charge_of_a_pulled_bar():
    """d31 F L / t on electrodes in short circuit; the sign is that of the energy."""
    e31, force = -10.0, 7.0
    body = guyan(bar(bar_material(e31), [GROUND, TOP], interfaces=[ROOT, TIP]), frame="x_min", **PLAIN)
    q = body.interface("x_max").modes[0] * force / body.stiffness
    np.testing.assert_allclose(body.ports.load @ q, -e31 / YOUNG * force * LENGTH / THICK, rtol=ROUND_OFF)


def length_mode(conditions, e31, near):
    """Frequency of the length mode of a free bar, and the body."""
    body = craig_bampton(
        bar(bar_material(e31), conditions, divisions=(12, 1, 1), length=SLENDER),
        modes=Truncation(below_hz=1.2 * near), frame=None, geometric_stiffness=False,
    )  # fmt: skip
    frequencies = body.frequencies()
    return frequencies[abs(frequencies - near).argmin()], body


def test_short_and_open_circuit_frequencies():
    """X = -k^2/(1-k^2) tan X, X = w L / 2c, in open circuit (IEEE 176-1987, section 6.4); c / 2L in short circuit."""
    e31 = -10.0
    speed, coupling = np.sqrt(YOUNG / RHO), e31**2 / (YOUNG * KAPPA + e31**2)
    x = brentq(lambda x: x * np.cos(x) + coupling * np.sin(x), np.pi / 2, np.pi)
    short, opened = speed / (2 * SLENDER), x * speed / (np.pi * SLENDER)
    assert opened > 1.03 * short
    found, body = length_mode([GROUND, TOP], e31, short)
    np.testing.assert_allclose(found, short, rtol=2e-5)
    # ports left open: what the machine makes of them
    stiffened = np.diag(body.stiffness) + body.ports.load.T @ np.linalg.solve(body.ports.capacity, body.ports.load)
    loaded = np.sqrt(np.linalg.eigvalsh(stiffened)) / (2 * np.pi)
    np.testing.assert_allclose(loaded[abs(loaded - opened).argmin()], opened, rtol=1e-3)
    floating = dataclasses.replace(TOP, floating=True)
    for conditions in ([GROUND, floating], [dataclasses.replace(GROUND, grounded=False, floating=True), floating]):
        found, body = length_mode(conditions, e31, opened)
        np.testing.assert_allclose(found, opened, rtol=5e-5)
        assert body.ports is None


def test_a_floating_electrode_is_a_port_without_charge():
    """Of the static stiffness between the interfaces but for round-off."""
    ports = guyan(bar(PZT, [GROUND, TOP], interfaces=[ROOT, TIP]), frame="x_min")
    floating = guyan(bar(PZT, [GROUND, dataclasses.replace(TOP, floating=True)], interfaces=[ROOT, TIP]), frame="x_min")
    load = ports.ports.load
    k = np.diag(ports.stiffness) + load.T @ np.linalg.solve(ports.ports.capacity, load)
    rows, others = ports.interface("x_max").modes, floating.interface("x_max").modes
    expected = rows @ np.linalg.solve(k, rows.T)
    found = others @ (others / floating.stiffness).T
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=ROUND_OFF)
    assert abs(rows @ (rows / ports.stiffness).T / expected - 1)[0, 0] > 0.05


def test_a_metal_is_an_electrode_of_cells():
    """Which side is grounded changes the sign of the load and nothing else: a shift of the potential is no energy."""
    steel = solid_piezo.elastic(E=2.1e11, nu=0.3, rho=7850.0)
    pairs = {"steel": (solid_piezo, steel), "patch": (solid_piezo, PZT)}
    how = {"interfaces": [ROOT], "divisions": (6, 1, 2), "layers": ("steel", "patch"), "pairs": pairs}
    one = craig_bampton(bar(None, [Electrode("steel", grounded=True), TOP], **how), modes=4, frame="x_min", **PLAIN)
    other = craig_bampton(
        bar(None, [Electrode("steel"), dataclasses.replace(TOP, grounded=True)], **how), modes=4, frame="x_min", **PLAIN
    )
    np.testing.assert_allclose(other.stiffness, one.stiffness, rtol=ROUND_OFF)
    size = abs(one.ports.load).max()
    np.testing.assert_allclose(other.ports.load, -one.ports.load, atol=ROUND_OFF * size)
    np.testing.assert_allclose(other.ports.capacity, one.ports.capacity, rtol=ROUND_OFF)
    # a plate condenser: the patch is half as thick as the bar
    condenser = (PZT.kappa33 + PZT.e33**2 / PZT.c33) * LENGTH * WIDTH / (THICK / 2)
    assert 0.9 * condenser < free_capacity(one)[0, 0] < 2.2 * condenser


def test_modes_do_not_hang_on_the_unit_of_the_potential():
    found = []
    for scale in (1e9, 3e7):
        material = dataclasses.replace(PZT, potential_scale=scale)
        model = bar(material, [GROUND, TOP], interfaces=[ROOT, TIP], divisions=(4, 1, 1))
        found.append(craig_bampton(model, modes=4, frame="x_min", **PLAIN))
    one, other = found
    np.testing.assert_allclose(other.stiffness, one.stiffness, rtol=ROUND_OFF)
    assert abs(one.ports.load).max() > 1e-3 * np.sqrt(one.stiffness.min() * one.ports.capacity[0, 0])
    np.testing.assert_allclose(abs(other.ports.load), abs(one.ports.load), atol=ROUND_OFF * abs(one.ports.load).max())
    np.testing.assert_allclose(other.ports.capacity, one.ports.capacity, rtol=ROUND_OFF)


@pytest.mark.parametrize("conditions", [[], [Electrode("z_max", floating=True)]])
def test_a_potential_that_nothing_fixes_is_zero_in_the_mean(conditions):
    model = bar(PZT, conditions, divisions=(4, 1, 1))
    u = np.random.default_rng(COMM.rank).normal(size=(model.n_owned, 2))
    u[model.conditions.held] = 0.0
    whole = with_ghosts(model, u)
    for column, given in zip(whole.T, u.T, strict=True):
        field = fem.Function(model.space)
        field.x.array[:] = column
        parts = [COMM.allreduce(fem.assemble_scalar(fem.form(one * ufl.dx))) for one in (field[3], field[3] ** 2)]
        assert abs(parts[0]) < 1e-12 * np.sqrt(parts[1] * LENGTH * WIDTH * THICK)
        motion = model.displacement_dofs[: model.n_owned_nodes].ravel()
        np.testing.assert_array_equal(column[motion], given[motion])


def test_the_record_comes_back(tmp_path):
    body = craig_bampton(bar(PZT, [GROUND, TOP], interfaces=[ROOT]), modes=3, frame="x_min", keep=Keep(modes=True))
    path = COMM.bcast(tmp_path) / "body.h5"
    if COMM.rank == 0:
        body.save(path)
        back = fm.ReducedBody.load(path)
        assert back.fingerprint() == body.fingerprint()
        for item in dataclasses.fields(body.ports):
            np.testing.assert_array_equal(getattr(back.ports, item.name), getattr(body.ports, item.name))
        assert "1 port" in body.inspect()
        without = dataclasses.replace(body, ports=None)
        assert without.fingerprint() != body.fingerprint()
        assert "ports" not in without.tree()
        with pytest.raises(fm.ExportError, match=r"the ports .z_max.*lossy"):
            fm.export.mbdyn(body, tmp_path / "body.fem")
        fm.export.npz(body, tmp_path / "body.npz")
        assert fm.export.read_npz(tmp_path / "body.npz").fingerprint() == body.fingerprint()


def gauged(**entries):
    """The piezoelectric solid with other functions."""
    form = types.ModuleType("own_piezo")
    form.__dict__.update({**vars(solid_piezo), "__name__": "own_piezo", "__file__": None, **entries})
    return form


@pytest.mark.parametrize(
    ("gauge", "told"),
    [
        (lambda p: {"potential": (1.0, 0.0, 0.0, 0.0)}, "moves the body"),
        (lambda p: {"potential": (0.0, 0.0, 1.0)}, "4 finite numbers"),
        (lambda p: {"potential": (0.0, 0.0, 0.0, 0.0)}, "4 finite numbers"),
        (lambda p: (0.0, 0.0, 0.0, 1.0), "shifts by their names"),
        (lambda p: {}, "shifts by their names"),
    ],
)
def test_a_gauge_that_is_none(gauge, told):
    with pytest.raises(FormulationError, match=told):
        bar(PZT, [], form=gauged(gauge=gauge))


def test_a_temperature_whose_charge_the_record_has_not():
    model = bar(dataclasses.replace(PZT, alpha33=1e-6), [GROUND, TOP], interfaces=[ROOT])
    with pytest.raises(ReductionError, match=r"'heat': the record has no charge .* the electrodes 'z_max'; .*ground"):
        craig_bampton(model, modes=1, frame="x_min", loads=[TemperatureRise("heat")])


def test_a_gauge_that_costs_energy():
    def held(u, p):
        (energy, rule), psi = solid_piezo.strain_energy(u, p)[0], ufl.split(u)[1]
        return [(energy - 1e-3 * p.kappa33 * (p.potential_scale * psi) ** 2, rule)]

    with pytest.raises(FormulationError, match=r"no gauge: it changes the strain energy"):
        bar(PZT, [], form=gauged(strain_energy=held))


def test_a_potential_that_nothing_names():
    form = gauged()
    del form.gauge
    model = bar(PZT, [], form=form, interfaces=[ROOT])
    with pytest.raises(ReductionError, match=r"nothing holds component 3 .*gauge\(p\).*electrodes"):
        craig_bampton(model, modes=2, frame="x_min")


@pytest.mark.parametrize(
    ("conditions", "error", "told"),
    [
        ([Electrode("z_max"), Electrode("x_max")], MeshError, "touch: they share nodes"),
        ([Electrode("z_max"), Electrode("z_max", grounded=True)], MeshError, "'z_max' is given twice"),
        ([Electrode("top")], MeshError, "no such group .* it has: .*'z_max'"),
        ([Electrode("z_max", field="temperature")], FormulationError, "no gauge 'temperature'.*'potential'"),
        (["z_max"], MeshError, r"must be an Electrode.*'z_max'"),
        (Electrode("z_max"), MeshError, r"conditions must be a list"),
    ],
)
def test_wrong_conditions(conditions, error, told):
    with pytest.raises(error, match=told):
        bar(PZT, conditions, divisions=(2, 1, 1))


def test_other_wrong_arguments():
    with pytest.raises(MeshError, match=r"cannot be grounded and floating"):
        Electrode("z_max", grounded=True, floating=True)
    with pytest.raises(MeshError, match=r"grounded"):
        Electrode("z_max", grounded="yes")
    with pytest.raises(FormulationError, match=r"solid_linear has no gauge 'potential'"):
        bar(solid_linear.Parameters(E=YOUNG, nu=0.3, rho=RHO), [TOP], form=solid_linear)
    other = dataclasses.replace(PZT, potential_scale=1e8)
    pairs = {"a": (solid_piezo, PZT), "b": (solid_piezo, other)}
    with pytest.raises(FormulationError, match=r"different shifts.*same scale"):
        bar(None, [TOP], divisions=(2, 1, 2), layers=("a", "b"), pairs=pairs)
    if COMM.size > 1:
        with pytest.raises(MeshError, match=r"conditions"):
            bar(PZT, [TOP] if COMM.rank else [], divisions=(2, 1, 1))


def test_what_does_not_go_with_ports():
    model = bar(PZT, [GROUND, TOP], interfaces=[ROOT, Interface("x_max")], divisions=(4, 1, 1))
    with pytest.raises(ReductionError, match=r"nonlinear= goes without ports, as electrode 'z_max'"):
        craig_bampton(model, modes=2, frame="x_min", nonlinear=ModalDerivatives(loads={"x_max.z": 1.0}))


@pytest.mark.parametrize("floats", [False, True])
def test_about_a_loaded_state_it_answers_as_the_whole_body_does(floats):
    """A bimorph that is bent by a sixth of its length: what a small voltage more, or force, adds there."""
    pairs = {"low": (solid_piezo, bar_material(-10.0)), "high": (solid_piezo, bar_material(-10.0, (0.0, 0.0, -1.0)))}
    conditions = [GROUND, dataclasses.replace(TOP, floating=floats)]
    how = {"divisions": (4, 1, 2), "layers": ("low", "high"), "pairs": pairs, "interfaces": [ROOT]}
    lift, size, more = Traction("lift", "x_max", (0.0, 0.0, 1.0)), 2e7, 0.5
    rest = bar(None, conditions, **how)
    loaded = prestressed(rest, frame="x_min", loads=[(lift, size)])
    record = craig_bampton(loaded, modes=3, frame="x_min", residual_vectors=True, loads=[lift], **PLAIN)
    mesh = meshes.block(LENGTH, WIDTH, THICK, divisions=(4, 1, 2), layers=("low", "high"))
    whole = NonlinearModel(mesh, pairs, degree=2, interfaces=[ROOT], conditions=conditions)
    begun, charges, displacements = whole.snapshot(), [], []
    for side in (-1.0, 1.0):
        force, volts = (size * (1.0 + 1e-3 * side), 0.0) if floats else (size, side * more)
        given = [TractionOnFacets("x_max", (0.0, 0.0, force), lambda t: t)]
        given += [] if floats else [Voltage("z_max", lambda t, volts=volts: volts * t)]
        whole.restore(begun)
        follow(whole, [0.5, 1.0], prescribed=clamped_dofs(whole, ["x_min"]), loads=given)
        charges.append(whole.charges)
        displacements.append(whole.displacement[: whole.n_owned].copy())
    if floats:
        assert record.ports is None
        work = record.loads.modal[0] @ (record.loads.modal[0] / record.stiffness) * 2e-3 * size
        unit = load_vectors(rest, [lift])[:, 0]
        assert work == pytest.approx(COMM.allreduce(float(unit @ (displacements[1] - displacements[0]))), rel=1e-5)
        return
    slope = (charges[1] - charges[0]) / (2.0 * more)
    assert free_capacity(record)[0] == pytest.approx(slope, rel=1e-5)
    assert abs(slope[0] / free_capacity(craig_bampton(rest, modes=3, frame="x_min", **PLAIN))[0, 0] - 1.0) > 1e-3


def test_an_electrode_between_two_layers():
    """A parallel bimorph: twice the deflection of the series one, four times its capacity."""
    e31 = 0.1
    mesh = meshes.block(SLENDER, WIDTH, THICK, divisions=(8, 1, 2), layers=("low", "high"))
    topology = mesh.mesh.topology
    topology.create_entities(2)
    middle = dolfinx.mesh.locate_entities(mesh.mesh, 2, lambda x: abs(x[2]) < 1e-9)
    facets = np.concatenate([mesh.facet_tags.indices, middle])
    tags = np.concatenate([mesh.facet_tags.values, np.full(len(middle), 77, np.int32)])
    order = np.argsort(facets)
    mesh = dataclasses.replace(
        mesh,
        facet_tags=dolfinx.mesh.meshtags(mesh.mesh, 2, facets[order], tags[order]),
        facet_groups={**mesh.facet_groups, "middle": 77},
    )
    pairs = {"low": (solid_piezo, bar_material(e31)), "high": (solid_piezo, bar_material(e31))}
    outer = [GROUND, dataclasses.replace(TOP, grounded=True)]
    model = ContinuumModel(mesh, pairs, degree=2, interfaces=[ROOT, TIP], conditions=[*outer, Electrode("middle")])
    body = guyan(model, frame="x_min", **PLAIN)
    tip = body.interface("x_max").modes @ (body.ports.load[0] / body.stiffness)
    np.testing.assert_allclose(abs(tip[2]), 3.0 * e31 / YOUNG * SLENDER**2 / THICK**2, rtol=2e-4)
    np.testing.assert_allclose(body.ports.capacity, 4 * KAPPA * SLENDER * WIDTH / THICK, rtol=1e-4)


@pytest.mark.skipif(COMM.size > 1, reason="the page is for one process")
def test_the_page():
    """docs/ports.md runs; what its resistor takes the arm has lost."""
    page = (Path(__file__).parents[2] / "docs" / "ports.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE):
        exec(block, names)
    damped, sense, act, body = (names[name] for name in ("damped", "sense", "act", "body"))
    series = [damped.port(port, t=np.linspace(0.0, 0.02, 8001)) for port in (sense, act)]
    energy = damped.energy().total
    assert series[1].work[-1] < 0.0
    np.testing.assert_allclose(sum(one.work[-1] for one in series), energy[-1] - energy[0], rtol=1e-3)
    charge = damped.states(names["circuit"])[:, 0]
    np.testing.assert_allclose(charge, damped.port(act).flow, atol=1e-9 * abs(charge).max())
    told = pytest.warns(fm.RangeWarning, match=r"'arm': its stress .* short circuit.*z_max")
    with told, pytest.raises(fm.RecordError):
        names["run"].stress(body, names["model"], t=0.001)
