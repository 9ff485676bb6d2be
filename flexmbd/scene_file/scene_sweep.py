"""Runs of a scene file with other values, each built from the file anew; on the ensembles' executors and files."""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexmbd.ensemble.executing import run_ensemble
from flexmbd.ensemble.results import Ensemble
from flexmbd.ensemble.results_file import FAILED, add_to_file, results
from flexmbd.ensemble.samples import Samples
from flexmbd.ensemble.stamp import program_stamp
from flexmbd.ensemble.variants import Study
from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.integrate.protocol import Integrator
from flexmbd.scene_file.entry_kinds import INTEGRATORS
from flexmbd.scene_file.reading import read_scene
from flexmbd.scene_file.result_columns import plan_columns, tabulate
from flexmbd.scene_file.scene_builder import Built, build
from flexmbd.scene_file.scene_description import SceneFile

if TYPE_CHECKING:  # h5py loads where a file is asked for
    import h5py

FloatArray = NDArray[np.float64]


def _mean(t: FloatArray, y: FloatArray) -> float:
    """Over time, by trapezoids."""
    return float(np.diff(t) @ (y[1:] + y[:-1]) / (2.0 * (t[-1] - t[0]))) if t[-1] > t[0] else float(y[-1])


#: What is taken of a column over time, by name: of the times (s) and its values.
TAKES: dict[str, Callable[[FloatArray, FloatArray], float]] = {
    "last": lambda t, y: float(y[-1]),
    "min": lambda t, y: float(y.min()),
    "max": lambda t, y: float(y.max()),
    "mean": _mean,
    "rms": lambda t, y: float(np.sqrt(_mean(t, y**2))),
}


@dataclass(frozen=True)
class SceneSweep:
    """A scene file, and the outputs of each of its variants.

    Attributes:
        path: of the scene file.
        changes: values that all variants have, by dotted paths.
        patterns: names of columns, with * for any letters; none for all.
        takes: the values taken of each.
    """

    path: Path
    changes: Mapping[str, object]
    patterns: tuple[str, ...]
    takes: tuple[str, ...]

    def table(self, **values: Any) -> ResultTable:
        """The results of one variant over time.

        Raises:
            FlexmbdError: as reading, building and simulating a scene.
        """
        scene = self.scene(values)
        built = build(scene)
        columns = plan_columns(built, scene.output)
        return tabulate(simulated(built, scene), columns, every=scene.output.every)

    def scene(self, values: Mapping[str, object]) -> SceneFile:
        """The description of one variant."""
        return read_scene(self.path, changes={**self.changes, **values})

    def first_possible(self, rows: Sequence[Mapping[str, object]]) -> Mapping[str, object]:
        """The first variant that can be built.

        Raises:
            SceneError: the first cannot be read, as with a key that is not known; or none can be built, and why not
                the first.
        """
        self.scene(rows[0])
        fault: FlexmbdError | None = None
        for row in rows:
            try:
                build(self.scene(row))
            except FlexmbdError as reason:
                fault = fault or reason
            else:
                return row
        raise SceneError(f"none of the {len(rows)} variants can be built; the first: {fault}") from fault

    def quantities(self, values: Mapping[str, object]) -> list[tuple[str, str]]:
        """Names and units of a variant's outputs: the last time, then each column by each take.

        Raises:
            SceneError: no column fits a pattern; or as reading and building the variant.
        """
        scene = self.scene(values)
        planned = plan_columns(build(scene), scene.output)
        columns = [pair for one in planned for pair in zip(one.names, one.units, strict=True)]
        for pattern in self.patterns:
            if not any(fnmatch.fnmatchcase(name, pattern) for name, _ in columns):
                raise SceneError(f"no column fits {pattern!r}; there are {', '.join(name for name, _ in columns)}")
        kept = [
            (name, unit)
            for name, unit in columns
            if not self.patterns or any(fnmatch.fnmatchcase(name, pattern) for pattern in self.patterns)
        ]
        return [("t.last", "s"), *((f"{name}.{take}", unit) for name, unit in kept for take in self.takes)]

    def run(  # as of the ensembles
        self,
        rows: Sequence[Mapping[str, Any]],
        *,
        executor: Executor,
        workers: int,
        file: Path,
        progress: bool,
    ) -> Ensemble:
        """Run all variants that the file does not hold yet.

        Args:
            rows: values of each variant by dotted paths.
            executor: of processes.
            workers: how many it has.
            file: where outputs go as they come.
            progress: show a progress bar.

        Raises:
            SceneError: the first variant cannot be built, or all failed.
            RecordError: the file cannot be written, or is of another sweep.
        """
        possible = self.first_possible(rows)
        first, names = self.scene(possible), [name for name, _ in self.quantities(possible)]
        samples = Samples(rows)
        digest = build(first).system.compile().scene.digest()
        told = (program_stamp(), digest, repr(first), samples.digest(), names)
        study = Study(self.table, {"quantities": _Taken(self.takes, tuple(names[1:]))}, shared=False)
        return run_ensemble(
            study,
            samples,
            hashlib.sha256(repr(told).encode()).hexdigest(),
            executor=executor,
            workers=workers,
            file=file,
            progress=progress,
        )


