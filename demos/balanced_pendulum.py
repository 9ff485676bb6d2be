# # A flexible pendulum, balanced on a cart by a sampled controller
#
# A slender pole of aluminium with a weight on its tip stands on a cart. A computer reads the cart's place and the
# hinge's angle fifty times a second, and pushes the cart; between two samples the force is held. It knows the machine
# from `linearize`, the pole's bending included, and estimates what it does not measure.
#
# `./run python demos/balanced_pendulum.py`; picture and film go to `out_balanced_pendulum`.

from pathlib import Path

from mpi4py import MPI

import numpy as np
import scipy.linalg
import scipy.signal
from matplotlib.figure import Figure

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import Keep, ModalDamping, craig_bampton

LENGTH, WIDTH, THICKNESS = 1.2, 0.03, 0.005  # m; the pole bends in the plane in which it falls
PERIOD = 0.02  # s between two samples
TILT = np.radians(6.0)  # at which the pole is let go
END = 6.0  # s

comm = MPI.COMM_WORLD
root = comm.rank == 0
out = Path("out_balanced_pendulum")
if root:
    out.mkdir(exist_ok=True)


def say(text: str = "") -> None:
    if root:
        print(text, flush=True)


# ## The machine
#
# Cart, hinge and pole are a tree, and the weight is carried by the pole's tip. What pushes the cart is a `Signal`: a
# value that a controller is going to set.

aluminium = forms.solid_linear.Parameters(E=7.0e10, nu=0.33, rho=2700.0)
mesh = meshes.block(LENGTH, THICKNESS, WIDTH, divisions=(24, 1, 1), cell="hexahedron", degree=1, comm=comm)
ends = [Interface("x_min"), Interface("x_max")]
model = ContinuumModel(mesh, forms.solid_linear, aluminium, degree=2, interfaces=ends)
damping = ModalDamping(0.01, held=["x_min"])
record = craig_bampton(model, modes=2, frame="x_min", damping=damping, keep=Keep(surface=True))


def machine() -> tuple[fm.System, fm.Signal, dict[str, fm.joint.Connection]]:
    """The cart and the upright pole."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0), team=MpiTeam(comm))
    cart = scene.add(fm.RigidBody(mass=1.0, inertia=(1e-2, 1e-2, 1e-2)), name="cart")
    pole = scene.add(fm.FlexibleBody(record), name="pole")
    weight = scene.add(fm.RigidBody(mass=0.3, inertia=(1e-4, 1e-4, 1e-4)), name="weight")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    hinge = scene.connect(fm.joint.Revolute("z"), cart.frame(), pole.frame("x_min"), name="hinge")
    scene.connect(fm.joint.Fixed(), pole.frame("x_max"), weight.frame())
    hinge.position, slide.position = 0.5 * np.pi, 0.0
    push = fm.Signal("push")
    scene.add_force(fm.force.JointForce(slide, push))
    return scene, push, {"slide": slide, "hinge": hinge}


# ## The model
#
# The machine about the upright pole, which its weight shortens a little: found with the hinge held. Of its motions the
# computer knows the slow ones: an ordered Schur form splits them off exactly. Sampled, with its input held, that is
# what the computer sees (Franklin, Powell & Workman 1998, section 4.3).

held, _, joints = machine()
for joint, place in (("hinge", 0.5 * np.pi), ("slide", 0.0)):
    joints[joint].prescribe(place)
upright = held.equilibrium()

scene, push, joints = machine()
slide, hinge = joints["slide"], joints["hinge"]
sensors = [fm.output.Position(slide), fm.output.Position(hinge)]
linear = scene.linearize(inputs=[fm.force.JointForce(slide, 0.0)], outputs=sensors, about=upright)
values = linear.eigenvalues()
falls, bends = values.real.max(), linear.frequencies()[0]
say(f"{len(values)} states; the pole falls with {falls:.3f} 1/s, and bends with {bends:.2f} Hz")


def slow_part(space: fm.StateSpace, fastest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and C of the motions whose eigenvalues are below ``fastest`` (1/s)."""
    T, Z, n = scipy.linalg.schur(space.A, sort=lambda re, im: np.hypot(re, im) < fastest)
    beside = scipy.linalg.solve_sylvester(T[:n, :n], -T[n:, n:], -T[:n, n:])
    return T[:n, :n], (Z[:, :n].T - beside @ Z[:, n:].T) @ space.B, space.C @ Z[:, :n]


continuous = slow_part(linear.state_space(), fastest=2.0 * np.pi * 15.0)
A, B, C, _, _ = scipy.signal.cont2discrete((*continuous, np.zeros((2, 1))), PERIOD)
say(f"the computer's model has {len(A)} states")

# ## The controller
#
# Gains and estimator are those of least squares, both from a Riccati equation (section 9.4): the weights say how far
# cart and angle may go for which push, the noises how far the model and the sensors are believed.


def least_squares(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The gain K of u = -K x for which the sum of x Q x + u R u is least."""
    P = scipy.linalg.solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)


gain = least_squares(A, B, C.T @ np.diag([4.0, 40.0]) @ C, np.array([[1e-2]]))
doubt = B @ B.T + 1e-9 * np.eye(len(A))
blend = least_squares(A.T, C.T, doubt, np.diag([1e-6, 1e-6])).T
rest = np.array([0.0, 0.5 * np.pi])


def law(t: float, y: np.ndarray, estimate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The push, and what the state is going to be at the next sample."""
    u = -gain @ estimate
    return u, A @ estimate + B @ u + blend @ (y - rest - C @ estimate)


loop = np.block([[A, -B @ gain], [blend @ C, A - B @ gain - blend @ C]])
say(f"with the controller: largest eigenvalue from sample to sample {np.abs(np.linalg.eigvals(loop)).max():.4f}")

# ## Letting go
#
# The state of the law is the estimate. It begins with nothing known: the first samples are to find the tilt.

brain = scene.add_controller(
    law, period=PERIOD, measurements=sensors, inputs=[push], state=np.zeros(len(A)), name="brain"
)
hinge.position = 0.5 * np.pi + TILT
run = scene.simulate(END, rtol=1e-6)
samples = run.sampled(brain)
angle = np.degrees(run.beta(hinge) - 0.5 * np.pi)
say(f"{len(run.t) - 1} steps by {run.stats.integrator}; {len(samples.t)} samples")
far, most = np.abs(run.beta(slide)).max(), np.abs(samples.inputs).max()
say(f"the cart goes {far:.3f} m far, the push is {most:.1f} N at most")
say(f"after {END:g} s: angle {angle[-1]:.4f} deg, cart at {run.beta(slide)[-1] * 1e3:.2f} mm")

# ## Picture and film

if root:
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(run.t, angle, label="angle, deg")
    above.plot(run.t, 10.0 * run.beta(slide), label="cart, dm")
    above.legend(frameon=False)
    below.step(samples.t, samples.inputs[:, 0], where="post", color="tab:red", lw=1)
    below.set(xlabel="time, s", ylabel="push, N", xlim=(0, END))
    figure.savefig(out / "balanced_pendulum.png", dpi=120)
run.animate(out / "balanced_pendulum.gif", between=(0.0, 2.5), fps=15, size=(480, 360))
say(f"in {out}: balanced_pendulum.png, balanced_pendulum.gif")

assert abs(angle[-1]) < 0.1
assert abs(run.beta(slide)[-1]) < 0.02
say("all checks passed")
