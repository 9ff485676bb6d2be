"""Pictures: series over time, films of the machine, stress on a mesh.

Loads numpy alone; matplotlib and pyvista load when a picture is asked for.
"""

from flexmbd.visual.film import animate as animate
from flexmbd.visual.motion import Marked as Marked
from flexmbd.visual.motion import Motion as Motion
from flexmbd.visual.response import Responding as Responding
from flexmbd.visual.response import plot_response as plot_response
from flexmbd.visual.series import Drawn as Drawn
from flexmbd.visual.series import plot_series as plot_series
from flexmbd.visual.stress_picture import StressModel as StressModel
from flexmbd.visual.stress_picture import plot_stress as plot_stress
