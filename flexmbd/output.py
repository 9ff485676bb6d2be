"""What is observed of a linearised machine, or given out by a machine's FMU; docs/linearized.md.

A public name: users enter here.
"""

from flexmbd.multibody.motion.quantity import Acceleration as Acceleration
from flexmbd.multibody.motion.quantity import LinearOutput as LinearOutput
from flexmbd.multibody.motion.quantity import Observed as Observed
from flexmbd.multibody.motion.quantity import Output as Output
from flexmbd.multibody.motion.quantity import Position as Position
from flexmbd.multibody.motion.quantity import Rotation as Rotation
from flexmbd.multibody.motion.quantity import Velocity as Velocity
