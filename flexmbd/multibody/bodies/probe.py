"""Plans with one more frame, for asking where it is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.kernels.base.arrays import Plan


def with_probe(plan: Plan, body_row: Mapping[int, int], frame: Frame) -> Plan:
    """Return the plan with ``frame`` as its last.

    Raises:
        SceneError: the frame's body is not among those of ``body_row`` (body id to row of ``plan.tree``).
    """
    row = body_row.get(id(frame.body))
    if row is None:
        raise SceneError(f"frame {frame.label} belongs to no body of this scene")
    modes = -1 if frame.modes is None else len(plan.modal)
    extra = np.zeros(0) if frame.modes is None else frame.modes.ravel()
    place = np.concatenate([frame.p_BF_B, frame.R_BF.ravel()])
    return plan._replace(
        frames=np.vstack([plan.frames, place]),
        frame_of=np.vstack([plan.frame_of, [row, modes]]),
        modal=np.concatenate([plan.modal, extra]),
    )
