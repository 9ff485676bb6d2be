# # A large part on several processes: a gear case, its eight interfaces, its frequency response
#
# The housing of a gear stands on four feet and carries two shafts in four bores. gmsh builds and meshes it; the ranks
# share its cells and reduce it together to its eight interfaces and its lowest modes. The machine, the case on rubber
# mounts, then has some seventy coordinates: it is shaken by the teeth at one bearing and heard at another.
#
# `./run python demos/large_part.py`, or on two processes `./run mpirun -n 2 python demos/large_part.py`. A number after
# it asks for about so many degrees of freedom: `./run mpirun -n 2 python demos/large_part.py 500000`. It tells how long
# each part took, and how much memory. The picture goes to `out_large_part`.

import resource
import sys
import time
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam, on_root
from flexmbd.reduction import ModalDamping, craig_bampton

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_large_part")
if root:
    out.mkdir(exist_ok=True)
asked = float(sys.argv[1]) if len(sys.argv) > 1 else 50e3


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


def stage(name: str, began: float) -> float:
    """Tell what a stage took until all ranks were done with it; the time now (s)."""
    comm.barrier()
    now = time.perf_counter()
    say(f"  {name:<12} {now - began:7.2f} s")
    return now


# ## The case
#
# A box with walls of 12 mm, a boss around each bore and a foot at each corner. Each bore and each foot's hole is a
# named group of surfaces. gmsh works on rank 0 alone, while the others sleep, and writes a file that all read.

LENGTH, WIDTH, HEIGHT, WALL = 0.42, 0.24, 0.20, 0.012  # m
BORES = {"input": (0.12, 0.10, 0.036), "output": (0.28, 0.10, 0.045)}  # x, z, radius of the shafts
FOOT, HOLE = 0.04, 0.007  # m
h = 0.0215 * (50e3 / asked) ** 0.52  # m, size of the cells


def write_case(path: Path) -> None:
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    cad = gmsh.model.occ
    body = [(3, cad.addBox(0.0, 0.0, 0.0, LENGTH, WIDTH, HEIGHT))]
    body, _ = cad.cut(body, [(3, cad.addBox(WALL, WALL, WALL, *(np.array([LENGTH, WIDTH, HEIGHT]) - 2 * WALL)))])
    added, holes, walls = [], [], {}
    for name, (x, z, radius) in BORES.items():
        for side, y in (("front", -WALL), ("back", WIDTH - WALL)):
            added.append((3, cad.addCylinder(x, y, z, 0.0, 2 * WALL, 0.0, radius + WALL)))
            holes.append((3, cad.addCylinder(x, y, z, 0.0, 2 * WALL, 0.0, radius)))
            walls[f"{name} {side}"] = (x - radius, y, z - radius, x + radius, y + 2 * WALL, z + radius)
    for k, (x, y) in enumerate([(-FOOT, 0.0), (LENGTH, 0.0), (-FOOT, WIDTH - FOOT), (LENGTH, WIDTH - FOOT)], start=1):
        added.append((3, cad.addBox(x, y, 0.0, FOOT, FOOT, WALL)))
        cx, cy = x + FOOT / 2, y + FOOT / 2
        holes.append((3, cad.addCylinder(cx, cy, 0.0, 0.0, 0.0, WALL, HOLE)))
        walls[f"foot {k}"] = (cx - HOLE, cy - HOLE, 0.0, cx + HOLE, cy + HOLE, WALL)
    body, _ = cad.fuse(body, added)
    cad.cut(body, holes)
    cad.synchronize()
    margin = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]) * 1e-4
    for name, box in walls.items():
        surfaces = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*(np.array(box) + margin), dim=2)]
        gmsh.model.addPhysicalGroup(2, surfaces, name=name)
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="case")
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    gmsh.option.setNumber("Mesh.MeshSizeMin", h / 2)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


say(f"on {comm.size} {'process' if comm.size == 1 else 'processes'}:")
now = began = time.perf_counter()
file = out / "case.msh"
on_root(comm, lambda: write_case(file))
mesh = meshes.read(file, comm=comm)
now = stage("mesh", now)

# ## The reduction
#
# Rigid bores, for bearings press into them, and averaged holes under bolt heads. Quadratic tetrahedra of cast
# aluminium.

aluminium = forms.solid_linear.Parameters(E=7.2e10, nu=0.33, rho=2700.0)
bores = [f"{name} {side}" for name in BORES for side in ("front", "back")]
feet = [f"foot {k}" for k in (1, 2, 3, 4)]
model = ContinuumModel(
    mesh,
    forms.solid_linear,
    aluminium,
    degree=2,
    interfaces=[*map(Interface, bores), *(Interface(name, coupling=fm.Coupling.AVERAGED) for name in feet)],
)
now = stage("assembly", now)
damping = ModalDamping(0.01, held=bores[:1])
case = craig_bampton(model, modes=20, frame=bores[0], geometric_stiffness=False, damping=damping)
now = stage("reduction", now)
sizes = [one / 1e6 for one in comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)]
say(f"{model.K.getSize()[0]} degrees of freedom, {case.mass:.2f} kg, {case.n_modes} modes")
say(f"at the most, of each rank {', '.join(f'{one:.2f}' for one in sizes)} GB")
free = case.frequencies()
say(f"free, it vibrates at {', '.join(f'{f:.0f}' for f in free[:4])} Hz")

# ## The machine
#
# On four rubber mounts. The teeth push upwards at the input shaft's front bore; the output shaft's back bore answers.

scene = fm.System(team=MpiTeam(comm))
housing = scene.add(fm.FlexibleBody(case), name="case")
scene.connect(fm.joint.Free(), scene.ground.frame(), housing.frame(bores[0]))
stiffness = np.array([1e6, 1e6, 2e6, 50.0, 50.0, 50.0])  # N/m, N m/rad
for name in feet:
    below = scene.ground.frame(p=case.interface(name).p_BI_B)
    scene.add_force(fm.force.Bushing(below, housing.frame(name), stiffness, 2e-5 * stiffness))
teeth = fm.force.FrameForce(housing.frame("input front"), (0.0, 0.0, lambda t: 1.0))
shaken = scene.linearize(inputs=[teeth], outputs=[fm.output.Acceleration(housing.frame("output back"))])
say("on its mounts " + ", ".join(f"{f:.1f}" for f in shaken.frequencies()[:6]) + " Hz, then")
say("  " + ", ".join(f"{f:.0f}" for f in shaken.frequencies()[6:10]) + " Hz")
hertz = np.geomspace(10.0, 4000.0, 800)
shaken.plot(2.0 * np.pi * hertz, path=out / "response.png", title="A gear case, shaken by its teeth")
now = stage("machine", now)
say(f"all {now - began:.2f} s")
