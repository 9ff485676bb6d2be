# # A flexible pole on a cart, as a Gymnasium environment
#
# Learning agents step a machine from outside: an observation, an action, the next observation, ten thousand times. Here
# the machine is a cart with a slender pole of aluminium that bends, the action is the force on the cart, held for a
# fiftieth of a second, and an episode ends where the pole falls.
#
# `pip install gymnasium`, then `./run python demos/gymnasium_environment.py`; the picture goes to
# `out_gymnasium_environment`. Agents of any library take the environment as it is; the search below needs none.

import time
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import Keep, ModalDamping, craig_bampton

PERIOD = 0.02  # s between two actions
PUSH = 20.0  # N, the largest action
END = 250  # actions of an episode, 5 s

out = Path("out_gymnasium_environment")
out.mkdir(exist_ok=True)

# ## The machine
#
# What pushes the cart is a `Signal`: a value that is set while the machine runs.

aluminium = forms.solid_linear.Parameters(E=7.0e10, nu=0.33, rho=2700.0)
mesh = meshes.block(1.2, 0.005, 0.03, divisions=(24, 1, 1), cell="hexahedron", degree=1)
ends = [Interface("x_min"), Interface("x_max")]
model = ContinuumModel(mesh, forms.solid_linear, aluminium, degree=2, interfaces=ends)
damping = ModalDamping(0.01, held=["x_min"])
record = craig_bampton(model, modes=2, frame="x_min", damping=damping, keep=Keep(surface=True))

scene = fm.System(gravity=(0.0, -9.81, 0.0))
cart = scene.add(fm.RigidBody(mass=1.0, inertia=(1e-2, 1e-2, 1e-2)), name="cart")
pole = scene.add(fm.FlexibleBody(record), name="pole")
weight = scene.add(fm.RigidBody(mass=0.3, inertia=(1e-4, 1e-4, 1e-4)), name="weight")
slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
hinge = scene.connect(fm.joint.Revolute("z"), cart.frame(), pole.frame("x_min"), name="hinge")
scene.connect(fm.joint.Fixed(), pole.frame("x_max"), weight.frame())
hinge.position, slide.position = 0.5 * np.pi, 0.0
push = fm.Signal("push")
scene.add_force(fm.force.JointForce(slide, push))

# ## The environment
#
# A stepper does it all: `step` goes on by a period and tells what is measured, `restore` begins an episode anew in some
# hundredths of a millisecond. Generalized-alpha with steps of 2 ms follows the swing and the first bending, and damps
# what is faster. Each episode begins with a push at random.


class FlexibleCartPole(gym.Env[np.ndarray, np.ndarray]):
    """Keep the pole upright; seen are the cart's place and speed, the pole's angle and rate (m, m/s, rad, rad/s)."""

    def __init__(self) -> None:
        most = np.array([2.4, 20.0, 0.5, 20.0])  # beyond which the pole has fallen, or the cart has left
        self.observation_space = gym.spaces.Box(-2.0 * most, 2.0 * most, dtype=np.float64)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float64)
        self.stepper = scene.stepper(
            h=2e-3, integrator=fm.GeneralizedAlpha(), inputs=[push],
            outputs=[ask(joint) for joint in (slide, hinge) for ask in (fm.output.Position, fm.output.Velocity)],
        )  # fmt: skip
        self.upright, self.most = np.array([0.0, 0.0, 0.5 * np.pi, 0.0]), most

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin at rest, and push at random."""
        super().reset(seed=seed)
        self.stepper.restore()
        return self.stepper.step(PERIOD, self.np_random.uniform(-0.5, 0.5) * PUSH) - self.upright, {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Push for a period."""
        observed = self.stepper.step(PERIOD, PUSH * float(np.clip(action[0], -1.0, 1.0))) - self.upright
        fallen = bool((np.abs(observed) > self.most).any())
        reward = 1.0 - (observed[0] / 2.4) ** 2 - 1e-2 * float(action[0]) ** 2
        return observed, 0.0 if fallen else reward, fallen, False, {}


with warnings.catch_warnings():
    warnings.simplefilter("error")
    check_env(FlexibleCartPole(), skip_render_check=True)
print("Gymnasium's checker has nothing to say")

# ## Searching for a law
#
# A law u = K y of four numbers, by the cross-entropy method: try some, keep the best quarter, try around these. It
# knows nothing of the machine but the rewards.


env = gym.wrappers.TimeLimit(FlexibleCartPole(), END)


def episode(gains: np.ndarray, seed: int) -> tuple[float, list[np.ndarray]]:
    """The rewards of an episode, and what was observed."""
    observed, _ = env.reset(seed=seed)
    total, seen, ended = 0.0, [observed], False
    while not ended:
        observed, reward, fallen, late, _ = env.step(np.clip([gains @ observed], -1.0, 1.0))
        total, ended = total + float(reward), fallen or late
        seen.append(observed)
    return total, seen


random = np.random.default_rng(7)
mean, spread = np.zeros(4), np.array([1.0, 1.0, 10.0, 2.0])
steps, began = 0, time.process_time()
for generation in range(8):
    tried = mean + spread * random.standard_normal((24, 4))
    found = [episode(gains, seed) for seed, gains in enumerate(tried)]
    steps += sum(len(seen) for _, seen in found)
    best = tried[np.argsort([total for total, _ in found])[-6:]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
    print(f"generation {generation:2d}: best {max(total for total, _ in found):6.1f}, law {np.round(mean, 2)}")
spent = time.process_time() - began
print(f"{steps} actions of {PERIOD / 2e-3:.0f} steps, {1e6 * spent / steps:.0f} us of processor time each")

total, seen = episode(mean, seed=1000)
figure = Figure(figsize=(7.0, 3.2), layout="constrained")
axes = figure.subplots()
t = PERIOD * (1 + np.arange(len(seen)))
axes.plot(t, np.degrees([y[2] for y in seen]), label="angle, deg")
axes.plot(t, 10.0 * np.array([y[0] for y in seen]), label="cart, dm")
axes.set(xlabel="time, s", title="an episode that was not searched on")
axes.legend(frameon=False)
figure.savefig(out / "gymnasium_environment.png", dpi=120)
print(f"in {out}: gymnasium_environment.png")

assert len(seen) == END + 1
assert total > 0.9 * END
print("all checks passed")
