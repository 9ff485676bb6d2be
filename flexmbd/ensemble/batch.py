"""Variants one after the other in one workspace: numbers by tables, outputs sampled, no trajectory."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.ensemble.sampled import Sampled, Sampler
from flexmbd.errors import FlexmbdError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.parameter.protocol import Parameter
from flexmbd.multibody.parameter.value_columns import ValueColumns, tabled_names, value_columns
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.prepared import PreparedRuns, Workspaces

FloatArray = NDArray[np.float64]
Values = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class BatchRuns:
    """How a machine's variants are run in workspaces.

    Attributes:
        scene: as it was compiled.
        parameters: what each name means.
        variant: the scene with other values.
        given: x (nx,) and v (nv,) that joints and bodies are given in a variant.
        workspaces: idle ones; key: of these runs.
        new: makes one; None where there can be none.
        outputs: what is sampled of each variant.
    """

    scene: CompiledScene
    parameters: Mapping[str, tuple[Parameter, ...]]
    variant: Callable[[Values], CompiledScene]
    given: Callable[[CompiledScene], tuple[FloatArray, FloatArray]]
    workspaces: Workspaces
    key: tuple[object, ...]
    new: Callable[[], PreparedRuns | None]
    outputs: Mapping[str, Sampled]

    def run(self, rows: Sequence[Values]) -> Generator[dict[str, FloatArray] | None]:
        """The outputs of one variant after the other; None of one that is to be run, or told, the other way.

        Closed, or at its end, it gives the workspace back for the next ones.
        """
        given = {name: self.parameters[name] for name in rows[0]}
        tabled = tabled_names(given, self.scene)
        others = [name for name in given if name not in tabled]
        columns = value_columns(self.scene, {name: given[name] for name in tabled}, rows)
        batch: _Batch | None = None
        self.workspaces.are_for(self.key)  # in another process, too
        try:
            for k, row in enumerate(rows):
                if columns is None or not columns.possible[k]:
                    yield None
                    continue
                if batch is None:
                    workspace = self.workspaces.taken(self.key, self.new)
                    batch = None if workspace is None else _Batch(self, workspace, columns, others)
                found = None
                if batch is not None:
                    running, batch = batch, None  # what a run that fails leaves in its arrays is for nobody
                    found = running.outputs(k, row)
                    batch = None if running.has_failed else running
                yield found
        finally:
            if batch is not None:
                self.workspaces.give_back(self.key, batch.workspace)


class _Batch:
    """Variants with the same parameters in one workspace."""

    def __init__(
        self, runs: BatchRuns, workspace: PreparedRuns, columns: ValueColumns, others: Sequence[str]
    ) -> None:
        self.workspace, self.has_failed = workspace, False
        self._runs, self._columns, self._others = runs, columns, others
        self._sampler = Sampler(runs.outputs, workspace)
        self._scene, self._given = runs.scene, runs.given(runs.scene)
        workspace.take(runs.scene)

    def outputs(self, k: int, row: Values) -> dict[str, FloatArray] | None:
        """Those of variant k, whose values are ``row``."""
        workspace, table = self.workspace, self._columns.table
        if self._others:
            try:
                self._scene = self._runs.variant({name: row[name] for name in self._others})
            except FlexmbdError:
                return None
            if not workspace.take(self._scene):
                return None
            self._given = self._runs.given(self._scene)
        workspace.x[:], workspace.v[:] = self._given
        self._columns.write_start(k, workspace.x, workspace.v)
        table.write(k, workspace.numbers, workspace.scene.group_full, workspace.scene.group_floor)
        if not workspace.begin():
            return None
        rows = workspace.step()
        if rows is None:
            self.has_failed = True
            return None
        if rows.interrupt is not None:
            raise rows.interrupt

        def placing(frame: Frame) -> tuple[FloatArray, FloatArray]:
            now = self._scene.index.frame_now(frame)
            return table.place(frame, k, now.p_BF_B), now.R_BF

        return self._sampler.outputs(rows, placing)
