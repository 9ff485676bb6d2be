"""Ports in a machine: voltages and charges of a body's electrodes, circuits across them, and the power that passes."""

from dataclasses import replace

import numpy as np
import pytest
from particles import particle_body
from scipy.linalg import expm

import flexmbd as fm
from flexmbd.record.reduced_body import Ports

MODES = 3
LOAD = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]])
CAPACITY = np.array([[2e-2, 3e-3], [3e-3, 1e-2]])


def with_ports(load=LOAD, capacity=CAPACITY, *, damping=0.0, stretched=()):
    """A body of particles, springs of some 100 1/s^2, with electrodes."""
    record = particle_body(3, modes=MODES, damping=damping, stretched=stretched).record
    k = len(load)
    names = tuple("ab"[:k])
    ports = Ports(names, ("voltage",) * k, ("V",) * k, ("charge",) * k, ("C",) * k, load, capacity)
    return replace(record, ports=ports)


def clamped(record):
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    return scene, body


ONE = with_ports(LOAD[:1], CAPACITY[:1, :1])
Q0 = np.array([0.05, -0.02, 0.03])


@pytest.mark.parametrize(
    "method", [fm.RadauIIA(), fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.CentralDifference(), "auto"], ids=str
)
@pytest.mark.parametrize("inductance", [0.0, 0.4])
def test_a_shunt_against_the_matrix_exponential(method, inductance):
    """Modes, charge and voltage with a resistor, an inductor and a capacitor in series, to rtol; the energy lost."""
    resistance, own = 3.0, 0.05
    scene, body = clamped(ONE)
    body.q = Q0
    port = body.port("a")
    circuit = scene.add_force(
        fm.force.shunt(port, resistance=resistance, inductance=inductance, capacitance=own, charge=0.01)
    )
    times = np.linspace(0.0, 1.5, 7)
    rtol = 1e-4 if isinstance(method, (fm.GeneralizedAlpha, fm.CentralDifference)) else 1e-7
    run = scene.simulate(times[-1], rtol=rtol, integrator=method)

    n, load, C = MODES, LOAD[0], CAPACITY[0, 0]
    # x = q, q', Q, I; V = (Q - load q) / C
    A = np.zeros((2 * n + 2, 2 * n + 2))
    voltage = np.concatenate([-load / C, np.zeros(n), [1 / C, 0.0]])
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -np.diag(ONE.stiffness)
    A[n : 2 * n] += np.outer(load, voltage)
    across = voltage.copy()
    across[2 * n] += 1 / own
    if inductance:
        A[2 * n, 2 * n + 1] = 1.0
        A[2 * n + 1] = -across / inductance
        A[2 * n + 1, 2 * n + 1] -= resistance / inductance
    else:
        A[2 * n] = -across / resistance
    x0 = np.concatenate([Q0, np.zeros(n), [0.01, 0.0]])
    exact = np.array([expm(A * t) @ x0 for t in times])
    tolerance = 300 * rtol
    np.testing.assert_allclose(run.q(body, t=times), exact[:, :n], atol=tolerance * 0.05)
    np.testing.assert_allclose(run.states(circuit, t=times)[:, 0], exact[:, 2 * n], atol=tolerance * 0.05)
    series = run.port(port, t=times)
    np.testing.assert_allclose(series.effort, exact @ voltage, atol=tolerance * 2.0)
    np.testing.assert_allclose(series.flow, exact[:, 2 * n], atol=tolerance * 0.05)
    # what the body loses is what goes into the circuit, and most of it into the resistor
    fine = run.port(port, t=np.linspace(0.0, times[-1], 4001))
    energy = run.energy(t=fine.t).total
    np.testing.assert_allclose(fine.work, energy - energy[0], atol=3e-5 * energy[0] + tolerance * energy[0])
    current = np.gradient(fine.flow, fine.t, edge_order=2)
    charge = fine.flow
    stored = 0.5 * charge**2 / own + 0.5 * inductance * current**2
    lost = np.trapezoid(resistance * current**2, fine.t)
    assert energy[-1] + stored[-1] < 0.99 * (energy[0] + stored[0])
    np.testing.assert_allclose(energy[0] + stored[0] - energy[-1] - stored[-1], lost, rtol=2e-3 + 30 * tolerance)


