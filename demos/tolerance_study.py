# # Which dimension moves the peak stress of a connecting rod
#
# A slider-crank at 6000 revolutions a minute with a flexible steel rod. Its parts are made to tolerances: the crank's
# throw, the piston's mass, the line of the cylinder, and the axis of the crank pin, which is never quite square to the
# plane of the motion. How much does the peak stress in the rod scatter, and which of these dimensions does it hang on?
#
# The machine is compiled once. A variant is a run with other values of its parameters, which starts without Python's
# set-up, and threads run variants side by side. `./run python demos/tolerance_study.py` runs 40 of them,
# `./run python demos/tolerance_study.py 10000` ten thousand; killed and begun again, it goes on where it was. A second
# word names other workers: the address of a dask scheduler, `... 10000 tcp://host:8786`, or, on three ranks of which
# one hands out the variants, `-m mpi4py.futures demos/tolerance_study.py 10000 mpi`. Results and a picture go to the
# folder `out_tolerance_study`.

# ruff: noqa: E402
import sys
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

import petsc4py
from mpi4py import MPI

petsc4py.init(comm=MPI.COMM_SELF)  # by itself: MPI's workers do not start PETSc

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import Keep, ModalDamping, craig_bampton

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 40
WORKERS = sys.argv[2] if len(sys.argv) > 2 else "threads"
if MPI.COMM_WORLD.rank > 0:  # of MPI's workers no one comes here
    sys.exit()
CRANK, LENGTH, PISTON = 0.08, 0.3, 0.8  # m, m, kg
OMEGA = 6000.0 * 2.0 * np.pi / 60.0  # rad/s
TURN = 2.0 * np.pi / OMEGA  # s
#: Standard deviations: of lengths (m), of the piston's mass (kg), of axes (rad).
SPREAD = {"throw": 0.1e-3, "piston": 0.01, "offset": 0.2e-3, "cylinder tilt": 0.5e-3, "pin tilt": 0.5e-3}

out = Path("out_tolerance_study")
out.mkdir(exist_ok=True)

# ## The rod
#
# The record keeps the stress at the nodes for each mode, so that a variant's peak stress needs no mesh.

steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
mesh = meshes.connecting_rod(length=LENGTH, h=9e-3, comm=MPI.COMM_SELF)
pins = [Interface("big_end", origin=(0.0, 0.0, 0.0)), Interface("small_end", origin=(LENGTH, 0.0, 0.0))]
model = ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=pins)
damping = ModalDamping(0.02, held=["big_end"])
rod = craig_bampton(model, modes=6, frame="big_end", damping=damping, keep=Keep(stress=True))
inside = rod.stress.interface < 0  # beside rigid interfaces the stress of a mesh means nothing
sigma = np.ascontiguousarray(rod.stress.sigma[inside]).reshape(-1, rod.n_modes)

# ## The machine, compiled once
#
# The crank comes up to speed within a revolution, without a jump up to the second derivative; the next one counts.

rise = OMEGA * np.array([6.0 / TURN**5, -15.0 / TURN**4, 10.0 / TURN**3, 0.0, 0.0, 0.0])
steady = np.array([0.0, 0.0, 0.0, 0.0, 0.0, OMEGA])
angle = PPoly(np.column_stack([rise, steady]), [0.0, TURN, 3.0 * TURN]).antiderivative()

scene = fm.System(gravity=(0.0, -9.81, 0.0))
crank = scene.add(fm.RigidBody(mass=1.5, inertia=(1e-3, 3e-3, 3e-3), com=(0.02, 0.0, 0.0)), name="crank")
conrod = scene.add(fm.FlexibleBody(rod), name="conrod")
piston = scene.add(fm.RigidBody(mass=PISTON, inertia=(5e-4, 5e-4, 5e-4)), name="piston")
turn = fm.joint.Revolute("z")
pin, cylinder = crank.frame((CRANK, 0.0, 0.0)), scene.ground.frame()
drive = scene.connect(turn, scene.ground.frame(), crank.frame(), name="main bearing")
scene.connect(turn, pin, conrod.frame("big_end"), name="crank pin")
scene.connect(turn, conrod.frame("small_end"), piston.frame(), name="piston pin")
scene.connect(fm.joint.Prismatic("x"), cylinder, piston.frame(), name="cylinder")
drive.prescribe(angle)

machine = scene.compile(
    parameters={
        "throw": fm.parameter.FrameOrigin(pin),
        "pin_axes": fm.parameter.FrameAxes(pin),
        "piston": fm.parameter.Mass(piston),
        "offset": fm.parameter.FrameOrigin(cylinder),
        "cylinder_axes": fm.parameter.FrameAxes(cylinder),
    }
)

# ## Samples
#
# Arrays with a row a variant. Deviations that make up a place or axes are worked out here, for all variants at once.


