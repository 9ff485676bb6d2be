# # A cantilever with a heavy cube at its tip
#
# Zienkiewicz & Taylor (The Finite Element Method for Solid and Structural Mechanics, 6th ed., section 8.6.2): an
# elastic beam, E = 100000, I = 12 both ways, density 0.02, stands on the ground and carries a cube of side 4 and
# density 1. A horizontal load at the top, a triangular pulse of two units of time, throws it over; tip and cube
# translate and turn by large amounts.
#
# The source gives neither length nor load, and no section. Chosen here: a square section (A = 12, side 3.464),
# nu = 0.3, a length of 60, and a pulse of 1500 at its peak on the centre of the cube, whose face is bonded to the beam.
#
# A reduced body is linear in its own frame. So the beam is a chain of equal pieces, each with a frame of its own, all
# from one record; a piece hangs on the one below by joint coordinates, so there is not one multiplier. The more pieces,
# the better the large rotation. Beside it stands the beam that needs no pieces: a geometrically exact one
# (`fm.ExactBeam`). `./run python demos/cantilever_tip_mass.py`; pictures go to `out_cantilever_tip_mass`.

import warnings
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import ModalDerivatives, craig_bampton

LENGTH, SIDE, CUBE = 60.0, 12.0**0.5, 4.0
PEAK, PULSE, END = 1500.0, 2.0, 20.0
PICTURES = (0.0, 2.0, 4.0, 6.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0)

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_cantilever_tip_mass")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## One piece of the beam, and many


section = forms.beam_timoshenko.Parameters.rectangle(
    1e5, 0.3, 0.02, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0)
)


def piece(length: float) -> fm.ReducedBody:
    """The record of one piece, held at its start: six static shapes of its end, and two modes."""
    mesh = meshes.line(length, divisions=8, degree=1, comm=comm)
    ends = [Interface("start"), Interface("end")]
    return craig_bampton(
        ContinuumModel(mesh, forms.beam_timoshenko, section, degree=2, interfaces=ends), modes=2, frame="start"
    )


@fm.compiled(breaks=(PULSE / 2, PULSE))
def pulse(t):
    return PEAK * max(0.0, 1.0 - abs(t - PULSE / 2) / (PULSE / 2))


