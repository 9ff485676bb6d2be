"""The chain of ten links of `scenes.py` in MuJoCo, many of them by its `rollout`; what `ensemble.py` runs beside.

MuJoCo takes fixed steps: RK4, its most exact method, with contacts, limits and other constraints switched off.  A batch
takes a model a variant, so that masses may differ; threads share the variants out in C.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
import scenes
from mujoco import rollout

LINKS = 10
_END = 1.0  # s


def _model(h: float) -> mujoco.MjModel:
    """The chain, with steps of about h (s)."""
    moments = " ".join(map(str, scenes.link_inertia()))
    inside = ""
    for i in reversed(range(LINKS)):
        end = f'<site name="tip" pos="{scenes.LINK} 0 0"/>' if i == LINKS - 1 else ""
        inside = (
            f'<body pos="{scenes.LINK if i else 0.0} 0 0"><joint type="hinge" axis="0 0 1"/>'
            f'<inertial pos="{0.5 * scenes.LINK} 0 0" mass="{scenes.LINK_MASS}" diaginertia="{moments}"/>'
            f"{end}{inside}</body>"
        )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{_END / round(_END / h)}" integrator="RK4" gravity="0 {-scenes.G} 0">'
        '<flag constraint="disable" contact="disable" limit="disable" frictionloss="disable" spring="disable" '
        f'damper="disable" actuation="disable" sensor="disable"/></option><worldbody>{inside}</worldbody></mujoco>'
    )


class Batch:
    """Variants of the chain whose fifth links have the given masses (kg)."""

    def __init__(self, masses: Sequence[float], h: float) -> None:
        """Make a model a variant, which counts as set-up: only ``tips`` is timed."""
        first = _model(h)
        self.steps = round(_END / first.opt.timestep)
        self._models = [copy.copy(first) for _ in masses]
        for model, mass in zip(self._models, masses, strict=True):
            model.body_mass[5] = mass  # of the bodies the world is the first
        self._site = mujoco.mj_name2id(first, mujoco.mjtObj.mjOBJ_SITE, "tip")

    def tips(self, threads: int) -> np.ndarray:
        """(n, 3) m, the tips after 1 s."""
        data = [mujoco.MjData(self._models[0]) for _ in range(threads)]
        size = mujoco.mj_stateSize(self._models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        start = np.zeros((len(self._models), size))
        pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        states, _ = pool.rollout(self._models, data, start, nstep=self.steps)
        pool.close()
        found = []
        for model, state in zip(self._models, states[:, -1], strict=True):
            mujoco.mj_setState(model, data[0], state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            mujoco.mj_kinematics(model, data[0])
            found.append(data[0].site_xpos[self._site].copy())
        return np.array(found)
