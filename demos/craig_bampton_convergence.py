# # How many modes does a connecting rod need?
#
# A Craig-Bampton reduction keeps the static shapes of a body's interfaces and some of its modes with the interfaces
# held. Too few modes and the body's own frequencies come out too high; too many and each step of the machine costs more
# than it must. Three ways to choose, for a steel connecting rod:
#
# - by a number, `modes=12`, and then see what became of the frequencies;
# - by a rule of thumb, `Truncation(below_hz=1.5 * f)`: all modes up to half as much again as the highest
#   frequency of interest;
# - by a tolerance, `Truncation(tol=1e-2)`: as few as it takes, by an estimate of the error that needs no
#   unreduced solution.
#
# `./run python demos/craig_bampton_convergence.py`; the picture goes to `out_craig_bampton_convergence`.

import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import Truncation, craig_bampton, truncation_errors

LENGTH = 0.3  # m, between the pins
WANTED = 6  # frequencies that shall be right
NUMBERS = (0, 1, 2, 4, 8, 16, 32, 64)  # of modes

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_craig_bampton_convergence")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


def row(title: object, values: np.ndarray, last: str = "") -> str:
    return (f"{title!s:<24}" + "".join(f"{value:>11.2e}" for value in values) + f"{last:>12}").rstrip()


# ## What is true
#
# The pins hold the rod in the mean of its bores (`Coupling.AVERAGED`), which adds no stiffness. So the free rod is the
# same body with interfaces and without, and without interfaces a reduction is nothing but the rod's own modes, six
# rigid motions apart: the frequencies of the unreduced rod, found another way.

steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def rod(h: float, interfaces: list[Interface]) -> ContinuumModel:
    mesh = meshes.connecting_rod(length=LENGTH, h=h, comm=comm)
    return ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=interfaces)


def own_frequencies(h: float) -> np.ndarray:
    """The lowest elastic frequencies, Hz, of the free unreduced rod."""
    body = craig_bampton(rod(h, []), modes=WANTED, frame=None, geometric_stiffness=False)
    return body.frequencies()


pins = [
    Interface("big_end", origin=(0.0, 0.0, 0.0), coupling=fm.Coupling.AVERAGED),
    Interface("small_end", origin=(LENGTH, 0.0, 0.0), coupling=fm.Coupling.AVERAGED),
]
H = 10e-3  # m, size of the cells
model = rod(H, pins)
exact = own_frequencies(H)
say(f"rod: {model.K.getSize()[0]} degrees of freedom")
say("its frequencies, free: " + ", ".join(f"{f:.1f}" for f in exact) + " Hz")

# The mesh is not the rod either. What a finer one changes says how far it is worth to go.

mesh_error = (exact / own_frequencies(0.8 * H)) ** 2 - 1.0
say()
say("relative errors of the eigenvalues (2 pi f)^2, twice those of the frequencies")
say(row("of the mesh, at least", mesh_error))

# ## By a number of modes
#
# Craig and Bampton's frequencies come from above, and fall as modes are added, but not evenly: each mode helps the
# frequencies whose shapes it resembles, and the error of one frequency may stay for a long while. Guyan's reduction, no
# modes at all, is off by a tenth in the first frequency and by nearly all of the sixth.
#
# The estimate is the ratio of two bounds. What the modes that are left out do to the interfaces in statics is known
# exactly, from one more solve; if all of that happened at the lowest frequency left out, the body would be softer than
# it is. So the true frequencies lie between those of the reduced body and those of that softer one.


def reduce(modes: int | Truncation) -> tuple[fm.ReducedBody, float]:
    """The reduced rod and how long it took, s."""
    comm.barrier()
    began = time.perf_counter()
    body = craig_bampton(model, modes=modes, frame="big_end", geometric_stiffness=False)
    return body, comm.bcast(time.perf_counter() - began)


def errors(body: fm.ReducedBody) -> np.ndarray:
    """True relative errors of the wanted eigenvalues."""
    return (body.frequencies()[:WANTED] / exact) ** 2 - 1.0


estimate = truncation_errors(model, NUMBERS, frame="big_end", count=WANTED)
reduced = {n: reduce(n) for n in NUMBERS}
true = np.array([errors(body) for body, _ in reduced.values()])
seconds = np.array([took for _, took in reduced.values()])
say()
for n, error, estimated, took in zip(NUMBERS, true, estimate.errors, seconds, strict=True):
    say(row(f"{n:>2} modes", error, f"{took:.2f} s"))
    say(row("    estimated", estimated))