def machine(
    pieces: int,
    *,
    push: fm.TimeFunction = pulse,
    record: fm.ReducedBody | None = None,
    ends: tuple[str, str] = ("start", "end"),
) -> tuple[fm.System, list[fm.FlexibleBody], fm.RigidBody]:
    """The beam, upright from the ground, and the cube on it, pushed at its centre; ``record`` of other pieces."""
    record = piece(LENGTH / pieces) if record is None else record
    scene = fm.System(team=MpiTeam(comm))
    upright = scene.ground.frame(R=[[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # the beam's x is up
    below, bodies = upright, []
    for k in range(pieces):
        body = scene.add(fm.FlexibleBody(record), name=f"piece {k + 1}")
        scene.connect(fm.joint.Fixed(), below, body.frame(ends[0]))
        below = body.frame(ends[1])
        bodies.append(body)
    mass = CUBE**3
    cube = scene.add(fm.RigidBody(mass, mass * CUBE**2 / 6 * np.ones(3)), name="cube")
    scene.connect(fm.joint.Fixed(), below, cube.frame(p=(-CUBE / 2, 0.0, 0.0)))
    scene.add_force(fm.force.FrameForce(cube.frame(), force=(push, 0.0, 0.0)))
    return scene, bodies, cube


# ## A small push
#
# The chain of pieces gives way as Timoshenko's beam with a rigid arm of half a cube, whatever their number.

push, arm = 0.1, CUBE / 2
bending = (LENGTH**3 / 3 + LENGTH**2 * arm + LENGTH * arm**2) / (section.E * section.Iy)
shear = LENGTH / (section.ky * section.E / (2 * (1 + section.nu)) * section.A)
for pieces in (1, 4):
    scene, _, cube = machine(pieces, push=push)
    given = scene.equilibrium().position(cube.frame())[0] / push
    say(f"{pieces} pieces give way by {given:.8f} for a push of one; a beam by {bending + shear:.8f}")
    assert abs(given / (bending + shear) - 1.0) < 1e-6
say()

# ## The throw, with more and more pieces

say("pieces  velocities   steps  seconds    cube at t = 10         cube at t = 20      energy after the pulse")
places, runs, chain_seconds = [], {}, {}
for pieces in (4, 8, 16):
    scene, bodies, cube = machine(pieces)
    run = scene.simulate(END, rtol=1e-6)
    late = run.t > PULSE
    energy = run.energy().total[late]
    at = run.position(cube.frame(), t=np.array([10.0, 20.0]))
    lost = np.ptp(energy) / energy[0]
    places.append(at)
    runs[pieces], chain_seconds[pieces] = (run, bodies, cube), run.stats.seconds
    where = "".join(f"{x:10.4f}{z:10.4f}  " for x, z in at[:, [0, 2]])
    number = sum(body.reduced().n_modes for body in bodies)
    say(f"{pieces:6d}{number:12d}{len(run.t):8d}{run.stats.seconds:9.2f}{where}{energy[0]:12.1f} within {lost:.1e}")
    assert lost < 1e-6
    # it is the work of the pulse
    during = np.linspace(0.0, PULSE, 4001)
    power = np.interp(during, [0.0, PULSE / 2, PULSE], [0.0, PEAK, 0.0]) * run.velocity(cube.frame(), t=during)[:, 0]
    assert abs(np.trapezoid(power, during) / energy[0] - 1.0) < 1e-5
coarse, fine = (abs(b - a).max() for a, b in pairwise(places))
say(f"the cube moves by {coarse:.3f} from 4 to 8 pieces and by {fine:.3f} from 8 to 16")

run, bodies, cube = runs[16]
R = run.rotation(cube.frame())
lean = np.degrees(np.arctan2(R[:, 0, 0], R[:, 2, 0]))
away = run.position(cube.frame())[:, 0]
say(
    f"the cube swings to x = {away.max():.2f} and back to {away.min():.2f}, and leans by up to {lean.max():.0f} degrees"
)

# second order in a piece's length
assert fine < 0.35 * coarse
assert lean.max() > 45.0
# and it stays in its plane, to the tolerance of the run
assert abs(run.position(cube.frame())[:, 1]).max() < 1e-6 * away.max()

# ## The same throw by exact beams
#
# Sections with six coordinates each, whose elements measure strains of any size: no mesh and no reduction.


def exact_machine(
    elements: int, material: forms.beam_timoshenko.Parameters = section
) -> tuple[fm.System, fm.ExactBeam, fm.RigidBody]:
    """The beam by this many elements, and the cube on it, pushed at its centre."""
    scene = fm.System(team=MpiTeam(comm))
    points = {"foot": (0.0, 0.0, 0.0), "top": (0.0, 0.0, LENGTH)}
    post = scene.add(fm.ExactBeam(points, {"post": [("foot", "top")]}, {"post": material}, elements), name="post")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), post.frame("foot"))
    mass = CUBE**3
    cube = scene.add(fm.RigidBody(mass, mass * CUBE**2 / 6 * np.ones(3)), name="cube")
    scene.connect(fm.joint.Fixed(), post.frame("top"), cube.frame(p=(0.0, 0.0, -CUBE / 2)))
    scene.add_force(fm.force.FrameForce(cube.frame(), force=(pulse, 0.0, 0.0)))
    return scene, post, cube


say()
say("elements  velocities   steps  seconds    cube at t = 10         cube at t = 20")
exact_places, exact_seconds = {}, {}
for elements in (2, 4, 8, 16, 32):
    scene, _, cube = exact_machine(elements)
    run = scene.simulate(END, rtol=1e-7)
    exact_places[elements] = run.position(cube.frame(), t=np.array([10.0, 20.0]))
    exact_seconds[elements] = run.stats.seconds
    where = "".join(f"{x:10.4f}{z:10.4f}  " for x, z in exact_places[elements][:, [0, 2]])
    say(f"{elements:8d}{6 * elements:12d}{len(run.t):8d}{run.stats.seconds:9.2f}{where}")
converged = exact_places[32]
errors = {count: abs(at - converged).max() for count, at in exact_places.items() if count < 32}
chain_errors = {count: abs(at - converged).max() for count, at in zip((4, 8, 16), places, strict=True)}
say("away from 32 exact elements, of the beam's length:")
for kind, found in (("pieces", chain_errors), ("exact elements", errors)):
    say(f"{kind:>15}: " + ", ".join(f"{count}: {error / LENGTH:.1e}" for count, error in found.items()))
assert errors[4] < chain_errors[16]
assert errors[8] < 1e-4 * LENGTH

# ## The same throw by pieces with nonlinear stiffness
#
# Solids whose strain energy is kept to the fourth degree (`ModalDerivatives`): one of them, with a dozen coordinates,
# bends as far as the throw asks. The loads between which it is to be right are named; they are those in the plane of
# the throw, so a bent body is too stiff against bending out of it. Its rigid ends would hinder Poisson's contraction,
# so both it and the exact beam beside it have nu = 0. They come close to each other up to the difference of the models:
# where a section of side h bends to the curvature k, a St Venant-Kirchhoff solid is shorter by (k h)^2 / 24.

# The source's numbers are of no material: lighter than air, which is told elsewhere.
warnings.filterwarnings("ignore", category=fm.UnitWarning)
flat = forms.beam_timoshenko.Parameters.rectangle(
    1e5, 0.0, 0.02, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0)
)


