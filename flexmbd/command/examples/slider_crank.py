"""A slider-crank: a loop of rigid bodies, a torque and friction."""

from flexmbd.command.examples.scene_folder import SceneFolder

_SCENE = """\
# A crank turns, a rod pushes a piston to and fro: a closed loop.   Units are SI.
#
#     flexmbd simulate scene.toml
#     flexmbd plot scene_results/results.csv --column 'crank_pin.*' --column 'piston.*'

gravity = [0.0, -9.81, 0.0]

[[body]]
name = "crank"
mass = 0.4
inertia = [1e-4, 4e-4, 4e-4]               # about the centre of mass, body axes
com = [0.04, 0.0, 0.0]

[[body]]
name = "rod"
mass = 0.5
inertia = [1e-4, 4e-3, 4e-3]
com = [0.15, 0.0, 0.0]

[[body]]
name = "piston"
mass = 0.3
inertia = [1e-4, 1e-4, 1e-4]

[[joint]]
name = "main_bearing"
kind = "revolute"
axis = "z"
child = "crank"                            # the parent is the ground
velocity = 20.0                            # rad/s, at the start

[[joint]]
name = "crank_pin"
kind = "revolute"
axis = "z"
parent = { body = "crank", p = [0.08, 0.0, 0.0] }
child = "rod"

[[joint]]
name = "piston_pin"
kind = "revolute"
axis = "z"
parent = { body = "rod", p = [0.3, 0.0, 0.0] }
child = "piston"

[[joint]]                                  # closes the loop
name = "cylinder"
kind = "prismatic"
axis = "x"
child = "piston"

[[force]]
kind = "joint_torque"
joint = "main_bearing"
value = 0.5                                # N m

[[event]]
name = "fast"
joint = "main_bearing"
velocity = 40.0
direction = "rising"

[simulate]
t_end = 1.0
rtol = 1e-6

[output]
every = 0.002
positions = ["piston"]
velocities = ["piston"]
formats = ["csv"]
"""

SLIDER_CRANK = SceneFolder(
    "slider_crank",
    "crank, rod and piston: a loop, a torque, an event",
    {"scene.toml": _SCENE},
    (
        "flexmbd plot scene_results/results.csv --column 'piston.*'",
        "flexmbd simulate scene.toml --set bodies.rod.mass=0.8 -o heavier",
        "flexmbd sweep scene.toml --vary bodies.rod.mass=0.2:1.0:9",
    ),
)