@dataclass(frozen=True)
class _Taken:
    """(1 + k,) the last time and what is taken of a table's columns, in the order of the names."""

    takes: tuple[str, ...]
    names: tuple[str, ...]

    def __call__(self, table: ResultTable) -> FloatArray:
        t = table.values[:, 0]
        found = [float(t[-1])]
        for name in self.names:
            column, _, take = name.rpartition(".")
            found.append(TAKES[take](t, table.column(column)))
        return np.array(found)


@dataclass(frozen=True, eq=False)
class SweepResults:
    """The results in a sweep's file.

    Attributes:
        values: (n, k) what was taken of each variant; NaN where it is not done.
        failures: numbers of variants that failed, with the reasons.
    """

    values: FloatArray
    failures: tuple[tuple[int, str], ...]


def sweep_results(path: Path, samples: ResultTable, quantities: Sequence[tuple[str, str]]) -> SweepResults:
    """Read a sweep's file, and write names, units and the variants' values into it for those who read it alone.

    Raises:
        RecordError: it cannot be read or written.
    """
    def name(file: h5py.File) -> None:
        outputs = file["outputs/quantities"]
        outputs.attrs["names"], outputs.attrs["units"] = zip(*quantities, strict=True)
        table = file.create_dataset("samples", data=samples.values, track_times=False)
        table.attrs["names"], table.attrs["units"] = samples.names, samples.units

    with results(path) as file:
        failed = np.flatnonzero(file["state"][()] == FAILED)
        failures = tuple((int(k), file["message"][k].decode(errors="replace")) for k in failed)
        found, named = SweepResults(file["outputs/quantities"][()], failures), "samples" in file
    if not named:
        add_to_file(path, name)
    return found


def simulated(built: Built, scene: SceneFile, *, progress: bool = False, stream: Path | None = None) -> Any:
    """The trajectory of a machine by the settings of its file; raises as ``System.simulate``.

    ``stream``: a file that it goes to while the machine runs.
    """
    settings = scene.run
    return built.system.simulate(
        settings.t_end,
        rtol=settings.rtol,
        h=settings.h,
        integrator=integrator_of(scene),
        events=built.events,
        progress=progress,
        max_step=settings.max_step,
        max_steps=settings.max_steps,
        max_seconds=settings.max_seconds,
        stream=stream,
    )


def integrator_of(scene: SceneFile) -> Integrator | Literal["auto"]:
    """The integrator that the file names, or the choice of one."""
    return INTEGRATORS[scene.run.integrator]() if scene.run.integrator else "auto"
