# # A vehicle runs into a wall
#
# A square tube of mild steel is bonded to the rigid mass of a vehicle and meets a rigid wall at 35 m/s. Its walls
# buckle and fold. A quarter of the tube is meshed by solid-shells, one through the wall, with four points of the law of
# plasticity through the thickness; symmetry holds the two planes, a prismatic joint guides the vehicle, and the wall
# stops nodes, with friction. Nodes have lumped mass and go by central differences side by side with the machine; the
# vibrations through the thickness are slowed down, so that steps go by the cells' size in the wall. A dent of half a
# millimetre says where the fold begins. Walls that touch each other are not seen, so the run ends with the first fold.
#
# `./run python demos/frontal_impact.py`; pictures and the recorded fields go to `out_frontal_impact`. `--fold` goes on
# until the fold's walls are about to meet, `--short` ends early, `--fine` takes smaller cells, `--bricks` takes bricks
# through the wall in place of solid-shells, which lock more (a warning says so), `--film` makes films: of the tube, and
# of its mesh beside the wall's force over time.

import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    RigidPlane,
    Support,
    wall_form,
)

WIDTH, WALL, LENGTH = 0.06, 0.003, 0.12  # m
VEHICLE, SPEED = 10.0, 35.0  # kg of a quarter, m/s
FINE, FILM, FOLD, BRICKS = (f"--{choice}" in sys.argv for choice in ("fine", "film", "fold", "bricks"))
SHORT = "--short" in sys.argv
END = 1.05e-3 if FOLD else 0.6e-3 if SHORT else 0.9e-3  # s
DIVISIONS = ((12, 3, 96) if FINE else (5, 2, 40)) if BRICKS else (7, 1, 40) if FINE else (5, 1, 30)

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_frontal_impact")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The tube in the machine

steel = forms.hencky_plasticity.Parameters(
    E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.5e8, hardening=forms.j2_plasticity.LinearHardening(8e8)
)
mesh = meshes.crash_tube(
    WIDTH, WALL, LENGTH, divisions=DIVISIONS, fold=0.022, dent=5e-4, mitred=not BRICKS, comm=comm
)
law = forms.hencky_plasticity if BRICKS else wall_form(forms.hencky_plasticity, layers=4)
solid = NonlinearModel(mesh, law, steel, degree=1, interfaces=[Interface("z_max")])
interior = ExplicitContinuum(
    solid,
    rigid_parts={"z_max": fm.RigidBody(VEHICLE, (0.1, 0.1, 0.1))},
    planes=[RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), friction=0.2, name="wall")],
    supports=[Support("x_min", x=True), Support("y_min", y=True)],
    scaled_thickness=0.0 if BRICKS else 1.0,
)
scene = fm.System(team=MpiTeam(comm))
tube = scene.add(fm.ContinuumBody(interior), name="tube")
vehicle = tube.frame("z_max")
guide = scene.connect(fm.joint.Prismatic(axis="z"), scene.ground.frame(p=interior.frames[0].p_BI_B), vehicle)
guide.velocity = -SPEED
cells = comm.allreduce(len(solid.groups[0].cells))
kind = "bricks" if BRICKS else "solid-shells"
say(f"a quarter of {cells} {kind}, {1e3 * interior.mass:.0f} g, and {VEHICLE:g} kg behind it")
say(scene.explain())
say()

# ## The impact

began = time.perf_counter()
recording = fm.Recording(out / "fields.h5", every=END / 60)
run = scene.simulate(END, integrator=fm.CentralDifference(), recording=recording)
seconds = time.perf_counter() - began
each = 1e6 * seconds / run.stats.steps / cells
say(f"{run.stats.steps} steps in {seconds:.1f} s, {each:.1f} microseconds a step and cell")
say()

# ## The account
#
# Of the quarter. `contact` is what the wall's springs hold, `friction` what sliding on it has cost.

parts, machine = run.energies(tube), run.energy()
kinetic = parts["kinetic"] + machine.kinetic
others = ("elastic", "plastic", "contact", "friction")
series = {"kinetic": kinetic} | {name: parts[name] for name in others}
total = sum(series.values())
say("energies, J     start       end")
for name, values in {**series, "sum": total}.items():
    say(f"{name:12s}{values[0]:9.2f}{values[-1]:10.2f}")
spent = kinetic[0] - kinetic.min()
lost = abs(total - total[0]).max() / spent
say(f"largest change of the sum: {100 * lost:.2f} % of the {spent:.1f} J that the crush took")
say()

# ## Force over crush
#
# The force of the wall on the whole tube, as means over equal parts of the run: single steps have the chatter of single
# nodes. The mean force is the energy over the way.