def test_energy_of_an_open_electrode_is_kept():
    """By a resistor that is none: the charge stays, and the frequencies are those of the stiffened body."""
    scene, body = clamped(ONE)
    body.q = Q0
    scene.add_force(fm.force.shunt(body.port("a"), resistance=1e15))
    run = scene.simulate(2.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    energy = run.energy().total
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    assert abs(run.port(body.port("a")).flow).max() < 1e-9
    opened = np.diag(ONE.stiffness) + np.outer(LOAD[0], LOAD[0]) / CAPACITY[0, 0]
    scene, body = clamped(ONE)
    scene.add_force(fm.force.shunt(body.port("a"), resistance=1e15))
    found = scene.linearize().eigenvalues()
    expected = np.sqrt(np.linalg.eigvalsh(opened))
    np.testing.assert_allclose(np.sort(found.imag[found.imag > 1e-3]), expected, rtol=1e-6)


@pytest.mark.parametrize("resistance", [0.5, 5.0])
def test_eigenvalues_of_a_shunted_body(resistance):
    scene, body = clamped(ONE)
    scene.add_force(fm.force.shunt(body.port("a"), resistance=resistance))
    n, load, C = MODES, LOAD[0], CAPACITY[0, 0]
    A = np.zeros((2 * n + 1, 2 * n + 1))
    A[:n, n:-1] = np.eye(n)
    A[n:-1, :n] = -np.diag(ONE.stiffness) - np.outer(load, load) / C
    A[n:-1, -1] = load / C
    A[-1, :n], A[-1, -1] = load / C / resistance, -1 / C / resistance
    found, exact = (np.sort_complex(values) for values in (scene.linearize().eigenvalues(), np.linalg.eigvals(A)))
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_two_ports_in_statics():
    """q = K^-1 load^T V, and the charges with what each electrode does to the other."""
    record = with_ports()
    scene, body = clamped(record)
    voltages = np.array([2.0, -1.0])
    body.port("a").voltage, body.port("b").voltage = voltages
    rest = scene.equilibrium()
    q = LOAD.T @ voltages / record.stiffness
    np.testing.assert_allclose(rest.q(body), q, rtol=1e-9)
    charges = LOAD @ q + CAPACITY @ voltages
    np.testing.assert_allclose([rest.port_flow(body.port(name)) for name in "ab"], charges, rtol=1e-9)
    np.testing.assert_allclose([body.port(name).charge(rest) for name in "ab"], charges, rtol=1e-9)
    np.testing.assert_allclose([body.port(name).strain_charge(rest) for name in "ab"], LOAD @ q, rtol=1e-9)
    assert rest.port_effort(body.port("b")) == -1.0


def test_power_of_a_given_voltage():
    """Voltage times current is what the machine's energy grows by, with another electrode held at a voltage."""
    scene, body = clamped(with_ports())
    body.port("a").voltage = fm.Sine(3.0, 8.0, 0.4)
    body.port("b").voltage = 0.5
    run = scene.simulate(1.5, rtol=1e-9)
    t = np.linspace(0.0, 1.5, 6001)
    energy = run.energy(t=t).total
    work = sum(run.port(body.port(name), t=t).work for name in "ab")
    np.testing.assert_allclose(work, energy - energy[0], atol=1e-6 * abs(energy).max())
    assert abs(energy - energy[0]).max() > 0.01
    stored = 0.5 * CAPACITY[1, 1] * 0.25 + 0.5 * CAPACITY[0, 0] * (3 * np.sin(0.4)) ** 2
    np.testing.assert_allclose(energy[0], stored + CAPACITY[0, 1] * 0.5 * 3 * np.sin(0.4), rtol=1e-9)


STRETCHED = with_ports(LOAD[:1], CAPACITY[:1, :1], stretched=(1,))


@pytest.mark.parametrize("method", [fm.RadauIIA(), fm.ExplicitRungeKutta(), fm.GeneralizedAlpha()], ids=str)
@pytest.mark.parametrize("circuit", [True, False])
def test_efforts_work_on_strain(method, circuit):
    """Where bending stretches, charge is that of the strain, and the account closes at large motions."""
    scene, body = clamped(STRETCHED)
    body.q = Q0
    port = body.port("a")
    if circuit:
        scene.add_force(fm.force.shunt(port, resistance=3.0))
    else:
        port.voltage = fm.Sine(3.0, 8.0)
    run = scene.simulate(1.0, rtol=1e-5 if isinstance(method, fm.GeneralizedAlpha) else 1e-8, integrator=method)
    t = np.linspace(0.0, 1.0, 4001)
    series, energy, q = run.port(port, t=t), run.energy(t=t).total, run.q(body, t=t)
    np.testing.assert_allclose(series.flow, STRETCHED.strained(q) @ LOAD[0] + CAPACITY[0, 0] * series.effort, rtol=1e-9)
    assert abs(STRETCHED.strained(q) - q).max() > 0.02 * abs(q).max()
    size = abs(energy).max()
    limit = 3e-3 if isinstance(method, fm.GeneralizedAlpha) else 1e-5
    np.testing.assert_allclose(series.work, energy - energy[0], atol=limit * size)
    assert abs(series.work).max() > 0.1 * size


def test_a_voltage_stiffens_by_the_strain_of_second_order():
    """Frequencies about the equilibrium at a voltage, against differences of the enthalpy's slope."""
    scene, body = clamped(STRETCHED)
    port = body.port("a")
    port.voltage = 20.0
    rest = scene.equilibrium()
    q = rest.q(body)

    def enthalpy(q):
        strain = STRETCHED.strained(q[None])[0]
        return 0.5 * STRETCHED.stiffness @ strain**2 - 20.0 * LOAD[0] @ strain

    h = 1e-4 * np.eye(MODES)
    slope = [(enthalpy(q + d) - enthalpy(q - d)) / 2e-4 for d in h]
    np.testing.assert_allclose(slope, 0.0, atol=1e-7 * 20.0)
    curvature = [
        [(enthalpy(q + d + e) - enthalpy(q + d - e) - enthalpy(q - d + e) + enthalpy(q - d - e)) / 4e-8 for e in h]
        for d in h
    ]
    found = scene.linearize(about=rest).eigenvalues()
    expected = np.sqrt(np.linalg.eigvalsh(curvature))
    np.testing.assert_allclose(np.sort(found.imag[found.imag > 0]), expected, rtol=1e-5)
    assert abs(expected / np.sqrt(STRETCHED.stiffness) - 1).max() > 0.01
    # the charge's slope there, as a linear machine has it
    machine = scene.linearize(about=rest, outputs=[port.strain_charge], inputs=[fm.force.PortEffort(port, 1.0)])
    _, B, C, _ = machine.state_space()
    slope = [LOAD[0] @ (STRETCHED.strained((q + d)[None]) - STRETCHED.strained((q - d)[None]))[0] / 2e-4 for d in h]
    np.testing.assert_allclose(np.sort(abs(C[0][abs(C[0]) > 0])), np.sort(np.abs(slope)), rtol=1e-6)
    np.testing.assert_allclose(np.sort(abs(B[:, 0][abs(B[:, 0]) > 0])), np.sort(np.abs(slope)), rtol=1e-6)


def test_a_controller_senses_and_damps():
    """One electrode senses a current in short circuit, another damps by it; equal to a damper between these modes."""
    gain, record = 40.0, with_ports(np.vstack([LOAD[0], LOAD[0]]), np.diag(np.diag(CAPACITY)))
    scene, body = clamped(record)
    body.q = Q0
    sense, act = body.port("a"), body.port("b")
    scene.add_controller(
        lambda t, y: -gain * y[0], period=2e-4, measurements=[sense.strain_current], inputs=[act.voltage]
    )
    run = scene.simulate(0.5, rtol=1e-7)
    n = MODES
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(record.stiffness), -gain * np.outer(LOAD[0], LOAD[0])]])
    exact = expm(A * 0.5) @ np.concatenate([Q0, np.zeros(n)])
    np.testing.assert_allclose(run.q(body)[-1], exact[:n], atol=3e-3 * abs(Q0).max())
    undamped = np.cos(np.sqrt(record.stiffness) * 0.5) * Q0
    assert abs(undamped - exact[:n]).max() > 0.1 * abs(Q0).max()
    np.testing.assert_allclose(
        run.port(sense).flow, run.q(body) @ LOAD[0], rtol=1e-12
    )


