"""A pendulum on a torsion spring with a law of its own."""

from flexmbd.command.examples.scene_folder import SceneFolder

_SCENE = """\
# A pendulum with a damper of one's own: laws.py beside this file.   Units are SI.
#
#     flexmbd simulate scene.toml

gravity = [0.0, 0.0, -9.81]

[[body]]
name = "bob"
mass = 2.0
inertia = [0.01, 0.01, 0.01]
com = [0.0, 0.0, -1.0]

[[joint]]
name = "hinge"
kind = "revolute"
axis = "y"
child = "bob"
position = 0.5                             # rad, at the start

[[force]]
kind = "joint_spring"
joint = "hinge"
stiffness = 3.0                            # N m/rad

[[force]]
kind = "joint_law"
joint = "hinge"
law = "laws.py:air"

[simulate]
t_end = 5.0
rtol = 1e-7

[output]
every = 0.01
positions = [{ body = "bob", p = [0.0, 0.0, -1.0], name = "tip" }]
"""
_LAWS = '''\
"""Laws of the scene beside this file."""

import flexmbd as fm


@fm.compiled                               # without this line: plain Python, slower
def air(t, angle, rate):
    """The moment (N m) of the air's resistance on the hinge."""
    return -0.2 * rate * abs(rate)
'''

SPRING_PENDULUM = SceneFolder(
    "spring_pendulum",
    "a pendulum with a spring, and a damper of one's own in Python",
    {"scene.toml": _SCENE, "laws.py": _LAWS},
    ("flexmbd plot scene_results/results.csv --column 'hinge.*'",),
)
