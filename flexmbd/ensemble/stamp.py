"""The digest of an ensemble's machine, outputs and options: an interrupted one goes on only by the same."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path

from flexmbd.ensemble.sampled import Sampled
from flexmbd.ensemble.variants import VariantOutput
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
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


def study_digest(
    scene: CompiledScene,
    machine: tuple[str, str],
    parameters: Mapping[str, Sequence[Parameter]],
    samples: str,
    options: tuple[object, ...],
    outputs: Mapping[str, VariantOutput],
) -> str:
    """Tells an ensemble from others: hexadecimal digest of its program, machine, samples, options and outputs.

    Args:
        scene: of the machine as it is compiled.
        machine: its digest, and its controllers'.
        parameters: what each name means.
        samples: digest of the values.
        options: of the runs.
        outputs: what is asked of each variant.
    """
    asked = [
        f"{name} {ask.meaning(scene) if isinstance(ask, Sampled) else fingerprint(ask)}"
        for name, ask in outputs.items()
    ]
    named = [(name, [meaning(one, scene) for one in of]) for name, of in parameters.items()]
    told_apart = (program_stamp(), machine, samples, options, asked, named)
    return hashlib.sha256(repr(told_apart).encode()).hexdigest()
