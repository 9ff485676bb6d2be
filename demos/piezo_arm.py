# # An arm that feels its vibration, and damps it by a circuit
#
# A steel arm has a skin of piezoelectric ceramic on either side. A motor brings it to speed, and it goes on to vibrate.
# One skin senses: its electrode is in short circuit through an amplifier that counts the charge. The other one damps:
# what its electrode drives through a resistor, or through a resistor and a coil, is energy that the arm loses.
#
# `./run python demos/piezo_arm.py`; the picture goes to `out_piezo_arm`. `--short` simulates half the time.

import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Electrode, Interface, MpiTeam
from flexmbd.reduction import craig_bampton

LENGTH, WIDTH, LAYER = 0.2, 0.02, 0.4e-3  # m; three layers of equal height
TURN, RISE = np.radians(10.0), 0.05  # by which the motor turns the arm, in s
END = 0.6 if "--short" in sys.argv else 1.2  # s

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_piezo_arm")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The arm
#
# Steel is the same formulation without piezoelectricity, and an electrode of cells: a metal has one potential, here
# that of the ground. The skins' outer faces are electrodes of their own, two ports.

ceramic = forms.solid_piezo.reference().parameters  # PZT-5A, poled along z
steel = forms.solid_piezo.elastic(E=2.1e11, nu=0.3, rho=7850.0)
layers = {"below": (forms.solid_piezo, ceramic), "core": (forms.solid_piezo, steel)}
layers["above"] = (forms.solid_piezo, ceramic)
mesh = meshes.block(LENGTH, WIDTH, 3 * LAYER, divisions=(16, 2, 3), layers=tuple(layers), comm=comm)
electrodes = [Electrode("core", grounded=True), Electrode("z_min"), Electrode("z_max")]
model = ContinuumModel(mesh, layers, degree=2, interfaces=[Interface("x_min")], conditions=electrodes)
record = craig_bampton(model, modes=6, frame="x_min")
assert record.ports is not None
say(f"{record.n_modes} modes; ports {', '.join(record.ports.names)}")


def machine() -> tuple[fm.System, fm.FlexibleBody]:
    """The arm on the motor's shaft, which turns by a smooth step."""
    scene = fm.System(team=MpiTeam(comm))
    arm = scene.add(fm.FlexibleBody(record), name="arm")
    shaft = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), arm.frame("x_min"), name="shaft")
    quintic = TURN * np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) / RISE ** np.arange(5, -1, -1)
    rest = np.array([0.0, 0.0, 0.0, 0.0, 0.0, TURN])
    shaft.prescribe(PPoly(np.column_stack([quintic, rest]), [0.0, RISE, 2 * RISE]))
    return scene, arm


# ## The circuit
#
# Of the lowest mode, with the frequency w in short circuit, the coupling K^2 = b^2 / (C k) says how much of its energy
# is electric. A coil and a resistor in series are an absorber; so large a coil is made of amplifiers. Tuned as Hagood
# and von Flotow (1991) have it, L = 1 / (C w^2 (1 + K^2)^2) and R = sqrt(2) K / (C w (1 + K^2)). A resistor alone is
# best at R = 1 / (C w sqrt(1 + K^2)).

which = record.ports.names.index("z_max")
modes = record.ports.load[which] ** 2 / record.stiffness
first = int(np.flatnonzero(modes > 1e-3 * modes.max())[0])
w, capacity = float(np.sqrt(record.stiffness[first])), record.ports.capacity[which, which]
capacity += modes[first + 1 :].sum()  # the higher modes follow at once
coupling = modes[first] / capacity
absorber = {
    "inductance": 1.0 / (capacity * w**2 * (1.0 + coupling) ** 2),
    "resistance": np.sqrt(2.0 * coupling) / (capacity * w * (1.0 + coupling)),
}
circuits = {
    "short circuit": None,
    "resistor": {"resistance": 1.0 / (capacity * w * np.sqrt(1.0 + coupling))},
    "coil and resistor": absorber,
}
say(f"{w / (2 * np.pi):.1f} Hz, K^2 = {coupling:.4f}, C = {capacity * 1e9:.1f} nF")
say(f"coil {absorber['inductance']:.2f} H, resistor {absorber['resistance'] / 1e3:.2f} kOhm")

# ## The machine

charges, ratios = {}, {}
for name, circuit in circuits.items():
    scene, arm = machine()
    if circuit is not None:
        scene.add_force(fm.force.shunt(arm.port("z_max"), voltage_scale=10.0, **circuit))
    run = scene.simulate(END, rtol=1e-5)
    times = np.linspace(0.0, END, 4001)
    sense, act = (run.port(arm.port(port), t=times) for port in ("z_min", "z_max"))
    charges[name] = sense.flow * 1e6
    late = times > RISE
    energy = run.energy(t=times).total
    swing = [np.abs(charges[name][part]).max() for part in (late & (times < RISE + 0.1), times > END - 0.1)]
    ratios[name] = swing[1] / swing[0]
    say(
        f"{name}: {len(run.t) - 1} steps; sensed {swing[0]:.2f} uC at first, {swing[1]:.3f} uC at last; "
        f"{np.abs(act.effort).max():.1f} V at most"
    )
    # once the motor stands, what the machine loses is what the circuit takes
    lost = energy[late][0] - energy[late][-1]
    taken = act.work[late][0] - act.work[late][-1]
    say(f"  energy lost after the step {lost * 1e3:.4f} mJ, taken by the circuit {taken * 1e3:.4f} mJ")
    assert abs(lost - taken) < 2e-2 * energy[late][0]

if root:
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, charge in charges.items():
        axes.plot(times, charge, lw=0.8, label=name)
    axes.set(xlabel="time, s", ylabel="charge of the sensing skin, uC", xlim=(0, END))
    axes.legend(frameon=False)
    figure.savefig(out / "piezo_arm.png", dpi=120)
say(f"in {out}: piezo_arm.png")

assert ratios["short circuit"] > 0.9
assert ratios["coil and resistor"] < 0.5 * ratios["resistor"] < 0.5
say("all checks passed")
