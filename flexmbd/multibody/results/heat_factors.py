"""The factors of the temperatures among a body's loads over time, for the stress of what expands and is held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.force.distributed_load import DistributedLoad
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import force_elements
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.stress_field import StressField, StressModel

FloatArray = NDArray[np.float64]


def heat_factors(
    scene: CompiledScene, body: Body, record: ReducedBody, t: Sequence[float] | FloatArray
) -> dict[str, FloatArray]:
    """Of each temperature in a body's record by its name, (nt,) at times t (nt,) s; nothing where there are none.

    Args:
        scene: of the body.
        body: in it.
        record: its own.
        t: instants.

    Raises:
        SceneError: a user's function failed, which is asked anew.
    """
    if record.heat is None:
        return {}
    found: dict[str, FloatArray] = {name: np.zeros(len(t)) for name in record.heat.names}
    times = force_elements(scene.plan).time
    scene.forget_failure()
    for force in scene.index.forces:
        if not isinstance(force, DistributedLoad) or force.body is not body or force.name not in found:
            continue
        elements = scene.index.forces[force].elements
        if elements.start == elements.stop:  # one that exerts nothing
            continue
        function = int(times[elements.start])
        alone, out = scene.plan.replace(times=scene.plan.times[function : function + 1]), np.zeros((2, 3))
        for k, instant in enumerate(t):
            evaluate_times(alone, float(instant), out)
            found[force.name][k] += out[0, 0]
    scene.refuse_failed(new_work(scene.plan))
    return found


def heated_stress_field(
    model: StressModel, record: ReducedBody, q: FloatArray, factors: Mapping[str, FloatArray], k: int
) -> StressField:
    """Stress at modal coordinates q (n,) and at the instant k of the factors; as `StressModel.stress_field`."""
    if not factors:
        return model.stress_field(record, q)
    return model.stress_field(record, q, heat={name: float(values[k]) for name, values in factors.items()})


def stress_in_machine(
    scene: CompiledScene, body: FlexibleBody, model: StressModel, q: FloatArray, t: float
) -> StressField:
    """Stress of a reduced body at modal coordinates q (n,) and at its temperatures at t (s)."""
    record = scene.index.now(body).record
    return heated_stress_field(model, record, q, heat_factors(scene, body, record, [t]), 0)