def solid_piece(length: float, *, bend: float, modes: int = 2, tol: float = 1e-3) -> fm.ReducedBody:
    """The record of one solid piece whose ends turn by up to ``bend`` (rad) against each other."""
    form = forms.st_venant_kirchhoff
    cells = max(4, round(length / 3.0))
    mesh = meshes.block(length, SIDE, SIDE, divisions=(cells, 1, 1), cell="hexahedron", degree=1, comm=comm)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, form, form.Parameters(E=1e5, nu=0.0, rho=0.02), degree=2, interfaces=ends)
    moment = 0.5 * flat.E * flat.Iy * bend / length
    loads = {"x_max.z": moment / length, "x_max.ry": moment}
    return craig_bampton(model, modes=modes, frame="x_min", nonlinear=ModalDerivatives(loads, tol=tol))


say()
say("solid pieces  velocities   steps  seconds    cube at t = 10         cube at t = 20")
scene, _, cube = exact_machine(32, flat)
run = scene.simulate(END, rtol=1e-7)
beam_places = run.position(cube.frame(), t=np.array([10.0, 20.0]))
solid_errors, solid_sizes, solid_seconds = {}, {}, {}
for pieces in (1, 2, 4):
    record = solid_piece(LENGTH / pieces, bend=2.6 / pieces)
    scene, bodies, cube = machine(pieces, record=record, ends=("x_min", "x_max"))
    run = scene.simulate(END, rtol=1e-6)
    at = run.position(cube.frame(), t=np.array([10.0, 20.0]))
    where = "".join(f"{x:10.4f}{z:10.4f}  " for x, z in at[:, [0, 2]])
    solid_sizes[pieces], solid_seconds[pieces] = pieces * record.n_modes, run.stats.seconds
    solid_errors[pieces] = abs(at - beam_places).max()
    say(f"{pieces:12d}{solid_sizes[pieces]:12d}{len(run.t):8d}{run.stats.seconds:9.2f}{where}")
say("away from the exact beam: " + ", ".join(f"{count}: {e / LENGTH:.1e}" for count, e in solid_errors.items()))
assert solid_sizes[1] <= 15
assert max(solid_errors.values()) < 0.015 * LENGTH

# That difference is no error of the reduction: with a smaller tolerance one piece and four of them go the same way.

tight = {}
for pieces, modes in ((1, 6), (4, 4)):
    record = solid_piece(LENGTH / pieces, bend=2.6 / pieces, modes=modes, tol=1e-5)
    scene, bodies, cube = machine(pieces, record=record, ends=("x_min", "x_max"))
    run = scene.simulate(END, rtol=1e-6)
    tight[pieces] = run.position(cube.frame(), t=np.array([10.0, 20.0]))
    where = "".join(f"{x:10.4f}{z:10.4f}  " for x, z in tight[pieces][:, [0, 2]])
    say(f"{pieces:12d}{pieces * record.n_modes:12d}{len(run.t):8d}{run.stats.seconds:9.2f}{where}")
apart = abs(tight[1] - tight[4]).max()
say(f"with tol=1e-5 one piece and four are {apart / LENGTH:.1e} of the length apart")
assert apart < 1e-3 * LENGTH

# ## Pictures

if root:
    run, bodies, cube = runs[16]
    frames = [bodies[0].frame("start"), *(body.frame("end") for body in bodies)]
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    half = 0.5 * CUBE * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    for axes, t in zip(figure.subplots(2, 5).ravel(), PICTURES, strict=True):
        at = np.array([t])
        line = np.array([run.position(frame, t=at)[0] for frame in frames])
        centre, turn = run.position(cube.frame(), t=at)[0], run.rotation(cube.frame(), t=at)[0]
        box = centre[[0, 2]] + half @ turn[np.ix_([0, 2], [0, 2])].T
        axes.plot(line[:, 0], line[:, 2], color="tab:blue")
        axes.fill(box[:, 0], box[:, 1], color="0.4")
        axes.set(xlim=(-60, 60), ylim=(0, 70), aspect="equal", title=f"t = {t:g}")
    figure.savefig(out / "shapes.png", dpi=120)

    # The machine of 4, 8 and 16 pieces has 40, 80 and 160 velocities, that of exact elements 6 each.
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    by_size, by_time = figure.subplots(1, 2, sharey=True)
    kinds = (
        ("reduced pieces", "o-", chain_errors, {count: 10 * count for count in chain_errors}, chain_seconds),
        ("solid pieces, nonlinear stiffness", "^-", solid_errors, solid_sizes, solid_seconds),
        ("exact elements", "s-", errors, {count: 6 * count for count in errors}, exact_seconds),
    )
    for kind, style, found, sizes, seconds in kinds:
        parts = [error / LENGTH for error in found.values()]
        by_size.loglog([sizes[count] for count in found], parts, style, label=kind)
        by_time.loglog([seconds[count] for count in found], parts, style, label=kind)
    by_size.set(xlabel="velocities", ylabel="error of the cube's place over the length")
    by_time.set(xlabel="run time (s)")
    figure.legend(*by_size.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.savefig(out / "errors.png", dpi=120)
say(f"in {out}: shapes.png, errors.png")
say("all checks passed")
