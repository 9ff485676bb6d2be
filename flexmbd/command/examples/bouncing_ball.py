"""A ball that bounces: an event with an action."""

from flexmbd.command.examples.scene_folder import SceneFolder

_SCENE = """\
# A ball falls and bounces: an event and its action, laws.py beside this file.   Units are SI.
#
#     flexmbd simulate scene.toml

gravity = [0.0, 0.0, -9.81]

[[body]]
name = "ball"
mass = 0.5
inertia = [2e-3, 2e-3, 2e-3]

[[joint]]
name = "fall"
kind = "prismatic"
axis = "z"
child = "ball"
position = 1.0

[[event]]
name = "touches"
joint = "fall"
position = 0.1                             # m, the ball's radius
direction = "falling"
action = "laws.py:bounce"

[simulate]
t_end = 1.5
rtol = 1e-8

[output]
every = 0.005
"""
_LAWS = '''\
"""What happens in the scene beside this file."""

RESTITUTION = 0.8


def bounce(moment, scene):
    """Turn the ball's velocity round; the scene has bodies, joints and forces by their names."""
    fall = scene.joints["fall"]
    moment.set_rate(fall, -RESTITUTION * moment.beta_rate(fall))
'''

BOUNCING_BALL = SceneFolder(
    "bouncing_ball",
    "a ball that bounces: an event with an action in Python",
    {"scene.toml": _SCENE, "laws.py": _LAWS},
    ("flexmbd plot scene_results/results.csv --column 'fall.*'",),
)
