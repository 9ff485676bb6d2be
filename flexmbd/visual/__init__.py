"""Pictures: series over time, films of the machine, stress on a mesh.

Loads numpy alone; matplotlib and pyvista load when a picture is asked for.
"""

from flexmbd.record.stress_field import StressModel as StressModel
from flexmbd.room import public_names as _public_names
from flexmbd.visual.campbell_plot import plot_campbell as plot_campbell
from flexmbd.visual.drawn_scene import machine_meshes as machine_meshes
from flexmbd.visual.film import animate as animate
from flexmbd.visual.recorded_motion import Marked as Marked
from flexmbd.visual.recorded_motion import RecordedMotion as RecordedMotion
from flexmbd.visual.recorded_skin import FieldSeries as FieldSeries
from flexmbd.visual.recorded_skin import Look as Look
from flexmbd.visual.response_plot import Responding as Responding
from flexmbd.visual.response_plot import plot_response as plot_response
from flexmbd.visual.series_plot import Drawn as Drawn
from flexmbd.visual.series_plot import plot_series as plot_series
from flexmbd.visual.series_plot import plot_table as plot_table
from flexmbd.visual.shape_picture import plot_shape as plot_shape
from flexmbd.visual.show import show as show
from flexmbd.visual.stress_picture import plot_stress as plot_stress

__all__ = _public_names(globals())