# ## By the rule of thumb, and by a tolerance
#
# The rule of thumb says nothing of the error. Here, with a factor of 1.5, it leaves a few per cent in the sixth
# frequency. A tolerance says what it costs to do better. It holds for the free rod and for the rod whose body frame is
# held, and for all frequencies up to `below_hz` where that is given beside it, else for the lowest six.

rule, rule_took = reduce(Truncation(below_hz=1.5 * float(exact[-1])))
TOLERANCES = (1e-1, 1e-2, 1e-3)
chosen = {tol: reduce(Truncation(tol=tol)) for tol in TOLERANCES}


def count(body: fm.ReducedBody) -> int:
    """Number of fixed-interface modes."""
    return int(body.provenance["fixed-interface modes"])


say()
say(row(f"below 1.5 f: {count(rule)} modes", errors(rule), f"{rule_took:.2f} s"))
for tol, (body, took) in chosen.items():
    say(row(f"tol {tol:g}: {count(body)} modes", errors(body), f"{took:.2f} s"))

# ## The picture
#
# Left, how the errors fall with the number of modes: lines are true, crosses estimated. Right, what that costs.

if root:
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for i in range(WANTED):
        (line,) = left.plot(NUMBERS, true[:, i], label=f"{exact[i]:.0f} Hz")
        left.plot(NUMBERS, estimate.errors[:, i], "x", color=line.get_color())
    left.axhspan(1e-6, float(mesh_error.max()), color="0.93", zorder=0)
    left.text(0.15, 0.6 * float(mesh_error.max()), "below the mesh's error", fontsize="small", color="0.4", va="top")
    left.set_xscale("symlog", linthresh=1.0)
    left.set_xticks(NUMBERS, [str(n) for n in NUMBERS])
    left.set_xlabel("fixed-interface modes")
    left.set_ylabel("relative error of the eigenvalue")
    left.set_yscale("log")
    left.set_ylim(1e-5, 2.0)
    left.legend(frameon=False, ncols=2)
    right.plot(seconds, true.max(axis=1), "o-", label="by number")
    for n, x, y in zip(NUMBERS, seconds, true.max(axis=1), strict=True):
        right.annotate(f" {n}", (x, y), va="bottom")
    right.plot(rule_took, errors(rule).max(), "s", label="below 1.5 f")
    times = [took for _, took in chosen.values()]
    right.plot(times, [errors(body).max() for body, _ in chosen.values()], "^", label="by tolerance")
    right.set_xlabel("time of the reduction, s")
    right.set_ylabel(f"largest of {WANTED} errors")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.grid(color="0.9")
    figure.savefig(out / "craig_bampton_convergence.png", dpi=130)
say(f"\nin {out}: craig_bampton_convergence.png")

# ## Checks
#
# From above, and no error rises when modes are added.

assert true.min() > 0.0
assert np.diff(true, axis=0).max() < 1e-9

# The estimate is not below the true error, and not far above it either.

assert (estimate.errors > true).all()
assert (estimate.errors < 1.1 * true).all()

# A tolerance is kept. It takes more modes the smaller it is, and not one too many: with one mode fewer the estimate,
# of the free rod or of the held one, is above it.

for tol, (body, _) in chosen.items():
    fewer = [truncation_errors(model, [count(body) - 1], frame="big_end", held=held) for held in (False, True)]
    assert errors(body).max() <= tol < max(one.errors.max() for one in fewer)
assert list(map(count, (body for body, _ in chosen.values()))) == sorted(count(body) for body, _ in chosen.values())

# `below_hz` leaves no mode out: with one more, the record has the same modes and one above the frequency. Held at all
# pins the body has nothing but its fixed-interface modes.

held = craig_bampton(model, modes=count(rule) + 1, frame="big_end", geometric_stiffness=False)
held_frequencies = held.frequencies(["big_end", "small_end"])
assert np.sum(held_frequencies < 1.5 * exact[-1]) == count(rule) == len(held_frequencies) - 1

# As far as the mesh is right, one per cent is enough, and that takes no more than a handful of modes.

assert mesh_error.max() < 1e-2
assert count(chosen[1e-2][0]) < 20
say("all checks passed")