def test_a_transfer_function_from_voltage_to_charge():
    record = with_ports(damping=0.01)
    scene, body = clamped(record)
    machine = scene.linearize(
        inputs=[fm.force.PortEffort(body.port("a"), 1.0)],
        outputs=[body.port("b").strain_charge, body.port("b").strain_current],
    )
    A, B, C, D = machine.state_space()
    s = 4.0j
    found = C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D
    response = np.linalg.solve(s**2 * np.eye(MODES) + s * record.damping + np.diag(record.stiffness), LOAD[0])
    np.testing.assert_allclose(found[:, 0], [LOAD[1] @ response, s * (LOAD[1] @ response)], rtol=1e-7)


@pytest.mark.filterwarnings("ignore::flexmbd.RangeWarning")
def test_a_body_that_turns_has_the_same_circuit():
    """A free body with a shunt: momenta stay, and energy is lost to the resistor alone."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(ONE), name="arm")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    free.velocity = np.array([0.3, -0.2, 0.1, 0.5, 0.8, -0.6])
    body.q = Q0
    port = body.port("a")
    scene.add_force(fm.force.shunt(port, resistance=3.0))
    run = scene.simulate(1.0, rtol=1e-8)
    momentum = run.momentum()
    for values in (momentum.linear, momentum.angular):
        np.testing.assert_allclose(values, values[:1] + 0 * values, atol=1e-6 * np.linalg.norm(values[0]))
    series = run.port(port, t=np.linspace(0.0, 1.0, 4001))
    energy = run.energy(t=series.t).total
    np.testing.assert_allclose(energy - energy[0], series.work, atol=1e-5 * energy[0])
    assert series.work[-1] < -1e-3 * energy[0]


def test_a_port_at_rest_costs_no_element():
    scene, body = clamped(with_ports())
    assert len(scene.start().scene.plan.elements) == 0
    body.port("a").voltage = 1.0
    assert len(scene.start().scene.plan.elements) == 1


def test_wrong_ports():
    scene, body = clamped(with_ports())
    with pytest.raises(fm.SceneError, match=r"no port 'top'; it has: 'a', 'b'"):
        body.port("top")
    with pytest.raises(fm.SceneError, match=r"has no ports.*electrodes"):
        fm.FlexibleBody(replace(ONE, ports=None), name="bare").port("a")
    port = body.port("a")
    assert port is body.port("a")
    with pytest.raises(fm.SceneError, match=r"voltage of port arm.a: the scene has it already"):
        scene.add_force(fm.force.PortEffort(port, 3.0))
    port.voltage = "much"
    with pytest.raises(fm.SceneError, match=r"voltage of port arm.a: str is not a function of time"):
        scene.simulate(0.1)
    port.voltage = 3.0
    with pytest.raises(fm.SceneError, match=r"shunt of arm.a: its voltage is given already"):
        fm.force.shunt(port, resistance=1.0)
    with pytest.raises(fm.SceneError, match=r"resistance = 0.0 must be positive"):
        fm.force.shunt(body.port("b"), resistance=0.0)
    with pytest.raises(fm.SceneError, match=r"a port, as body.port"):
        fm.force.shunt(body, resistance=1.0)


def test_a_circuit_beside_a_given_voltage():
    """The other electrode's voltage acts through the modes and through the capacity between them; power closes."""
    record = with_ports()
    scene, body = clamped(record)
    given, own = body.port("a"), body.port("b")
    given.voltage = fm.Sine(3.0, 8.0)
    circuit = scene.add_force(fm.force.shunt(own, resistance=5.0))
    run = scene.simulate(1.0, rtol=1e-9)
    np.testing.assert_allclose(run.port(own).flow, run.states(circuit)[:, 0], atol=1e-12)
    t = np.linspace(0.0, 1.0, 4001)
    works = [run.port(port, t=t).work for port in (given, own)]
    energy = run.energy(t=t).total
    np.testing.assert_allclose(sum(works), energy - energy[0], atol=1e-6 * energy.max())
    lost = np.trapezoid(run.port(own, t=t).effort ** 2 / 5.0, t)
    np.testing.assert_allclose(works[1][-1], -lost, rtol=1e-5)
    assert lost > 1e-3 * energy.max()
    now = run.at(0.5)
    np.testing.assert_allclose(
        own.induced_charge(now), LOAD[1] @ run.q(body, t=[0.5])[0] + 3e-3 * 3.0 * np.sin(4.0), rtol=1e-9
    )


