"""Whether all ranks of a team have built the same machine."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]


def refuse_different(scene: CompiledScene, x: FloatArray, v: FloatArray, team: Team) -> None:
    """Compare scenes and the given start (x, v) with rank 0's.  Collective.

    Functions may differ: rank 0's count.

    Raises:
        SceneError: on every rank, if those of some rank differ.
    """
    if team.size == 1:  # nobody to differ from
        return
    given = hashlib.sha256(scene.digest(functions=False).encode() + x.tobytes() + v.tobytes()).digest()
    mine = np.frombuffer(given, np.uint8).astype(np.float64)
    error: SceneError | None = None
    if (team.agree(mine) != mine).any():
        error = SceneError(
            "the scene differs between ranks: another number or start on this rank than on rank 0; build it "
            "from the same numbers on every rank"
        )
    team.fail(error)


def refuse_different_arguments(given: Mapping[str, str], team: Team) -> None:
    """Compare arguments, told by name, with rank 0's.  Collective.

    Raises:
        SceneError: on every rank, if one of some rank differs; it gives the name and both values.
    """
    if team.size == 1:
        return
    of_root = team.on_root(lambda: dict(given))
    error: SceneError | None = None
    for name in given:
        if error is None and of_root[name] != given[name]:
            error = SceneError(
                f"{name} is {of_root[name]} on rank 0 and {given[name]} on this rank; give the same on all ranks"
            )
    team.fail(error)
