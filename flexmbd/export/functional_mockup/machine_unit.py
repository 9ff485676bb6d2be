"""A whole machine as a unit for co-simulation: its compiled kernels step it, linked into a C library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.files import write_file
from flexmbd.export.functional_mockup.building import compile_library, layer_sources, source, zipped
from flexmbd.export.functional_mockup.description import Description, Fmi, identifier_of
from flexmbd.export.functional_mockup.kernel_code import Kernel, Memory, c_call, kernel_for, lay_out, object_code
from flexmbd.export.functional_mockup.machine_parts import Parts, parts_of, refuse_functions
from flexmbd.export.functional_mockup.machine_ports import (
    Drive,
    Given,
    Observed,
    drives_of,
    named,
    observed_by,
    replaced,
)
from flexmbd.export.functional_mockup.reduced_unit import token_of, unit_members, version_of
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit_runge_kutta import ExplicitRungeKutta, advance
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import announce, mark_compiled
from flexmbd.multibody.kernels.layout import Plan
from flexmbd.multibody.kernels.series import frame_series
from flexmbd.multibody.output import Output
from flexmbd.system import System

_EXPORTS = b"{ global: fmi2*; fmi3*; local: *; };\n"


def fmu_machine(
    scene: System,
    path: str | Path,
    *,
    h: float,
    inputs: Sequence[Given] | Mapping[str, Given] = (),
    outputs: Sequence[Output] | Mapping[str, Output] = (),
    method: ExplicitRungeKutta | None = None,
    fmi: Fmi | int = Fmi.V3,
    step: float | None = None,
) -> None:
    """Write a whole machine as an FMU for co-simulation, whose host needs no Python. Not collective.

    It moves as ``scene.simulate(..., h=h, integrator=method)`` does, with its inputs held from one communication point
    to the next. The machine's kernels are compiled for any processor of this architecture.

    Args:
        scene: bodies, joints and forces but for bodies with history and users' functions.
        path: destination; the file name's stem is the model's name.
        h: longest step of the integrator (s): it divides each communication step by the next whole number.
        inputs: given forces, in the scene or not, in whose places the inputs act: ``<joint>.torque`` (N m) of a
            JointTorque, ``<joint>.force`` (N) of a JointForce, ``<frame>.Fx`` .. ``.Mz`` of a FrameForce,
            ``<body>.<load>`` of a DistributedLoad. Their numbers are the start values. A mapping gives them other
            names: that of a frame's or body's, or all of a joint's.
        outputs: places are absolute, in inertial axes: of a frame ``.x`` .. ``.z`` (m), ``.vx`` .. , ``.ax`` .. , and
            of a Rotation its matrix R_WF, ``.Rxx``, ``.Rxy`` .. ``.Rzz``; of a joint or a flexible body its
            coordinates by their names, with ``.rate`` and ``.acceleration``. A mapping gives other names, alike.
        method: pair of formulas and way to turn, by default those of ExplicitRungeKutta.
        fmi: version of the interface, 2 or 3.
        step: communication step that is proposed to importers (s), by default ten of the integrator's.

    Raises:
        ExportError: a body with history, or a function that is no number, table or sine; an input or output that does
            not fit; names that FMI does not carry; no gcc; the destination cannot be written.
        SceneError, AssemblyError: as `System.start`.
    """
    version = version_of(fmi, binary=True)
    method = method or ExplicitRungeKutta()
    step = 10.0 * h if step is None else step
    if not (np.isfinite([h, step]).all() and h > 0.0 and step > 0.0):
        raise ExportError(f"h is {h} s and step {step} s; both must be positive and finite")
    forces = [(name, replaced(one)) for name, one in named(inputs)]
    start = scene.start_with([force for _, force in forces], instead_of=[force for _, force in named(inputs)])
    refuse_functions(start.scene)
    drives = [drive for name, one in forces for drive in drives_of(start.scene, one, name)]
    parts = parts_of(start, method, h)
    observed = [one for name, output in named(outputs) for one in observed_by(start.scene, output, name, parts)]
    variables = (*(drive.variable for drive in drives), *(one.variable for one in observed))
    memory = lay_out([parts.advance, *(frame.arguments for frame in parts.frames)])
    announce(type(method).__name__)
    kernels = [kernel_for(advance, parts.advance)]
    mark_compiled(type(method).__name__)
    if parts.frames:
        kernels.append(kernel_for(frame_series, parts.frames[0].arguments))
    data = _data(parts, memory, kernels, drives, observed, h)
    token = token_of(version, data + sha256(memory.image).hexdigest(), variables)
    objects = {f"kernel{k}.o": object_code(kernel) for k, kernel in enumerate(kernels)}
    files = {
        **layer_sources(version),
        "machine.c": source("machine.c"),
        "machine.h": source("machine.h"),
        "data.c": (data + f'const char model_token[] = "{token}";\n').encode(),
        "image.bin": memory.image,
        "exports.map": _EXPORTS,
    }
    name = Path(path).stem
    text = f"Multibody machine, {method.name}, steps of at most {h:g} s"
    unit = Description(name, identifier_of(name), token, text, variables, step, inner_step=h)
    library = compile_library(files | objects, link=(*objects, "-Wl,--version-script=exports.map"))
    write_file(path, zipped(unit_members(unit, version, {}, library)))


def _data(
    parts: Parts, memory: Memory, kernels: Sequence[Kernel], drives: Sequence[Drive],
    observed: Sequence[Observed], h: float,
) -> str:  # fmt: skip
    """The numbers of model.h and machine.h, and the calls of the kernels, as C."""
    plan, state = parts.plan, parts.state
    starts = ", ".join(repr(drive.variable.start) for drive in drives) or "0.0"
    places_in = ", ".join(str(memory.place(plan.time_data, drive.offset)) for drive in drives) or "0"
    places_out = ", ".join(str(memory.place(one.array, one.index)) for one in observed) or "0"
    follows = _follows_time(plan, drives)
    entries = f"{st.TIME}, machine_time_end = {st.TIME_END}, machine_step_size = {st.STEP}"
    calls = [c_call(kernels[0], parts.advance, memory, name="run")]
    calls += [c_call(kernels[1], one.arguments, memory, name=f"frame{k}") for k, one in enumerate(parts.frames)]
    frames = "".join(f"    failed |= frame{k}(m, &nothing);\n" for k in range(len(parts.frames)))
    return (
        '#include "machine.h"\n#include "model.h"\n\n'
        '__asm__(".section .rodata\\n.balign 64\\n.globl machine_image\\nmachine_image: .incbin \\"image.bin\\"\\n'
        '.previous\\n");\n\n'
        f"const size_t model_inputs = {len(drives)};\nconst size_t model_parameters = 0;\n"
        f"const size_t model_outputs = {len(observed)};\nconst size_t model_memory = {len(memory.image)};\n"
        f"const size_t model_scratch = 0;\nconst double model_start[] = {{{starts}}};\n"
        f"const double machine_start_time = 0.0;\nconst int machine_follows_time = {int(follows)};\n"
        f"const double machine_step = {float(h)!r};\n"
        f"const size_t machine_numbers = {memory.place(state.numbers)};\n"
        f"const size_t machine_counts = {memory.place(state.counts)};\n"
        f"const size_t machine_flag = {memory.place(plan.flag)};\n"
        f"const size_t machine_input_places[] = {{{places_in}}};\n"
        f"const size_t machine_output_places[] = {{{places_out}}};\n"
        f"const int machine_time = {entries}, machine_stored = {st.STORED};\n"
        f"const int machine_done = {st.DONE}, machine_output = {st.OUTPUT};\n\n"
        + "".join(calls)
        + "int64_t machine_run(unsigned char *m) {\n    int64_t code = -1;\n"
        "    return run(m, &code) == 0 ? code : -1;\n}\n\n"
        "int machine_frames(unsigned char *m) {\n    void *nothing = 0;\n    int failed = 0;\n    (void)m;\n"
        f"{frames}    (void)nothing;\n    return failed ? -1 : 0;\n}}\n"
    )


def _follows_time(plan: Plan, drives: Sequence[Drive]) -> bool:
    """Whether anything but the inputs changes with time."""
    offsets = {drive.offset - 3 for drive in drives}
    for row in plan.times:
        offset = int(row[at.TIME_OFFSET])
        constant = row[at.TIME_KIND] == at.TIME_PIECEWISE and row[at.TIME_COUNT] == 1 and plan.time_data[offset] == 1.0
        if not constant and offset not in offsets:
            return True
    return False
