# # How unevenly two gears turn
#
# Involute teeth hand over evenly while they are rigid. Under load they bend and dent, now one pair of teeth bears the
# load and now two, and the driven gear lags by an angle that changes with every tooth: the static transmission error,
# from which gears whine. As a way along the line of action it is r_b (beta_1 - beta_2) for a given torque, r_b the
# radius of the base circle.
#
# A spur gear is meshed and reduced; two of the record make a pair. Its modes know how teeth bend and how the rim turns
# on its hub; its contact patches, sixty-four along each flank that bears, know the dents (`record.contact`). So the
# pair's equilibrium is one of a few dozen forces: for the gaps g between the flanks, which are known in closed form,
# and the flexibility C of the patches of both gears,
#
#     g - x + C N >= 0,   N >= 0,   one of both is zero,   sum N = T / r_b,
#
# since all forces of involutes act along tangents to the base circle; x is the transmission error. The same is solved
# on the unreduced mesh, node by node, at some angles. Then the pair turns in a machine, where its flanks touch each
# other as elastic surfaces.
#
# `./run python demos/gear_pair.py`; the pictures, one of the pressure on the flanks, go to `out_gear_pair`. `--short`
# takes fewer angles, `--film` makes films, of both gears and of the pressure.

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls

import flexmbd as fm
from flexmbd import contact, forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import Keep, Patch, craig_bampton

FloatArray = NDArray[np.float64]

TEETH, MODULE, WIDTH, BORE = 20, 3e-3, 10e-3, 12e-3  # m, the bore's radius
ALPHA = np.deg2rad(20.0)
TORQUES = 30.0, 60.0, 120.0  # N m
SHORT, FILM = "--short" in sys.argv, "--film" in sys.argv
ALONG = 64  # cells and patches along a flank
PITCH = 0.5 * TEETH * MODULE
BASE, TIP, FOOT = PITCH * np.cos(ALPHA), PITCH + MODULE, PITCH - 0.85 * MODULE  # where flanks begin and end
STEP = 2.0 * np.pi / TEETH

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_gear_pair")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## Involutes
#
# A point of a flank is the end of a taut string that is unwound from the base circle. Its free length s tells the
# point; the flank that turns ahead begins on the base circle HALF ahead of the tooth's middle. The string is the
# flank's normal.

HALF = 0.25 * STEP + np.tan(ALPHA) - ALPHA


def string(radius: FloatArray) -> FloatArray:
    """m; zero below the base circle."""
    free: FloatArray = np.sqrt(np.maximum(radius**2 - BASE**2, 0.0))
    return free


def flank_point(s: FloatArray, tooth: int) -> FloatArray:
    """(n, 2) m."""
    tangent = HALF + tooth * STEP - s / BASE
    return BASE * unit(tangent) + s[:, None] * unit(tangent + 0.5 * np.pi)


