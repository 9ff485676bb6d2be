# # A cam that loses its follower
#
# A cam lifts a roller that a spring presses onto it. The faster it turns, the more of the spring's force the follower's
# own inertia takes at the cam's nose, until nothing is left and the roller lifts off. With the lift
# h (1 - cos beta) / 2, the spring's force F on the base circle, its stiffness k and the follower's mass m the contact
# bears
#
#     N_y(beta) = F + m g + k h (1 - cos beta) / 2 + m w^2 h cos(beta) / 2,
#
# which vanishes first at the nose, beta = pi, at w^2 = 2 (F + m g + k h) / (m h) (Norton 2009, chapter 15).
#
# `./run python demos/cam.py`; the picture goes to `out_cam`. `--film` makes a film, `--short` leaves the search for the
# speed out.

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import contact

BASE, LIFT, ROLLER = 0.04, 0.01, 0.008  # m; of the roller's centre from the cam's: the least, and how much it rises
MASS, STIFFNESS, PRESS, GRAVITY = 0.4, 4e3, 100.0, 9.81  # kg, N/m, N, m/s^2
POINTS = 180
FILM, SHORT = (f"--{choice}" in sys.argv for choice in ("film", "short"))

out = Path("out_cam")
out.mkdir(exist_ok=True)

# ## The cam
#
# The roller's centre is to go along a curve about the cam, and the cam is a roller's radius inside of it: points along
# the normal, and a spline through them, whose curvature is continuous.

angle = 2.0 * np.pi * np.arange(POINTS) / POINTS
across, upwards = np.cos(angle), np.sin(angle)
reach = BASE + 0.5 * LIFT * (1.0 - upwards)  # the base circle is at the top at the start
slope = -0.5 * LIFT * across
normal = np.stack([reach * across + slope * upwards, reach * upwards - slope * across], axis=1)
normal /= np.linalg.norm(normal, axis=1)[:, None]
outline = reach[:, None] * np.stack([across, upwards], axis=1) - ROLLER * normal


def plate(outline: np.ndarray, half: float) -> fm.Shape:
    """A plate that the picture shows."""
    n = len(outline)
    low, high = (np.column_stack([np.vstack([outline, [0.0, 0.0]]), np.full(n + 1, z)]) for z in (-half, half))
    here, after = np.arange(n), np.roll(np.arange(n), -1)
    faces = [(here, after, here + n + 1), (after, after + n + 1, here + n + 1)]
    faces += [(np.full(n, n), after, here), (np.full(n, 2 * n + 1), here + n + 1, after + n + 1)]
    rows = np.vstack([np.stack(part, axis=1) for part in faces])
    return fm.Shape.from_surface(np.vstack([low, high]), rows, colour="#c44e52")


# ## The machine
#
# The cam is driven, the follower slides along y. The contact is stiff, so it gives some micrometres.

onset = np.sqrt(2.0 * (PRESS + MASS * GRAVITY + STIFFNESS * LIFT) / (MASS * LIFT))
law = contact.PowerLaw.bearing(load=150.0, depth=3e-6, restitution=0.3, speed=0.01)


def run_at(speed: float, turns: float) -> tuple[fm.Trajectory, contact.ContactSeries, np.ndarray, np.ndarray]:
    """The machine at a speed (rad/s), and from the second turn on the contact, the cam's angle, and the lift."""
    scene = fm.System(gravity=(0.0, -GRAVITY, 0.0))
    cam = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3), shape=plate(outline, 0.005)), name="cam")
    roller = fm.Shape.cylinder(ROLLER, 0.012, colour="#4c72b0") + fm.Shape.box((0.006, 0.08, 0.006), at=(0, 0.045, 0))
    follower = scene.add(fm.RigidBody(MASS, (1e-4, 1e-4, 1e-4), shape=roller), name="follower")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), cam.frame())
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), follower.frame())
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    scene.add_force(fm.force.JointSpring(slide, STIFFNESS, rest=BASE - PRESS / STIFFNESS))
    curve = contact.Profile(cam.frame(), outline, spline=True)
    touching = scene.touch(curve, contact.Sphere(follower.frame(), ROLLER), law)
    first = PRESS + MASS * GRAVITY + 0.5 * MASS * speed**2 * LIFT
    slide.position = BASE - first / law.k  # pressed as it is going to be
    run = scene.simulate(2.0 * np.pi * turns / speed, rtol=1e-9)
    t = np.linspace(2.0 * np.pi / speed, run.t[-1], 2001)
    return run, run.contacts(touching, t=t)[0], speed * t, run.beta(slide, t=t) - BASE


