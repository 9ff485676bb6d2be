"""What nodes that move, and turn, remember at checkpoints, on any number of ranks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.interior.nodal_turns import recalled, remembered
from flexmbd.continuum.interior.step_equations import NodalState

FloatArray = NDArray[np.float64]

_NODAL = ("x", "v", "a", "auxiliary")


def nodes_remembered(state: NodalState, memory: BodyMemory) -> dict[str, FloatArray]:
    """A state as arrays over the whole body. Collective."""
    arrays = {name: memory.gather_nodes(getattr(state, name)) for name in _NODAL}
    turns = {} if state.turns is None else remembered(state.turns, memory)
    return {**arrays, **turns, "times": np.array([state.t, state.h])}


def nodes_recalled(arrays: Mapping[str, FloatArray], memory: BodyMemory, *, turns: bool) -> NodalState:
    """This rank's part of `nodes_remembered`; turns: whether nodes turn. Collective."""
    nodal = {name: memory.scatter_nodes(arrays[name]) for name in _NODAL}
    t, h = (float(value) for value in arrays["times"])
    return NodalState(t=t, h=h, turns=recalled(arrays, memory) if turns else None, **nodal)
