"""A resistor, inductor and capacitor in series between an electrode and the ground, as states."""

from __future__ import annotations

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import checked, refuse_other
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.force.protocol import check_numbers
from flexmbd.multibody.force.states import States, linear_equations
from flexmbd.multibody.functions.linear_system import LinearSystem


@checked("resistance", "inductance", "capacitance", "charge", "voltage_scale")
def shunt(
    port: Port,
    *,
    resistance: float,
    inductance: float = 0.0,
    capacitance: float | None = None,
    charge: float = 0.0,
    voltage_scale: float = 1.0,
) -> States:
    """A circuit in series across an electrode, which damps its body: resistance, inductance and capacitance.

    States are the electrode's charge Q (C), and with an inductance the current I (A) into the electrode:

        Q' = I,   L I' = -R I - V - Q / C_s,   V = (Q - induced charge) / C,

    where C is the port's capacity; without an inductance I = -(V + Q / C_s) / R. The port's effort becomes a signal of
    the circuit. Add what is returned by ``scene.add_force``. Two ports of a body with a capacity between them cannot
    both have circuits: write the states of both as one.

    Args:
        port: of a body in the scene, whose effort nothing else gives.
        resistance: ohm, positive.
        inductance: H, not negative.
        capacitance: F, positive; None: none.
        charge: C, on the electrode at the start.
        voltage_scale: V, a typical voltage, to which rtol is relative.

    Raises:
        SceneError: a number out of its range, or a port whose effort is given already.
    """
    refuse_other(port, Port, "what a shunt is across", wanted='a port, as body.port("top")')
    what = f"shunt of {port.label}"
    check_numbers(what, positive={"resistance": resistance, "voltage_scale": voltage_scale},
                  least={"inductance": inductance})  # fmt: skip
    if capacitance is not None:
        check_numbers(what, positive={"capacitance": capacitance})
    if not port.is_free:
        raise SceneError(f"{what}: its {port.effort_name} is given already, {port.effort!r:.60}; an electrode has one")
    per_charge, own = 1.0 / port.capacity, 0.0 if capacitance is None else 1.0 / capacitance
    # u is the induced charge; V + Q / C_s = stiff Q - per_charge u
    stiff, C = per_charge + own, [[per_charge, 0.0]]
    if inductance > 0.0:
        A = [[0.0, 1.0], [-stiff / inductance, -resistance / inductance]]
        B = [[0.0], [per_charge / inductance]]
    else:
        A, B, C = [[-stiff / resistance]], [[per_charge / resistance]], [[per_charge]]
    system = LinearSystem(np.array(A), np.array(B), np.array(C), np.array([[-per_charge]]), None)
    rates, outputs = linear_equations(system)
    scale = [voltage_scale * port.capacity]
    names = [port.flow_name]
    if inductance > 0.0:
        scale.append(voltage_scale * np.sqrt(port.capacity / inductance))
        names.append("current")
    initial = [charge, *([0.0] * (len(scale) - 1))]
    return States(rates, initial, scale, [port.induced_flow], outputs, [port.effort], what, names)
