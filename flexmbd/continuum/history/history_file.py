"""A body with history in a file: its state after an accepted step, for any number of ranks."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import RecordError, SceneError
from flexmbd.files.array_file import read_arrays, write_arrays

_VERSION = 2


def fingerprint(body: NonlinearModel, **surroundings: object) -> str:
    """A digest of mesh, elements, materials and surroundings of a body. Collective."""
    materials = [(group.name, group.form_name, group.parameters) for group in body.groups]
    if body.surfaces:
        surroundings["surfaces"] = [(group.name, group.form_name, group.parameters) for group in body.surfaces]
    identity = (body.mesh.fingerprint(), body.degree, materials, surroundings)
    return hashlib.sha256(repr(identity).encode()).hexdigest()


def save_body(body: NonlinearModel, path: str | Path, *, t: float) -> None:
    """Keep the last accepted step in a file (.npz), which is whole at any instant. Collective.

    Args:
        body: the body.
        path: of the file.
        t: the instant or load parameter, which `load_body` gives back.

    Raises:
        RecordError: on all ranks: it cannot be written.
    """
    arrays: dict[str, Any] = {"version": _VERSION, "body": fingerprint(body), "t": t}
    arrays |= {f"memory.{name}": part for name, part in BodyMemory(body).gather(body.snapshot()).items()}
    parallel.on_root(body.comm, lambda: write_arrays(path, arrays))


def load_body(body: NonlinearModel, path: str | Path) -> float:
    """Be as `save_body` has kept it; the instant or load parameter. Collective.

    Raises:
        RecordError: on all ranks: no such file, or none of ours.
        SceneError: on all ranks: it is of another body.
    """
    file: dict[str, Any] = parallel.on_root(body.comm, lambda: read_arrays(path, version=_VERSION))
    if "body" not in file:
        raise RecordError(f"{path} holds no body with history")
    if str(file["body"]) != fingerprint(body):
        raise SceneError(f"{path} is of another body: mesh, element or materials differ")
    memory = {name.removeprefix("memory."): np.asarray(part, dtype=float) for name, part in file.items()
              if name.startswith("memory.")}  # fmt: skip
    body.restore(BodyMemory(body).scatter(memory))
    return float(file["t"])
