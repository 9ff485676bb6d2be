# # A metal of one's own that yields later the faster it is: from the file to the machine
#
# Mild steel, hit fast, carries more than its yield stress. Perzyna's law says how much: the accumulated plastic strain
# alpha grows by alpha' = (q - sigma_y) / eta, so that a flow at the rate e has the overstress eta e. No material that
# flexmbd brings along knows rates, so this one is a form file, `demos/rate_dependent_form/perzyna.py`: its functions
# take the length of the step, `dt`. docs/writing_a_form.md says how to write one.
#
# Here it is checked, held against the closed form of a bar that is pulled, and put into a machine: a hammer on rails
# that crushes a strut, at two speeds and with a metal that knows no rates.
#
# `./run python demos/rate_dependent_form.py`; the picture goes to `out_rate_dependent_form`.

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    check_form,
    follow,
    load_form,
    prescribed_dofs,
)

FORM = Path(__file__).parent / "rate_dependent_form" / "perzyna.py"
LENGTH, SIDE = 0.1, 0.02  # m, of the strut
YIELD, VISCOSITY = 250e6, 2e6  # Pa, Pa s
HAMMER = 60.0  # kg
END = 1e-3  # s

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_rate_dependent_form")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The check
#
# The suite tries the flow in steps of the length that the form's own reference problem gives.

sheet = check_form(FORM, comm=comm)
say(sheet.text() + "\n")
assert sheet.passed

form: Any = load_form(FORM)
steel = form.Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=YIELD, hardening=0.0, viscosity=VISCOSITY)

# ## A bar that is pulled
#
# At the steady rate e the stress is sigma_y + eta e (1 - exp(-E t / eta)), t from first yield on. Slow loading has no
# time of its own: `seconds` says that here the load parameter is the time.

rate = 40.0  # 1/s
cube = NonlinearModel(meshes.block(SIDE, SIDE, SIDE, divisions=(2, 2, 1), comm=comm), form, steel, degree=1)
held = prescribed_dofs(cube, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
pulled = (held % 3 == 0) & (cube.layout.node_x[held // 3, 0] > 0.5 * SIDE)
first, settles = YIELD / (steel.E * rate), VISCOSITY / steel.E
times = first + settles * np.linspace(0.0, 5.0, 101)
path = follow(
    cube, list(times), prescribed=held, displacement=lambda t: rate * t * SIDE * pulled, seconds=1.0, smallest=0.1
)
found = np.array([comm.allreduce(step.reactions[pulled].sum()) / SIDE**2 for step in path.steps])
exact = YIELD + VISCOSITY * rate * (1.0 - np.exp(-(times - first) / settles))
say(f"bar pulled at {rate:g}/s: {found[-1] / 1e6:.1f} MPa, closed form {exact[-1] / 1e6:.1f} MPa")
assert abs(found - exact).max() < 0.01 * VISCOSITY * rate

# ## The hammer
#
# A hammer on rails meets the strut's head, which is bonded to it. The force is what the strut's foot has to bear.


def crush(metal: Any, speed: float) -> tuple[fm.Trajectory, np.ndarray, np.ndarray]:
    """The run, the crush (m) and the mean stress over the strut's section (Pa)."""
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(6, 2, 2), comm=comm)
    ends = [Interface("x_min"), Interface("x_max")]
    body = NonlinearModel(mesh, form, metal, degree=1, interfaces=ends)
    head = fm.RigidBody(HAMMER, 0.01 * HAMMER * np.ones(3))
    strut = fm.ContinuumBody(ImplicitContinuum(body, rigid_parts={"x_max": head}))
    scene = fm.System(team=MpiTeam(comm))
    scene.add(strut, name="strut")
    foot = scene.connect(fm.joint.Fixed(), scene.ground.frame(), strut.frame("x_min"), name="foot")
    rails = scene.connect(
        fm.joint.Prismatic(axis="x"), scene.ground.frame(p=(LENGTH, 0.0, 0.0)), strut.frame("x_max"), name="rails"
    )
    rails.velocity = -speed
    run = scene.simulate(END, integrator=fm.GeneralizedAlpha(rho=0.6), h=END / 100)
    force = np.abs(np.asarray(run.reaction(foot)[:, 0]))
    return run, LENGTH - run.position(strut.frame("x_max"))[:, 0], force / SIDE**2


figure = Figure(figsize=(6.4, 4.0), layout="constrained")
axes = figure.subplots()
for name, metal, speed in (
    ("no rates, 6 m/s", replace(steel, viscosity=0.0), 6.0),
    ("3 m/s", steel, 3.0),
    ("6 m/s", steel, 6.0),
):
    run, crushed, stress = crush(metal, speed)
    # where it flows the strut shortens at the rate v / L
    slowing = np.gradient(crushed, run.t) / LENGTH
    late = run.t > 0.3 * END
    expected = YIELD + metal.viscosity * slowing
    off = abs(stress / expected - 1.0)[late].mean()
    mean = stress[late].mean() / 1e6
    say(f"hammer, {name}: mean stress {mean:.0f} MPa; off sigma_y + eta v / L by {100 * off:.1f} %")
    assert off < 0.06
    axes.plot(1e3 * crushed, stress / 1e6, label=name)
axes.axhline(YIELD / 1e6, color="0.5", linestyle="--", label="yield stress")
axes.set(xlabel="crush, mm", ylabel="force over section, MPa", ylim=(0.0, None))
axes.legend()
if root:
    figure.savefig(out / "overstress.png", dpi=150)
say(f"in {out}: overstress.png")
say("all checks passed")
