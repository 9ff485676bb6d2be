"""A reduced body near rest as a unit: q'' + D q' + K q = B u, exact in co-simulation for inputs that are held."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.model_description import (
    Causality,
    Description,
    Fmi,
    Variable,
    identifier_of,
    model_description,
)
from flexmbd.export.functional_mockup.unit_build import (
    Target,
    build_description,
    c_array,
    compile_library,
    layer_sources,
    source,
    targets_of,
    zipped,
)
from flexmbd.export.loss import Capabilities, check_body, check_losses, checked_writer
from flexmbd.files.whole_file import write_file
from flexmbd.given import refuse_no_truth
from flexmbd.record.reduced_body import FRAME_DOFS, InterfaceFrame, ReducedBody

CAPABILITIES = Capabilities(large_motion=False, floating=False)

FloatArray = NDArray[np.float64]

_WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_RATES = ("vx", "vy", "vz", "wx", "wy", "wz")


@checked_writer
def fmu(
    body: ReducedBody,
    path: str | Path,
    *,
    fmi: Fmi | int = Fmi.V3,
    step: float = 1e-3,
    binary: bool = True,
    windows: bool = False,
    lossy: bool = False,
) -> tuple[str, ...]:
    """Write a body near rest, its frame B clamped, as an FMU for co-simulation and model exchange. Not collective.

    Inputs are the wrench on each interface but B's (``<interface>.Fx`` .. ``.Mz``, N and N m) and gravity
    (``gravity.gx`` .. ``.gz``, m/s^2); outputs each such interface's displacement and small rotation (``.x`` ..
    ``.rz``), their rates (``.vx`` .. ``.wz``), and the wrench that holds B (``<interface of B>.reaction_Fx`` ..
    ``_Mz``); the parameter ``damping_ratio`` is added to each mode's. All are in B's axes. The body starts at rest:
    undeformed, or with the share ``static_start`` of its static response to the start values of the inputs, in
    equilibrium where that is 1. Its continuous states are the modal coordinates and their rates.

    Args:
        body: its frame sits on an interface.
        path: destination; the file name's stem is the model's name.
        fmi: version of the interface, 2 or 3.
        step: communication step that is proposed to importers (s); any other is as exact.
        binary: compile with gcc for this computer; else the sources alone.
        windows: compile for 64-bit Windows as well, with mingw-w64.
        lossy: as of all formats.

    Returns:
        The parts that are not in the file.

    Raises:
        ExportError: a body whose frame floats or that does not deform; names that FMI does not carry; no compiler; the
            destination cannot be written.
    """
    check_body(body)
    version = version_of(fmi)
    refuse_no_truth(ExportError, binary=binary, windows=windows)
    if not (np.isfinite(step) and step > 0.0):
        raise ExportError(f"step is {step} s, the step that is proposed to an importer; it must be positive and finite")
    if body.frame is None or body.n_modes == 0:
        raise ExportError(
            "an FMU of a body holds its frame B fast, and this body's frame floats: reduce it with frame=<interface>"
            if body.n_modes
            else "an FMU of a body holds its frame B fast, and this body does not deform: it would do nothing"
        )
    lost = check_losses(body, CAPABILITIES, kind="FMU", lossy=lossy)
    without = "; or write the sources alone, binary=False, to be compiled elsewhere"
    targets = targets_of(version, windows=windows, binary=binary, otherwise=without)
    variables = _variables(body)
    data = _data(body, variables)
    token = token_of(version, data, variables)
    files = {
        **layer_sources(version),
        "linear_body.c": source("linear_body.c"),
        "linear_body.h": source("linear_body.h"),
        "data.c": (data + f'const char model_token[] = "{token}";\n').encode(),
    }
    name = Path(path).stem
    text = f"Reduced elastic body, small motions about rest, held at {body.frame}"
    unit = Description(name, identifier_of(name), token, text, variables, step)
    write_file(path, zipped(unit_members(unit, version, files, {one: compile_library(files, one) for one in targets})))
    return lost


def version_of(fmi: Fmi | int) -> Fmi:
    """The version asked for.

    Raises:
        ExportError: it is not written.
    """
    if fmi not in tuple(Fmi):
        raise ExportError(f"fmi is {fmi!r}; versions 2 and 3 of the interface are written")
    return Fmi(fmi)


def token_of(version: Fmi, data: str, variables: tuple[Variable, ...]) -> str:
    """A token that changes with the content and with nothing else."""
    digest = hashlib.sha256(f"{version!r}{variables!r}{data}".encode()).digest()
    return f"{{{uuid.UUID(bytes=digest[:16])}}}"


def unit_members(
    unit: Description, version: Fmi, files: dict[str, bytes], libraries: Mapping[Target, bytes]
) -> dict[str, bytes]:
    """The archive's members by name: the description, binaries, and sources where there are any."""
    sources = sorted(name for name in files if name.endswith(".c"))
    members = {"modelDescription.xml": model_description(unit, version, sources=sources)}
    members |= {target.member(version, unit.identifier): content for target, content in libraries.items()}
    if version is Fmi.V3 and files:
        members["sources/buildDescription.xml"] = build_description(unit.identifier, sources)
    return members | {f"sources/{name}": files[name] for name in sorted(files)}


def _moving(body: ReducedBody) -> list[InterfaceFrame]:
    return [frame for frame in body.interfaces if frame.name != body.frame]


