"""What computes an ensemble: an interrupted one goes on only by the same, or its variants would not be comparable."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.parameter.force_parameters import OfForce
from flexmbd.multibody.parameter.protocol import Parameter
from flexmbd.multibody.plan.compiled_scene import CompiledScene

_ROOMS = ("multibody", "integrate", "run")  # of which a run of a machine consists


@cache
def program_stamp() -> str:
    """Digest of the sources that run a machine, and versions of the libraries that compile and compute it."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parents[1]
    for room in _ROOMS:
        for source in sorted((package / room).rglob("*.py")):
            digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    versions = map(version, ("numba", "numpy", "scipy"))
    return " ".join((*versions, platform.machine(), digest.hexdigest()))


def meaning(parameter: Parameter, scene: CompiledScene) -> str:
    """Which quantity of which body, frame, joint or force of a scene it is; the same in any process."""
    of = parameter.of
    place: object
    if isinstance(of, Frame):
        place = scene.sources.rows_of.get(of)
    elif isinstance(of, Connection):
        place = of.name
    else:
        place = scene.index.bodies.get(of, scene.index.forces.get(of))
    argument = parameter.argument if isinstance(parameter, OfForce) else ""
    return f"{type(parameter).__qualname__} {place} {argument}"
