"""Efforts of a body's ports over time, evaluated anew as all given forces are.

They are functions of time, signals of controllers, and outputs of states.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.motion.machine import Machine

FloatArray = NDArray[np.float64]


def port_efforts(scene: Machine, body: FlexibleBody, t: FloatArray, x: FloatArray, v: FloatArray) -> FloatArray:
    """(nt, k) efforts of the k ports of a body at times t (nt,), in configurations x (nt, nx), velocities v (nt, nv).

    Raises:
        SceneError: the body has no ports, or is of another scene; or a user's function failed.
    """
    if body.record.ports is None:
        raise SceneError(f"body {body.name!r} has no ports; give its model electrodes, conditions=[Electrode(...)]")
    scene.index.modal(body)
    rows = [scene.index.efforts[body.port(name)] for name in body.record.ports.names]
    scene.forget_failure()
    plan, work = scene.plan, new_work(scene.plan)
    none, out, rest = np.zeros(len(plan.rows)), np.zeros(scene.nv), np.zeros(scene.nv)
    found = np.zeros((len(t), len(rows)))
    for k, instant in enumerate(t):
        evaluate_times(plan, float(instant), work.time)
        if len(scene.index.states):  # whose outputs stand among the functions of time once the forces are known
            residual(plan, work, np.ascontiguousarray(x[k]), np.ascontiguousarray(v[k]), rest, none, out)
        found[k] = work.time[rows, 0]
    scene.refuse_failed(work)
    return found