def _variables(body: ReducedBody) -> tuple[Variable, ...]:
    moving = _moving(body)
    inputs, places, rates = [], [], []
    for frame in moving:
        for k in range(6):
            what = "force" if k < 3 else "moment"
            text = f"{what} on {frame.name} along {'xyz'[k % 3]} of B"
            inputs.append(Variable(f"{frame.name}.{_WRENCH[k]}", Causality.INPUT, "N" if k < 3 else "N.m", text))
            what = "displacement" if k < 3 else "rotation"
            text = f"{what} of {frame.name} along {'xyz'[k % 3]} of B"
            unit = "m" if k < 3 else "rad"
            name = f"{frame.name}.{FRAME_DOFS[k]}"
            places.append(Variable(name, Causality.OUTPUT, unit, text, direct=False))
            name = f"{frame.name}.{_RATES[k]}"
            rates.append(Variable(name, Causality.OUTPUT, f"{unit}/s", f"rate of the {text}", direct=False))
    gravity = [Variable(f"gravity.g{a}", Causality.INPUT, "m/s2", f"gravity along {a} of B") for a in "xyz"]
    ratio = Variable("damping_ratio", Causality.PARAMETER, "1", "added to the damping ratio of each mode")
    reactions = [
        Variable(
            f"{body.frame}.reaction_{name}",
            Causality.OUTPUT,
            "N" if k < 3 else "N.m",
            f"{'force' if k < 3 else 'moment'} that holds {body.frame}, along {'xyz'[k % 3]} of B",
        )
        for k, name in enumerate(_WRENCH)
    ]
    static = Variable(
        "static_start", Causality.PARAMETER, "1", "share of the static response to the inputs that the body starts with"
    )
    return (*inputs, *gravity, ratio, static, *places, *rates, *reactions, *_states(body))


def _states(body: ReducedBody) -> list[Variable]:
    """Modal coordinates, their rates, and the derivatives of both.

    Nominal is what the largest modal weight would bend each mode by, and its rate where it vibrates so.
    """
    local, n = Causality.LOCAL, body.n_modes
    names = [f"mode_{k + 1}" for k in range(n)]
    weight = 9.81 * np.abs(body.mass_matrix()[6:, :3]).max()
    bent = weight / body.stiffness if weight > 0.0 else np.ones(n)
    faster = bent * np.sqrt(body.stiffness)
    states = [
        Variable(name, local, "1", "modal coordinate, kg^(1/2) m", nominal=size)
        for name, size in zip(names, bent, strict=True)
    ]
    states += [
        Variable(f"{name}.rate", local, "1/s", "rate of a modal coordinate", nominal=size)
        for name, size in zip(names, faster, strict=True)
    ]
    units = ["1/s"] * n + ["1/s2"] * n
    return states + [
        Variable(f"der({one.name})", local, unit, f"derivative of {one.name}", derivative_of=one.name)
        for one, unit in zip(states, units, strict=True)
    ]


def _data(body: ReducedBody, variables: tuple[Variable, ...]) -> str:
    """The matrices of linear_body.h and the numbers of model.h as C."""
    n = body.n_modes
    frames = np.vstack([np.zeros((0, n)), *(frame.modes for frame in _moving(body))])
    mass = body.mass_matrix()
    coupled = bool(np.any(body.damping - np.diag(np.diag(body.damping))))
    forces = np.hstack([frames.T, mass[6:, :3]])
    counts = {causality: sum(one.causality is causality for one in variables) for causality in Causality}
    # q and its rate; the step, the ratio, the propagators, two matrices, a vector twice
    entries = 4 * n * n if coupled else 4
    scratch = 2 + (1 if coupled else n) * entries + 2 * entries + 2 * (2 * n if coupled else 2)
    starts = [one.start for one in variables if one.causality in (Causality.INPUT, Causality.PARAMETER)]
    return (
        '#include "linear_body.h"\n#include "model.h"\n\n'
        f"const size_t model_inputs = {counts[Causality.INPUT]};\n"
        f"const size_t model_parameters = {counts[Causality.PARAMETER]};\n"
        f"const size_t model_outputs = {counts[Causality.OUTPUT]};\n"
        f"const size_t model_states = {2 * n};\n"
        f"const size_t model_memory = {2 * n} * sizeof(double);\n"
        f"const size_t model_scratch = {scratch} * sizeof(double);\n"
        f"const size_t body_modes = {n};\nconst size_t body_frame_rows = {len(frames)};\n"
        f"const int body_coupled = {int(coupled)};\n"
        + c_array("model_start", starts)
        + c_array("model_nominal", [one.nominal for one in variables if one.nominal is not None])
        + c_array("body_stiffness", body.stiffness)
        + c_array("body_damping", body.damping.ravel())
        + c_array("body_input", forces.ravel())
        + c_array("body_frames", frames.ravel())
        + c_array("body_inertia", mass[:6, 6:].ravel())
        + c_array("body_applied", _applied(body).ravel())
    )


def _applied(body: ReducedBody) -> FloatArray:
    """(6, inputs) force and moment about B's origin of the undeformed body, per unit of an input."""
    columns = []
    for frame in _moving(body):
        wrench = np.eye(6)
        wrench[3:, :3] = np.cross(frame.p_BI_B, np.eye(3)).T
        columns.append(wrench)
    return np.hstack([*columns, body.mass_matrix()[:6, :3]])
