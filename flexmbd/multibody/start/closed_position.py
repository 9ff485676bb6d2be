"""The configuration of a start with its loops closed, and the constraint rows that are kept there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.reading.constraint_tables import with_coupling_sums
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import constraint_values
from flexmbd.multibody.start.design_position import assemble_from_design
from flexmbd.multibody.start.given_coordinates import GivenCoordinates
from flexmbd.multibody.start.independent_rows import RowChoice, RowDecomposition, decompose_rows, independent_rows
from flexmbd.multibody.start.loop_closing import close_loops
from flexmbd.multibody.start.placement import refuse_turned_over

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: The arrays of a plan that closing its loops reads.
_KINEMATIC = ("tree", "frames", "frame_of", "flex", "modal", "data", "rows", "driven", "free")


@dataclass(frozen=True, eq=False)
class ClosedPosition:
    """Where a start closes the loops, and what it was found of.

    Attributes:
        x: (nx,) configuration.
        change: (nv,) tangent vector from the configuration wanted.
        left_open: as of ``loop_closing.Closing``.
        choice: of the rows.
        places: decompositions of the blocks of all rows at x.
        wanted, held: (nx,), (nv,) the configuration wanted, and which of it was set.
        time: of the functions of time there.
        plan: of the scene.
        extent, group_full: sizes of the scene.
        is_alone: whether nothing else than these says where the loops close.
    """

    x: FloatArray
    change: FloatArray
    left_open: float
    choice: RowChoice
    places: tuple[RowDecomposition, ...]
    wanted: FloatArray
    held: Mask
    time: FloatArray
    plan: Plan
    extent: float
    group_full: FloatArray
    is_alone: bool

    def is_of(self, scene: CompiledScene, work: Work, wanted: FloatArray, held: Mask) -> bool:
        """Whether a scene with these coordinates wanted closes its loops here, too."""
        return (
            self.is_alone
            and all(getattr(scene.plan, name) is getattr(self.plan, name) for name in _KINEMATIC)
            and self.extent == scene.extent
            and np.array_equal(self.group_full, scene.group_full)
            and np.array_equal(self.wanted, wanted)
            and np.array_equal(self.held, held)
            and np.array_equal(self.time, work.time)
        )


def close_position(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    held: Mask,
    given: GivenCoordinates,
    *,
    is_found: bool,
    known: ClosedPosition | None = None,
) -> tuple[CompiledScene, CompiledScene, ClosedPosition]:
    """Close the loops of a scene, and choose its rows.

    Args:
        scene: with all its constraint rows.
        work: scratch; ``work.time`` holds the functions of time at the start.
        x: (nx,) wanted configuration.
        held: (nv,) tangent directions of coordinates set by the user.
        given: coordinates of joints held by constraints.
        is_found: whether x is of a state found before, to be kept.
        known: of the same machine with other numbers, or with these.

    Returns:
        The scene with the sums of its couplings; the same with the rows that are kept; the position.

    Raises:
        AssemblyError, SceneError: as of ``consistent_start``.
    """
    if known is not None and not (is_found or given.positions) and known.is_of(scene, work, x, held):
        found = replace(known, x=known.x.copy(), change=known.change.copy())
        return scene, scene.keep_rows(known.choice.rows), found
    whole = _set_couplings(scene, work, x, held, given)
    led = x if given.positions or is_found else assemble_from_design(whole, work, x, held)
    closing = close_loops(whole, work, led, held, given)
    refuse_turned_over(whole, work, closing.x)
    places = decompose_rows(whole, work, closing.x)
    choice = independent_rows(whole, work, closing.x, places, known=None if known is None else known.choice)
    reduced = whole.keep_rows(choice.rows)
    # without the redundant rows, which may stay open a little, the others close to round-off
    after = close_loops(reduced, work, closing.x, held, given)
    if after.x is not closing.x:
        places = decompose_rows(whole, work, after.x)
    is_alone = (
        whole is scene
        and not (is_found or given.positions or scene.interiors)
        and all(branch.connection is not None for branch in scene.topology.branches)
    )
    return whole, reduced, ClosedPosition(
        after.x, closing.change + after.change, closing.left_open, choice, tuple(places),
        x.copy(), held.copy(), work.time.copy(), scene.plan, scene.extent, scene.group_full.copy(), is_alone,
    )  # fmt: skip


def _set_couplings(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask, given: GivenCoordinates
) -> CompiledScene:
    """Give the couplings the sums that they have where all other constraints are fulfilled."""
    coupling = scene.row_structure.couplings
    if len(coupling) == 0:
        return scene
    others = scene.keep_rows(np.setdiff1d(np.arange(len(scene.plan.rows)), coupling))
    closed = close_loops(others, work, x, held, given).x
    bare = replace(scene, plan=with_coupling_sums(scene.plan, coupling, np.zeros(len(coupling))))
    sums = constraint_values(bare, work, closed, np.zeros(scene.nv))[0]
    return replace(scene, plan=with_coupling_sums(scene.plan, coupling, sums[coupling]))