def turned(axis: int, angles: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations about a coordinate axis."""
    c, s = np.cos(angles), np.sin(angles)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    R = np.tile(np.eye(3), (len(angles), 1, 1))
    R[:, first, first] = R[:, second, second] = c
    R[:, second, first], R[:, first, second] = s, -s
    return R


rng = np.random.default_rng(2026)
deviation = {name: size * rng.standard_normal(COUNT) for name, size in SPREAD.items()}
zero = np.zeros(COUNT)
samples = {
    "throw": np.column_stack([CRANK + deviation["throw"], zero, zero]),
    "pin_axes": turned(0, deviation["pin tilt"]),
    "piston": PISTON + deviation["piston"],
    "offset": np.column_stack([zero, deviation["offset"], zero]),
    "cylinder_axes": turned(1, deviation["cylinder tilt"]),
}

# ## The runs


def peak_stress(run: fm.Trajectory) -> float:
    """The largest von Mises stress (Pa) in the second revolution."""
    times = np.linspace(TURN, 2.0 * TURN, 73)
    q = rod.strained(run.q(conrod, t=times))
    xx, yy, zz, xy, xz, yz = (sigma @ q.T).reshape(-1, 6, len(times)).transpose(1, 0, 2)
    shear = xy**2 + xz**2 + yz**2
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * shear
    return float(np.sqrt(square.max()))


def side_force(run: fm.Trajectory) -> float:
    """The largest force (N) across the cylinder."""
    return float(np.abs(run.reaction(guide)[:, 1]).max())


QUIET = "ignore", fm.StartWarning  # a tilted pin bends the rod from the start, as it is meant to


@contextmanager
def workers() -> Iterator[Executor | None]:
    """Who runs the variants, and is not to warn either; threads of this process are nobody else."""
    if WORKERS == "mpi":
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor(main=False, initializer=warnings.simplefilter, initargs=QUIET) as pool:
            yield pool
    elif WORKERS == "threads":
        yield None
    else:
        from distributed import Client

        with Client(WORKERS) as client:
            client.run(warnings.simplefilter, *QUIET)
            yield client.get_executor()


guide = machine.connections[3]
warnings.simplefilter(*QUIET)
began = time.perf_counter()
with workers() as pool:
    study = machine.ensemble(
        samples,
        {"peak": peak_stress, "side": side_force},
        t_end=2.0 * TURN,
        rtol=1e-4,
        integrator=fm.GeneralizedAlpha(),
        executor=pool,
        file=out / f"study_{COUNT}.h5",
        progress=COUNT > 100,
    )
seconds = time.perf_counter() - began
for failure in study.failures:
    print(f"variant {failure.index} failed: {failure.message}")

# ## Which dimension it is
#
# A peak is a largest value, over nodes and instants: lengths and masses move it both ways, but a tilt bends the rod to
# one side or the other and raises it either way. So each deviation gets two terms, itself and its size, by least
# squares; a dimension's share is the variance of its terms.

done = study.done
peak = study.output("peak")[done] / 1e6
standard = {name: (values / SPREAD[name])[done] for name, values in deviation.items()}
terms = {name: np.column_stack([z, np.abs(z) - np.sqrt(2.0 / np.pi)]) for name, z in standard.items()}
matrix = np.column_stack([np.ones(len(peak)), *terms.values()])
solution, *_ = np.linalg.lstsq(matrix, peak, rcond=None)
slopes = dict(zip(terms, solution[1:].reshape(-1, 2), strict=True))
parts = {name: float(np.var(terms[name] @ slope)) for name, slope in slopes.items()}
total = sum(parts.values())
print(f"{done.sum()} variants in {seconds:.1f} s; peak {peak.mean():.2f} MPa, standard deviation {peak.std():.2f} MPa")
print("                 MPa a standard deviation: by sign, by size; share")
for name, part in parts.items():
    by_sign, by_size = slopes[name]
    print(f"  {name:14s} {by_sign:+20.3f} {by_size:+12.3f} {100.0 * part / total:8.1f} %")

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
left.hist(peak, bins=max(10, COUNT // 100), color="#4878a8")
left.set(xlabel="peak stress, MPa", ylabel="variants", title=f"{done.sum()} variants")
names = sorted(parts, key=lambda name: parts[name])
right.barh(names, [100.0 * parts[name] / total for name in names], color="#b8643c")
right.set(xlabel="share of the scatter, %", title="which dimension moves it")
figure.savefig(out / "tolerance_study.png", dpi=120)

# what must hold at any number: every variant ran, the terms explain the scatter, and it is the tilts'
assert done.all()
assert np.std(peak - matrix @ solution) < 0.5 * peak.std()
assert parts["pin tilt"] + parts["cylinder tilt"] > 0.8 * total
study.close()
