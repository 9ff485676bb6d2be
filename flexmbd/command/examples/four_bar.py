"""A four-bar linkage that a prescribed motion drives."""

from flexmbd.command.examples.scene_folder import SceneFolder

_SCENE = """\
# A four-bar linkage, driven: its crank turns as prescribed.   Units are SI.
#
#     flexmbd simulate scene.toml

[[body]]
name = "crank"
mass = 0.2
inertia = [1e-5, 2e-4, 2e-4]
com = [0.05, 0.0, 0.0]

[[body]]
name = "coupler"
mass = 0.6
inertia = [1e-5, 5e-3, 5e-3]
com = [0.15, 0.0, 0.0]

[[body]]
name = "rocker"
mass = 0.4
inertia = [1e-5, 2e-3, 2e-3]
com = [0.1, 0.0, 0.0]

[[joint]]
name = "drive"
kind = "revolute"
axis = "z"
child = "crank"
motion = { t = [0.0, 0.5, 1.0, 2.0], y = [0.5, 0.7, 2.0, 6.5] }      # rad over s

[[joint]]
name = "elbow"
kind = "revolute"
axis = "z"
parent = { body = "crank", p = [0.1, 0.0, 0.0] }
child = "coupler"
position = 0.5

[[joint]]
name = "wrist"
kind = "revolute"
axis = "z"
parent = { body = "coupler", p = [0.3, 0.0, 0.0] }
child = { body = "rocker", p = [0.2, 0.0, 0.0] }

[[joint]]                                  # closes the loop
name = "support"
kind = "revolute"
axis = "z"
parent = { body = "ground", p = [0.3, 0.0, 0.0] }
child = "rocker"

[simulate]
t_end = 2.0

[output]
reactions = ["drive"]
rotations = ["rocker"]
formats = ["csv", "npz"]
"""

FOUR_BAR = SceneFolder(
    "four_bar",
    "a four-bar linkage with a prescribed motion; the moment that it takes",
    {"scene.toml": _SCENE},
    ("flexmbd plot scene_results/results.csv --column 'drive.reaction.*'",),
)
