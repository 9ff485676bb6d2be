"""What is observed of a linearised machine, or given out by a machine's FMU; docs/linearized.md.

A public name: users enter here.
"""

from flexmbd.multibody.linear.output_equations import Acceleration as Acceleration
from flexmbd.multibody.linear.output_equations import Observed as Observed
from flexmbd.multibody.linear.output_equations import Output as Output
from flexmbd.multibody.linear.output_equations import Position as Position
from flexmbd.multibody.linear.output_equations import Rotation as Rotation
from flexmbd.multibody.linear.output_equations import Velocity as Velocity