def unit(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def turned(x: FloatArray, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    back: FloatArray = x @ np.array([[c, s], [-s, c]])
    return back


def half_angle(radius: FloatArray) -> FloatArray:
    """rad, between a tooth's middle and its flank."""
    roll = string(radius) / BASE
    return HALF - roll + np.arctan(roll)


def is_on_flank(x: FloatArray, tooth: int) -> NDArray[np.bool_]:
    """Of points (3, n)."""
    radius = np.hypot(x[0], x[1])
    angle = np.angle(np.exp(1j * (np.arctan2(x[1], x[0]) - tooth * STEP)))
    on: NDArray[np.bool_] = (abs(angle - half_angle(radius)) < 1e-7) & (radius > FOOT - 1e-7 * PITCH)
    return on


contact_ratio = (2.0 * string(np.array(TIP)) - 2.0 * PITCH * np.sin(ALPHA)) / (BASE * STEP)
say(f"contact ratio, closed form: {contact_ratio:.4f}")

# ## The gear
#
# In a mesh cycle from one tooth at the pitch point to the next one there two teeth touch, so two are fine and have
# patches on the flank that turns ahead. A patch is one row of cells across the width.

BEARING = (-1, 0)
steel = forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
fine = [tooth % TEETH for tooth in BEARING]
length = (TIP**2 - BASE**2) / (2.0 * BASE) + BASE - FOOT


def gear_model(on: MPI.Comm, along: int) -> ContinuumModel:
    mesh = meshes.spur_gear(TEETH, MODULE, WIDTH, bore=BORE, divisions=(4, along, 3, 1), fine=fine, comm=on)
    return ContinuumModel(mesh, forms.solid_linear, steel, degree=2, interfaces=[Interface("hub")])


began = time.process_time()
model = gear_model(comm, ALONG)
size = 1.001 * np.sqrt(WIDTH * length / ALONG)
flanks = [Patch(f"flank_{k % TEETH}", size=size, facets=lambda x, k=k: is_on_flank(x, k)) for k in BEARING]
kept = Keep(surface=True, modes=True)  # for pictures, and where the patches are on the surface
gear = craig_bampton(model, modes=10, frame="hub", contact=flanks, geometric_stiffness=False, keep=kept)
assert gear.contact is not None
seconds = time.process_time() - began
say(f"gear: {model.K.getSize()[0]} degrees of freedom, reduced to {gear.n_modes} modes and")
say(f"{len(gear.contact.area)} patches in {seconds:.1f} s; of a patch's deflection the modes leave out")
say(f"{gear.provenance['contact flank_0'].splitlines()[-1]}")
say()

# ## A pair of them
#
# The second gear is the first one turned by half a turn about the pitch point. Forces that act where the first gear has
# a patch act between two of the second's, and are shared by these.


@dataclass(frozen=True)
class Flanks:
    """Points where a gear may be touched, and how much they give.

    Attributes:
        s: (teeth, m) m, free length of the string, ascending.
        A: (2 teeth m, 2 teeth m) m/N, of forces in the gear's plane, x and y of each point.
    """

    s: FloatArray
    A: FloatArray


def mate(flanks: Flanks, turn: float) -> tuple[FloatArray, FloatArray]:
    """Gaps (k,) m and flexibility (k, k) m/N of the pair, the first gear turned by so much from its middle."""
    count, each = len(flanks.A), flanks.s.shape[1]
    other = np.pi + 0.5 * STEP - turn  # conjugate to it
    gaps, one, two = [], [], []
    for i, tooth in enumerate(BEARING):
        k = len(BEARING) - 1 - i  # whom it meets
        points = turned(flank_point(flanks.s[i], tooth), turn)
        seen = turned(points - [2.0 * PITCH, 0.0], -other)
        s, angle = string(np.linalg.norm(seen, axis=1)), np.arctan2(seen[:, 1], seen[:, 0])
        tangent = angle - np.arctan2(s, BASE)
        gap = BASE * (np.angle(np.exp(1j * (tangent + s / BASE - BEARING[k] * STEP))) - HALF)
        normal = unit(tangent + 0.5 * np.pi)
        mine, theirs = flanks.s[i], flanks.s[k]
        for p in np.flatnonzero((mine > 0.0) & (s > theirs[0]) & (s < theirs[-1]) & (gap < 0.2 * MODULE)):
            q = int(np.searchsorted(theirs, s[p]))
            share = (s[p] - theirs[q - 1]) / (theirs[q] - theirs[q - 1])
            rows = np.zeros((2, count // 2, 2))
            rows[0, i * each + p] = turned(normal[p], other - turn)
            rows[1, k * each + q - 1], rows[1, k * each + q] = (1.0 - share) * normal[p], share * normal[p]
            one.append(rows[0].ravel())
            two.append(rows[1].ravel())
            gaps.append(gap[p])
    E, F = np.array(one), np.array(two)
    return np.array(gaps), E @ flanks.A @ E.T + F @ flanks.A @ F.T


def transmission_error(flanks: Flanks, turn: float, torque: float) -> float:
    """m, by least squares without negative ones: a way of its own to the forces of a given approach."""
    gap, C = mate(flanks, turn)
    L = np.linalg.cholesky(C)

    def lacking(x: float) -> float:
        return float(nnls(L.T, np.linalg.solve(L, x - gap))[0].sum() - torque / BASE)

    return float(brentq(lacking, gap.min(), gap.min() + 2.0 * torque / BASE * np.diag(C).max(), xtol=1e-12))


def by_record(body: fm.ReducedBody) -> Flanks:
    """Of modes and patches."""
    patches = body.contact
    assert patches is not None
    count = len(patches.area)
    moves = np.einsum("pba,pan->pbn", patches.axes, patches.phi)
    dents = np.einsum("pia,paqb,qjb->piqj", patches.axes, patches.G.reshape(count, 3, count, 3), patches.axes)
    A = np.einsum("pin,qjn->piqj", moves / body.stiffness, moves) + dents
    radius = np.hypot(*patches.x[:, :2].T)
    order = np.lexsort([radius, patches.surface])
    A = A[order][:, :2, order, :2].reshape(2 * count, 2 * count)
    return Flanks(string(radius[order]).reshape(len(BEARING), -1), A)


def by_full_mesh(along: int) -> tuple[Flanks, int]:
    """Of lines of nodes along the width, on a mesh of its own; and its size."""
    whole = gear_model(MPI.COMM_SELF, along)
    pointers, columns, values = whole.K.getValuesCSR()
    size, x = whole.K.getSize()[0], whole.node_x
    radius = np.hypot(x[:, 0], x[:, 1])
    free = np.flatnonzero(np.repeat(radius > 1.0001 * BORE, 3))
    place = np.full(size, -1)
    place[free] = np.arange(len(free))
    K = scipy.sparse.csr_array((values, columns, pointers), (size, size))[free][:, free].tocsc()
    factor = scipy.sparse.linalg.splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    strings, loads = [], []
    for tooth in BEARING:
        on = np.flatnonzero(is_on_flank(x.T, tooth))
        for line in on[np.lexsort([x[on, 2], np.round(radius[on] / MODULE, 9)])].reshape(-1, 3):
            strings.append(string(radius[line[0]]))
            for axis in range(2):
                load = np.zeros(len(free))
                load[place[3 * line + axis]] = np.array([1.0, 4.0, 1.0]) / 6.0  # even along the width
                loads.append(load)
    S = np.array(loads).T
    A = S.T @ np.column_stack([factor.solve(load) for load in S.T])
    return Flanks(np.array(strings).reshape(len(BEARING), -1), A), size


# ## Transmission error over a mesh cycle

count = 30 if SHORT else 90
cycle = -0.25 * STEP + STEP * np.arange(count) / count  # at first tooth 0 is at the pitch point
if root:
    reduced = by_record(gear)
    errors = {torque: np.array([transmission_error(reduced, turn, torque) for turn in cycle]) for torque in TORQUES}
    once_more = transmission_error(reduced, cycle[0] + STEP, TORQUES[0])
    full, dofs = by_full_mesh(32 if SHORT else 64)
    chosen = np.arange(1, count, count // 10)
    say(f"unreduced: {dofs} degrees of freedom")
    say("transmission error, um, off the unreduced in per cent of the mean, and its first three harmonics, um:")
    say("torque, N m     least   largest   peak to peak   off: median, largest            harmonics")
    others, apart = {}, {}
    for torque, found in errors.items():
        others[torque] = np.array([transmission_error(full, turn, torque) for turn in cycle[chosen]])
        apart[torque] = 100.0 * np.abs(found[chosen] - others[torque]) / found.mean()
        harmonics = 2.0 * np.abs(np.fft.rfft(found))[1:4] / len(found)
        listed = " ".join(f"{1e6 * one:.2f}" for one in harmonics)
        told = f"{np.median(apart[torque]):.2f}, {apart[torque].max():.2f}"
        low, high = 1e6 * found.min(), 1e6 * found.max()
        say(f"{torque:11g} {low:9.2f} {high:9.2f} {high - low:14.2f} {told:>22} {listed:>20}")
    say()

# ## In a machine
#
# Both gears are on the ground by their hubs. The first one is turned through a mesh cycle, slowly beside the pair's own
# vibration of some 5 kHz; a torque holds the second one back, and a damper its vibration. The outline, as a `Profile`,
# says what a flank is undeformed.

TORQUE, TIME, DAMPING = 60.0, 0.02, 0.3  # N m, s, N m s
RATE = STEP / TIME


def outline() -> FloatArray:
    """(n, 2) m, once around the gear: each tooth from its root along one flank to the tip, and back."""
    radius = np.concatenate([[PITCH - 1.25 * MODULE], np.linspace(FOOT, TIP, 200)])
    angle = np.concatenate([-half_angle(radius), half_angle(radius)[::-1]])
    tooth = np.concatenate([radius, radius[::-1]])[:, None] * unit(angle)
    return np.vstack([turned(tooth, k * STEP) for k in range(TEETH)])


scene = fm.System(team=MpiTeam(comm))
driver, driven = (scene.add(fm.FlexibleBody(gear), name=name) for name in ("driver", "driven"))
ground = scene.ground
turn = scene.connect(fm.joint.Revolute("z"), ground.frame(), driver.frame("hub"))
other = ground.frame((2.0 * PITCH, 0.0, 0.0), R=np.diag([-1.0, -1.0, 1.0]))
lag = scene.connect(fm.joint.Revolute("z"), other, driven.frame("hub"))
turn.prescribe(lambda t: (cycle[0] + RATE * t, RATE, 0.0))
lag.position, lag.velocity = 0.5 * STEP - cycle[0], -RATE
shape = contact.Profile(driven.frame(), outline())
# one surface of all patches of a gear, so that teeth that bear together feel each other's dents
pairs = scene.touch(contact.ElasticSurface(driver), contact.ElasticSurface(driven, shape=shape), contact.Hard())
scene.add_force(fm.force.JointTorque(lag, TORQUE - DAMPING * RATE))
scene.add_force(fm.force.JointDamper(lag, DAMPING))
began = time.process_time()
run = scene.simulate(TIME, rtol=1e-3)
seconds = time.process_time() - began
moved = np.linspace(0.2 * TIME, TIME, 81)  # it starts unloaded, and swings at first
way = BASE * (run.beta(lag, t=moved) - (0.5 * STEP - cycle[0] - RATE * moved))
say(f"machine: {len(run.t) - 1} steps by {run.stats.integrator}, {seconds:.1f} s")
if root:
    slow = np.interp(moved / TIME, np.arange(count + 1) / count, np.append(errors[TORQUE], errors[TORQUE][0]))
    off = 100.0 * abs(way - slow) / slow.mean()
    say(f"its transmission error is off the static one by {np.median(off):.2f} per cent in the median")
    say()

# ## Pictures
#
# One is of the pressure on the driver's flanks, the driven gear left out; dents and bends are enlarged.

if root:
    seen: dict[str, Any] = {"pressures": pairs, "hide": [driven], "view": (1.0, 0.6, 0.5), "amplification": 200.0}
    seen["zoom"] = (PITCH, 0.0, 0.5 * WIDTH), 3.0 * MODULE
    run.show(path=out / "pressure.png", t=0.5 * TIME, size=(960, 720), **seen)
    figure = Figure(figsize=(7.0, 5.6), layout="constrained")
    above, below = figure.subplots(2, 1)
    for (torque, found), colour in zip(errors.items(), ("tab:blue", "tab:green", "tab:red"), strict=True):
        degrees = np.degrees(np.concatenate([cycle, cycle + STEP]))
        above.plot(degrees, 1e6 * np.tile(found, 2), color=colour, label=f"{torque:g} N m")
        above.plot(np.degrees(cycle[chosen]), 1e6 * others[torque], "o", mfc="none", color=colour, ms=5)
        harmonics = 2.0 * np.abs(np.fft.rfft(found)) / len(found)
        orders = np.arange(1, 11)
        below.bar(orders + 0.25 * (TORQUES.index(torque) - 1), 1e6 * harmonics[1:11], width=0.22, color=colour)
    above.plot(np.degrees(cycle[0] + RATE * moved), 1e6 * way, "k", lw=1, label="in the machine")
    above.set(xlabel="angle of the driving gear, degrees", ylabel="transmission error, um", ylim=(0, 48))
    above.legend(frameon=False, ncols=4, loc="upper right", title="circles: on the unreduced mesh")
    below.set(xlabel="harmonic of the mesh frequency", ylabel="amplitude, um", xticks=np.arange(1, 11))
    figure.savefig(out / "gear_pair.png", dpi=120)
    say(f"in {out}: gear_pair.png, pressure.png")
    if FILM:
        run.animate(out / "gear_pair.gif", fps=15, size=(480, 360), view=(0.0, 0.0, 1.0), amplification=200.0)
        run.animate(out / "pressure.gif", fps=15, size=(480, 360), **seen)
        say(f"in {out}: gear_pair.gif, pressure.gif")

    assert abs(once_more / errors[TORQUES[0]][0] - 1.0) < 0.02
    # where teeth come in and go off a line of nodes more or less counts
    assert max(np.median(one) for one in apart.values()) < 2.0
    assert max(one.max() for one in apart.values()) < 10.0
    # one pair of teeth bears for the rest of a cycle that two bear for contact_ratio - 1, and gives more
    single = np.mean(errors[TORQUES[1]] > 0.5 * (errors[TORQUES[1]].min() + errors[TORQUES[1]].max()))
    say(f"one pair bears for {single:.2f} of the cycle; rigid teeth: {2.0 - contact_ratio:.2f}")
    assert np.median(off) < 2.0
    assert abs(single - 2.0 + contact_ratio) < 0.08
say("all checks passed")
