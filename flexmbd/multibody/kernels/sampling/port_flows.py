"""The flow of a port, as an electrode's charge, at a state of the machine."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times


@entry_kernel
def port_flow(plan, work, time, x, place, load, second, rows, capacity, out):
    """out[0] = load . q + q . second q / 2 + capacity . efforts.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        time: (1,) float64, s.
        x: (nx,) float64, configuration.
        place: int64, of the first modal coordinate in it.
        load: (n,) float64, flow per modal coordinate.
        second: (n, n) float64, by which that grows; (0, 0) where it does not.
        rows: (k,) int64, rows of Plan.times of the efforts.
        capacity: (k,) float64, flow per effort.
        out: (1,) float64, output.
    """
    evaluate_times(plan, time[0], work.time)
    flow = 0.0
    for i in range(load.shape[0]):
        slope = load[i]
        for j in range(second.shape[0]):
            slope += 0.5 * second[i, j] * x[place + j]
        flow += slope * x[place + i]
    for k in range(rows.shape[0]):
        flow += capacity[k] * work.time[rows[k], 0]
    out[0] = flow
