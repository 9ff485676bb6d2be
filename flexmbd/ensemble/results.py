"""Results of an ensemble: outputs by name, and the variants that failed."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.ensemble.results_file import DONE, FAILED, ResultsFile
from flexmbd.ensemble.samples import Samples
from flexmbd.errors import SceneError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Failure:
    """A variant that failed.

    Attributes:
        index: which, from 0.
        values: of its parameters.
        message: why.
    """

    index: int
    values: dict[str, Any]
    message: str


class Ensemble:
    """The outputs of all variants, read from their file as they are asked for.

    A context manager; ``close`` lets go of the file.
    """

    def __init__(self, samples: Samples, file: ResultsFile) -> None:
        self._samples, self._file = samples, file

    def __repr__(self) -> str:
        """How many variants, how many of them failed, and the outputs."""
        failed = int((self._file.state == FAILED).sum())
        outputs = ", ".join(f"{name} {(len(self), *shape)}" for name, shape in self._file.shapes.items())
        return f"<Ensemble of {len(self)} variants, {failed} failed: {outputs}>"

    def __len__(self) -> int:
        """How many variants there are, failed ones included."""
        return len(self._samples)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self._file.names

    @property
    def done(self) -> BoolArray:
        """(n,) which variants have outputs; those of the others are NaN."""
        found: BoolArray = self._file.state == DONE
        return found

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The variants that failed, with the values of their parameters."""
        self._refuse_closed()
        rows = (int(k) for k in np.flatnonzero(self._file.state == FAILED))
        return tuple(Failure(k, self._samples[k], self._file.message(k)) for k in rows)

    @checked()
    def output(self, name: str, rows: slice = slice(None)) -> FloatArray:
        """(n, ...) an output of all variants, or of ``rows`` of them alone.

        Raises:
            SceneError: there is no output of that name, or the ensemble is closed.
        """
        if name not in self.names:
            raise SceneError(f"the ensemble has no output {name!r}; it has {', '.join(self.names)}")
        self._refuse_closed()
        found: FloatArray = self._file.file["outputs"][name][rows]
        return found

    def _refuse_closed(self) -> None:
        if not self._file.file:  # h5py's files are false once they are closed
            raise SceneError("the ensemble is closed: ask for outputs and failures before close()")

    @checked()
    def values(self, k: int) -> dict[str, Any]:
        """The values of the parameters of variant k, from 0.

        Raises:
            SceneError: there is no such variant.
        """
        if not 0 <= k < len(self._samples):
            raise SceneError(f"k must be one of the {len(self._samples)} variants, counted from 0, got {k}")
        return self._samples[k]

    def close(self) -> None:
        """Let go of the file; outputs cannot be asked for any more."""
        self._file.close()

    def __enter__(self) -> Ensemble:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the file."""
        self.close()
