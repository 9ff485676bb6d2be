# # Snap-through: a shallow arch under its weight, and the paths that it may take
#
# A clamped arch that is pressed down bears more and more, until it snaps through. `equilibrium_path` goes along the arc
# of its equilibria: up to the largest load, down where no load can hold it, and up again below its supports. Before the
# largest load another path crosses, on which the arch bends to one side: it snaps earlier, that way. The arch is a full
# body of solid elements; a machine is followed in the same way (`scene.equilibrium(path=...)`).
#
# `./run python demos/snap_through.py`; the picture goes to `out_snap_through`.

from pathlib import Path

from mpi4py import MPI

import numpy as np

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import BodyAcceleration, BodyPath, NonlinearModel, clamped_dofs, equilibrium_path
from flexmbd.forms import st_venant_kirchhoff

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_snap_through")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The arch
#
# 1 m between its clamps, 10 mm thick, 50 mm high, of a stiff plastic. The load is its own weight times a growing
# number, as on a centrifuge.

SPAN, WIDTH, THICKNESS, RISE = 1.0, 0.1, 0.01, 0.05  # m
GRAVITY = 9.81  # m/s^2
mesh = meshes.block(SPAN, WIDTH, THICKNESS, divisions=(16, 1, 1), cell="hexahedron", degree=1, comm=comm)
x = mesh.mesh.geometry.x
x[:, 2] += 4.0 * RISE * x[:, 0] * (SPAN - x[:, 0]) / SPAN**2

plastic = st_venant_kirchhoff.Parameters(E=2e9, nu=0.0, rho=1000.0)
arch = NonlinearModel(mesh, st_venant_kirchhoff, plastic, degree=2)
held = clamped_dofs(arch, ["x_min", "x_max"])
weight = BodyAcceleration((0.0, 0.0, -1.0), lambda t: GRAVITY * t)

# ## The path, and the one that crosses
#
# The second one is followed down to where it joins the first again.


def crown_sinks(displacements: list[np.ndarray]) -> np.ndarray:
    """(k,) m, by how much the middle of the arch has come down."""
    nodes = np.arange(arch.layout.n_owned_nodes)
    middle = nodes[abs(arch.layout.node_x[nodes, 0] - 0.5 * SPAN) < 1e-6]
    dofs = arch.displacement_dofs[middle, 2]
    sums = [comm.allreduce(float(one[dofs].sum())) for one in displacements]
    return -np.array(sums) / comm.allreduce(len(middle))


def tell(name: str, path: BodyPath) -> None:
    say(f"{name}: {len(path.points)} points, {path.factorisations} factorisations")
    for one in path.critical:
        say(f"  {one.kind.value:12s} at {one.t:8.4f} times its weight")


straight = equilibrium_path(arch, fm.Continuation(to=80.0, longest_step=0.02), prescribed=held, loads=[weight])
tell("straight down", straight)
first, top, second, _ = straight.critical
down_to = fm.Continuation(to=1.001 * second.t, longest_step=0.02)
aside = equilibrium_path(arch, down_to, prescribed=held, loads=[weight], about=first)
tell("bent to one side", aside)
say(f"It bears {top.t:.2f} times its weight if it comes down straight, and {first.t:.2f} times if it may bend aside.")

# ## The picture
#
# Thin lines are unstable: no load that is kept holds the arch there.

curves = {"straight down": straight, "bent to one side": aside}
sinks = {name: crown_sinks([one.displacement for one in path.points]) for name, path in curves.items()}
marks = crown_sinks([one.state.displacement for one in straight.critical])
if root:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.4), layout="constrained")
    for (name, path), colour in zip(curves.items(), ("tab:blue", "tab:red"), strict=True):
        axes.plot(1e3 * sinks[name], path.factors, color=colour, lw=1.0, label=name)
        stable = np.array([one.unstable == 0 for one in path.points])
        axes.plot(1e3 * np.where(stable, sinks[name], np.nan), path.factors, color=colour, lw=3.0)
    for kind, mark in ((fm.CriticalKind.BIFURCATION, "o"), (fm.CriticalKind.LIMIT, "^")):
        mine = [one.kind is kind for one in straight.critical]
        loads = [one.t for one in straight.critical if one.kind is kind]
        axes.plot(1e3 * marks[mine], loads, mark, color="k", mfc="w", label=kind.value)
    axes.set_xlabel("crown down, mm")
    axes.set_ylabel("load over its weight")
    axes.legend(loc="upper center")
    figure.savefig(out / "paths.png", dpi=110)
    say(f"wrote {out / 'paths.png'}")