def test_two_circuits_with_a_capacity_between():
    scene, body = clamped(with_ports())
    for name in "ab":
        scene.add_force(fm.force.shunt(body.port(name), resistance=1.0))
    with pytest.raises(fm.SceneError, match=r"follow the signal 'voltage of arm\.[ab]', which they set"):
        scene.simulate(0.1)
    alone = with_ports(LOAD, np.diag(np.diag(CAPACITY)))
    scene, body = clamped(alone)
    for name in "ab":
        scene.add_force(fm.force.shunt(body.port(name), resistance=1.0))
    scene.simulate(0.1)


def test_a_port_used_twice():
    """By two circuits, or by a circuit and a controller."""
    scene, body = clamped(ONE)
    port = body.port("a")
    scene.add_force(fm.force.shunt(port, resistance=1.0))
    with pytest.raises(fm.SceneError, match=r"set the signal 'voltage of arm.a' already"):
        scene.start_with([fm.force.shunt(port, resistance=1.0)])
    scene.add_controller(lambda t, y: 0.0, period=0.01, measurements=[port.strain_charge], inputs=[port.voltage])
    with pytest.raises(fm.SceneError, match=r"'voltage of arm.a' is set by states 'shunt of arm.a' already"):
        scene.simulate(0.1)


def test_states_that_follow_what_they_set():
    scene, body = clamped(ONE)
    port = body.port("a")
    signal = fm.Signal("v")
    port.voltage = signal
    scene.add_states(
        lambda t, z, u: -z, initial=[0.0], scale=1.0, measurements=[signal], outputs=lambda t, z, u: z, inputs=[signal]
    )
    with pytest.raises(fm.SceneError, match=r"follow the signal 'v', which they set"):
        scene.simulate(0.1)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"load": LOAD[:, :2]}, "load"),
        ({"capacity": CAPACITY[:1]}, "capacity"),
        ({"capacity": -CAPACITY}, "capacity is negative"),
        ({"capacity": np.array([[1.0, 0.5], [0.0, 1.0]])}, "not symmetric"),
        ({"names": ("a", "a")}, "names a port twice"),
        ({"efforts": ("voltage",)}, "efforts"),
        ({"load": LOAD * np.nan}, "not finite"),
    ],
)
def test_a_record_with_wrong_ports(change, told):
    record = with_ports()
    with pytest.raises(fm.RecordError, match=told):
        replace(record, ports=replace(record.ports, **change))