def borne(speed: float, beta: np.ndarray) -> np.ndarray:
    """The closed form (N), while the roller does not lift off."""
    spring = PRESS + MASS * GRAVITY + 0.5 * STIFFNESS * LIFT * (1.0 - np.cos(beta))
    return spring + 0.5 * MASS * speed**2 * LIFT * np.cos(beta)


print(f"closed form: the roller lifts off above {onset:.3f} rad/s ({onset * 30.0 / np.pi:.0f} 1/min)")
shown = {}
for share in (0.9, 1.1):
    run, met, beta, _ = shown[share] = run_at(share * onset, 2.0)
    off = f"it lifts off, by {met.gap.max() * 1e6:.0f} um" if met.gap.max() > 0.0 else "it stays"
    steps = f"{len(run.t) - 1} steps by {run.stats.integrator}"
    print(f"{share:g} times that: {steps}; least force {met.force[:, 1].min():.2f} N; {off}")
_, met, beta, _ = shown[0.9]
error = np.abs(met.force[:, 1] - borne(0.9 * onset, beta)).max() / borne(0.9 * onset, beta).max()
print(f"force over the angle: off the closed form by {error:.1e} of its largest")
assert error < 3e-3
assert met.gap.max() < 0.0 < shown[1.1][1].gap.max()

# ## The speed at which it lifts off
#
# The least force falls in proportion to the square of the speed: two runs below tell where it vanishes. Then runs on
# both sides of it.

if not SHORT:
    squares = np.array([0.95, 0.99]) * onset**2
    least = [run_at(np.sqrt(square), 2.0)[1].force[:, 1].min() for square in squares]
    found = np.sqrt(squares[0] - least[0] * (squares[1] - squares[0]) / (least[1] - least[0]))
    print(f"by the machine: {found:.3f} rad/s, {found / onset - 1.0:+.1e} of the closed form")
    assert abs(found / onset - 1.0) < 2e-3
    assert run_at(0.997 * onset, 2.0)[1].gap.max() < 0.0 < run_at(1.003 * onset, 2.0)[1].gap.max()

# ## Picture

figure = Figure(figsize=(7.0, 4.6), layout="constrained")
above, below = figure.subplots(2, 1, sharex=True)
for (share, (_, met, beta, lift)), colour in zip(shown.items(), ("tab:blue", "tab:red"), strict=True):
    degrees = np.degrees(beta - beta[0])
    above.plot(degrees, lift * 1e3, color=colour, label=f"{share:g} of the closed form's speed")
    below.plot(degrees, met.force[:, 1], color=colour)
    below.plot(degrees, borne(share * onset, beta), "k:", lw=1)
above.set(ylabel="lift, mm")
above.legend(frameon=False)
blow = shown[1.1][1].force[:, 1].max()
below.set(xlabel="angle of the cam, degrees", ylabel="force, N", xlim=(0, 360), ylim=(-60, 400))
below.text(288, 370, f"back with {blow * 1e-3:.0f} kN", ha="right", va="top", color="tab:red")
below.axhline(0.0, color="0.7", lw=0.8)
figure.savefig(out / "cam.png", dpi=120)
print(f"in {out}: cam.png")

if FILM:
    shown[1.1][0].animate(out / "cam.gif", slow_motion=60.0, fps=15, size=(480, 360), view=(0.0, 0.0, 1.0))
    print(f"in {out}: cam.gif")
print("all checks passed")
