"""The arrays of a compiled scene: ``Plan``, which is constant, and ``Work``, the scratch space of one evaluation.

Both are structures of arrays whose types never change, so that one compiled image serves every scene.  Who hands
them from kernel to kernel imports them from here; what their columns hold is for the kernels and the plan's room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Plan(ArrayStruct):
    """The arrays of a compiled scene (SI units; ``layout`` names their columns), constant but for three things.

    ``flag`` (1,) is set by a user's function that fails, and the step stops.  FLAG_PYTHON: an exception that
    ``Callbacks`` keeps; FLAG_ELEMENT + i or FLAG_TIME - i: no finite number from that row's compiled function.
    ``wrenches`` (k, 6) is what the interiors of bodies with history exert on their k frames now: force (N) and moment
    (N m) on each frame in inertial axes.  ``Interiors.apply_wrenches`` writes it; copies of the plan by ``replace``
    share it.  ``horizon`` (2,) is the longest next step (s) in which what is about to touch cannot pass through:
    contacts lower it as they are evaluated, the step-size controller takes it and puts it back to infinity; and whether
    friction of a contact bends within the step, to stick or to slide, as the last evaluation of forces found.  Python
    code cannot write to ``data``.
    """

    tree: IntArray
    frames: FloatArray
    frame_of: IntArray
    rigid: FloatArray
    shafts: FloatArray
    flex: IntArray
    modal: FloatArray
    data: FloatArray
    rows: IntArray
    forces: IntArray
    times: IntArray
    time_data: FloatArray
    driven: IntArray
    free: IntArray
    gravity: FloatArray
    lapack: IntArray
    flag: IntArray
    wrenches: FloatArray
    elements: IntArray
    penalties: IntArray  # constraint rows, with the columns of ``rows``, that penalties enforce in place of multipliers
    horizon: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        self.data.flags.writeable = False


def open_horizon() -> FloatArray:
    """A ``Plan.horizon`` that bounds no step."""
    return np.array([np.inf, 0.0])


@dataclass(frozen=True, eq=False)
class Work(ArrayStruct):
    """Scratch arrays of one evaluation; written before they are read.

    moments: (15, n) the table of moments of the reduced body at hand, see ``physics.modal_moments``.
    time: (functions of time + 1, 3) value, rate and acceleration; the time (s) itself begins the last row.
    generalized: (nv,) what a user's function of the state gives; before, scratch of the modes.  More where states take
        it: their values, what they follow, rates and outputs.
    memory: (nx,) the configuration, of which elements between frames read what they remember; none where none does.
    trial: (n,) the memory of the element at hand, led to where it is.
    """

    body: FloatArray
    frame: FloatArray
    time: FloatArray
    generalized: FloatArray
    moments: FloatArray
    memory: FloatArray
    trial: FloatArray


def memories_end(plan: Plan) -> int:
    """Where in the configuration x the memories of all elements end; 0 where none remembers."""
    return _memories_end(plan.elements[plan.elements[:, at.EL_MEMORY] >= 0])


def sides_end(plan: Plan) -> int:
    """Where in the configuration x the sides of all switches end; 0 where there are none."""
    return int(plan.elements[:, at.EL_SIDE].max(initial=-1)) + 1


def _memories_end(elements: IntArray) -> int:
    return int((elements[:, at.EL_MEMORY] + at.N_MEMORY_HEAD + elements[:, at.EL_COUNT]).max(initial=0))


def _most(elements: IntArray, *columns: int) -> list[int]:
    return [int(elements[:, k].max(initial=0)) for k in columns]


def new_work(plan: Plan) -> Work:
    """Allocate the scratch space of ``plan``."""
    remembering = plan.elements[plan.elements[:, at.EL_MEMORY] >= 0]
    return Work(
        np.zeros((len(plan.tree), at.N_BODY_WORK)),
        np.zeros((len(plan.frames), at.N_FRAME_WORK)),
        np.zeros((len(plan.times) + 1, 3)),
        np.zeros(max(len(plan.free) + len(plan.driven), *_most(plan.elements, at.EL_COUNT, at.EL_SCRATCH))),
        np.zeros((at.N_MOMENTS, int(plan.flex[:, at.N_MODES].max(initial=0)))),
        np.zeros(_memories_end(remembering[remembering[:, at.EL_F] >= 0])),
        np.zeros(int(remembering[:, at.EL_COUNT].max(initial=0))),
    )