way = -(run.position(vehicle)[:, 2] - run.position(vehicle)[0, 2])
speed = -run.velocity(vehicle)[:, 2]
wall = run.outer_forces(tube)["wall"][:, 2]
impulse = np.append(0.0, np.cumsum(0.5 * (wall[1:] + wall[:-1]) * np.diff(run.t)))
edges = np.linspace(0.0, END, 41)
force = 4.0 * np.diff(np.interp(edges, run.t, impulse)) / np.diff(edges)
mean = 4.0 * spent / way[-1]
say(f"crushed by {1e3 * way[-1]:.1f} mm; the vehicle has slowed from {speed[0]:.1f} to {speed[-1]:.1f} m/s")
say(f"whole tube: largest force {force.max() / 1e3:.0f} kN, mean force {mean / 1e3:.0f} kN")
squash = steel.yield_stress * (WIDTH**2 - (WIDTH - 2 * WALL) ** 2)
say(f"(yield stress times section {squash / 1e3:.0f} kN)")
fields = run.recorded(tube)
# folds of a square tube (Abramowicz & Wierzbicki 1986), by the flow stress that the plastic work had over its strains
strained = fields.values("plastic_strain", row=-1).mean() * interior.mass / steel.rho
flow = parts["plastic"][-1] / strained
folding = 13.06 * flow * (WIDTH - WALL) ** (1 / 3) * WALL ** (5 / 3)
say(f"(mean force of folding by plastic hinges, at the flow stress {flow / 1e6:.0f} MPa: {folding / 1e3:.0f} kN)")
strain = fields.values("plastic_strain", row=-1).max()
# the flow stress is Kirchhoff's; points of a bent cell change their volume, of which the cell holds the mean alone
kirchhoff = fields.values("von_mises", row=-1) * (1.0 + fields.values("dilatation", row=-1))
say(f"plastic strain up to {strain:.2f}, von Mises stress (Kirchhoff) up to {kirchhoff.max() / 1e6:.0f} MPa")

assert lost < 0.01
assert parts["plastic"][-1] > 0.8 * spent
# it folds: the force that first squashed the tube's section has fallen below that, and the walls leave their planes
assert force[len(force) // 2 :].min() < squash < force[:20].max()
swing = abs((fields.values("position", row=-1) - fields.mesh.x)[:, :2]).max()
say(f"walls moved sideways by up to {1e3 * swing:.1f} mm")
assert swing > 2 * WALL

# ## Pictures

if root:
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(1e3 * np.interp(0.5 * (edges[1:] + edges[:-1]), run.t, way), force / 1e3)
    left.axhline(mean / 1e3, color="0.5", linestyle="--", label="mean")
    left.set(xlabel="crush, mm", ylabel="force of the whole tube, kN")
    left.legend()
    for name, values in series.items():
        right.plot(1e3 * run.t, values - (kinetic[-1] if name == "kinetic" else 0.0), label=name)
    right.set(xlabel="time, ms", ylabel="energy of the quarter, J (kinetic: over its end)")
    right.legend()
    figure.savefig(out / "force_and_energy.png", dpi=150)


def quadrilaterals(x: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """(f, 4) vertices: the faces of bricks, each shown as two triangles with their longest edge in common."""
    corners: dict[tuple[int, int], list[int]] = {}
    for one in triangle:
        lengths = np.linalg.norm(x[np.roll(one, -1)] - x[np.roll(one, 1)], axis=1)  # of the edges opposite
        k = int(lengths.argmax())
        diagonal = sorted((int(one[k - 1]), int(one[k - 2])))
        corners.setdefault((diagonal[0], diagonal[1]), []).append(int(one[k]))
    return np.array([(a, sides[0], b, sides[1]) for (a, b), sides in corners.items() if len(sides) == 2])


def film_of_mesh(path: Path) -> None:
    """The whole tube with the lines of its mesh, coloured by plastic strain, and the wall's force up to the instant."""
    face = quadrilaterals(fields.mesh.x, fields.mesh.triangle)
    face = face[~np.isclose(fields.mesh.x[face][..., :2], 0.0).all(axis=1).any(axis=1)]  # none of the cuts
    places, strains = fields.values("position"), fields.values("plastic_strain")
    signs = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]])
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="3d")
    left.set(xlim=(-0.05, 0.05), ylim=(-0.05, 0.05), zlim=(0.0, 1.05 * LENGTH))
    left.set_box_aspect((0.1, 0.1, 1.05 * LENGTH), zoom=1.25)
    left.view_init(elev=18, azim=-60)
    left.set_axis_off()
    right = figure.add_subplot(1, 2, 2, xlabel="time, ms", ylabel="force of the wall on the tube, kN")
    middles = 0.5e3 * (edges[1:] + edges[:-1])
    right.plot(middles, force / 1e3, color="0.8")
    (line,) = right.plot([], [], color="tab:red")
    colours = colormaps["YlOrRd"]
    top = float(strains.max())
    figure.colorbar(ScalarMappable(Normalize(0.0, top), colours), ax=left, shrink=0.6, label="plastic strain")
    solid_faces = Poly3DCollection([], linewidths=0.3, edgecolors="0.25")
    left.add_collection3d(solid_faces)

    def show_row(row: int) -> None:
        shown = (signs[:, None, None] * places[row][face]).reshape(-1, 4, 3)
        solid_faces.set_verts(shown)
        solid_faces.set_facecolor(colours(np.tile(strains[row][face].mean(axis=1), 4) / top))
        until = middles <= 1e3 * fields.t[row]
        line.set_data(middles[until], force[until] / 1e3)
        left.set_title(f"t = {1e3 * fields.t[row]:.2f} ms", fontsize="medium")

    FuncAnimation(figure, show_row, frames=range(0, len(fields.t), 2)).save(path, writer=PillowWriter(fps=10), dpi=75)


if FILM and root:
    film_of_mesh(out / "frontal_impact.gif")
if FILM:
    run.animate(out / "impact.mp4", looks={tube: fm.visual.Look("plastic_strain", mirror="xy")}, size=(1280, 960))
fm.export.vtkhdf(run, out / "impact.vtkhdf")
say(f"in {out}: force_and_energy.png, fields.h5, impact.vtkhdf{', impact.mp4, frontal_impact.gif' if FILM else ''}")
say("all checks passed")
