"""A whole machine as a unit for co-simulation: its compiled kernels step it, linked into a C library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from types import NoneType

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.kernel_code import SYMBOLS, MemoryImage, bind_deferred, c_call, c_names, lay_out
from flexmbd.export.functional_mockup.machine_build import kernel_sources, linked
from flexmbd.export.functional_mockup.machine_parts import (
    Method,
    Parts,
    parts_of,
    refuse_functions,
    refuse_unstable_step,
    with_tangents,
)
from flexmbd.export.functional_mockup.machine_ports import (
    Drive,
    Given,
    ObservedVariable,
    driven,
    drives_of,
    named,
    observed_by,
    replaced,
    states_of,
)
from flexmbd.export.functional_mockup.model_description import Description, Fmi, identifier_of
from flexmbd.export.functional_mockup.reduced_unit import token_of, unit_members, version_of
from flexmbd.export.functional_mockup.unit_build import (
    c_array,
    layer_sources,
    processor,
    source,
    targets_of,
    zipped,
)
from flexmbd.files.whole_file import write_file
from flexmbd.given import checked, refuse_no_truth, refuse_other
from flexmbd.integrate import state as st
from flexmbd.integrate.automatic import check_method
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta
from flexmbd.machine.system import System
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.port import Port, PortFlow
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import announce_compilation, mark_compiled
from flexmbd.multibody.kernels.base.object_code import KernelProgram, deferred_kernels, kernel_for
from flexmbd.multibody.kernels.reading.force_tables import constant_place, is_constant
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.motion.quantity import Acceleration, Output


@checked(but=("inputs", "outputs", "integrator", "fmi"), error=ExportError)
def fmu_machine(
    scene: System,
    path: str | Path,
    *,
    h: float,
    inputs: Sequence[Given | Port] | Mapping[str, Given | Port] = (),
    outputs: Sequence[Output | PortFlow] | Mapping[str, Output | PortFlow] = (),
    integrator: Method | None = None,
    fmi: Fmi | int = Fmi.V3,
    step: float | None = None,
    windows: bool = False,
    about: WorkingPoint | None = None,
    model_exchange: bool = False,
    binary: bool = True,
    sources: bool = False,
) -> None:
    """Write a whole machine as an FMU for co-simulation, whose host needs no Python. Not collective.

    It moves as ``scene.simulate(..., h=h, integrator=integrator)`` does, begun anew where inputs jump; they are held
    from one communication point to the next. Steps end at breaks of
    tables as they do there; where the rate of a prescribed motion jumps the unit stops with an error, for its impulse
    is not among the kernels. The machine's kernels are compiled for any processor of this architecture.

    Args:
        scene: bodies, joints and forces but for bodies with history and users' functions.
        path: destination; the file name's stem is the model's name.
        h: longest step of the integrator (s): it divides each communication step by the next whole number.
        inputs: given forces, in the scene or not, in whose places the inputs act: ``<joint>.torque`` (N m) of a
            JointTorque, ``<joint>.force`` (N) of a JointForce, ``<frame>.Fx`` .. ``.Mz`` of a FrameForce,
            ``<body>.<load>`` of a DistributedLoad, ``<body>.<port>.voltage`` (V) of a port (``body.port("top")``) of a
            flexible body. Their numbers are the start values. A mapping gives them other
            names: that of a frame's or body's, or all of a joint's.
        outputs: places are absolute, in inertial axes: of a frame ``.x`` .. ``.z`` (m), ``.vx`` .. , ``.ax`` .. , and
            of a Rotation its matrix R_WF, ``.Rxx``, ``.Rxy`` .. ``.Rzz``; of a joint or a flexible body its
            coordinates by their names, with ``.rate`` and ``.acceleration``; of ``port.charge`` the charge (C) of
            the machine, but for model exchange. A mapping gives other names: to these of a
            frame what stands before ``.x``, to those of a joint or body the whole, with ``.1``, ``.2`` of several.
        integrator: ExplicitRungeKutta, by default, or GeneralizedAlpha for stiff machines.
        fmi: version of the interface, 2 or 3.
        step: communication step that is proposed to importers (s), by default ten of the integrator's.
        windows: compile for 64-bit Windows as well, with mingw-w64.
        about: where to begin, of ``scene.equilibrium()``, instead of the initial values given. It is an
            equilibrium with the forces that the scene holds, and for as long as inputs keep their start values.
        binary: compile with gcc for this computer; else the sources alone.
        sources: put C99 of all of it into the unit as well, kernels included, some megabytes; always where there is
            no binary.
        model_exchange: for model exchange as well: its states are the joint and modal coordinates and velocities,
            ``state.<coordinate>`` and ``state.<coordinate>.rate``, with exact directional derivatives of all but
            accelerations of frames. Of machines without loops, quaternions, prescribed motions, memories and jumps.

    Raises:
        ExportError: a body with history, or a function that is not a number, table or sine; an input or output that
            does not fit; names that FMI does not carry; no compiler; a kernel that has no C; the destination cannot be
            written.
        SceneError, AssemblyError: as `System.start`; h is beyond the stability of explicit steps.
    """
    version = version_of(fmi)
    integrator = integrator or ExplicitRungeKutta()
    if not isinstance(integrator, Method):
        raise ExportError(f"machines are exported with ExplicitRungeKutta or GeneralizedAlpha, not with {integrator!r}")
    step = 10.0 * h if step is None else step
    if not (np.isfinite([h, step]).all() and h > 0.0 and step > 0.0):
        raise ExportError(f"h is {h} s and step {step} s; both must be positive and finite")
    refuse_no_truth(ExportError, windows=windows, model_exchange=model_exchange, binary=binary, sources=sources)
    refuse_other(about, (WorkingPoint, NoneType), "about", wanted="what scene.equilibrium() gives")
    without = "; or write the sources alone, binary=False, to be compiled elsewhere"
    targets = targets_of(version, windows=windows, binary=binary, otherwise=without)
    if windows and processor() != "x86_64":
        raise ExportError(
            "machines are exported for Windows from x86_64 alone, for which their kernels are compiled; this is "
            f"{processor()}"
        )
    forces: list[tuple[str | None, Given | Port]] = [
        (name, one if isinstance(one, Port) else replaced(one)) for name, one in named(inputs)
    ]
    if model_exchange and any(isinstance(one, PortFlow) for _, one in named(outputs)):
        raise ExportError("charges are no outputs of model exchange: leave them out, or model_exchange")
    given = [force for _, force in named(inputs) if not isinstance(force, Port)]
    acting = [force for _, force in forces if not isinstance(force, Port)]
    with driven([one for _, one in forces if isinstance(one, Port)]):
        start = scene.start_with(acting, instead_of=given, about=about)
    refuse_functions(start.scene)
    check_method(integrator, start.scene)
    drives = [drive for name, one in forces for drive in drives_of(start.scene, one, name)]
    parts = parts_of(start, integrator, h)
    parts = with_tangents(parts, start.scene) if model_exchange else parts
    observed = [one for name, output in named(outputs) for one in observed_by(start.scene, output, name, parts)]
    states = states_of(start.scene) if model_exchange else ()
    refuse_unstable_step(start, integrator, h)
    variables = (*(drive.variable for drive in drives), *(one.variable for one in observed), *states)
    further = [one.call.arguments for one in parts.frames]
    further += [one.arguments for one in (*parts.flows, *parts.tangents)]
    memory = lay_out([parts.run.arguments, parts.refresh.arguments, *further])
    announce_compilation(type(integrator).__name__)
    code = _compiled(parts)
    mark_compiled(type(integrator).__name__)
    nominal = [one.nominal for one in states if one.nominal is not None]
    deferred = deferred_kernels(code.values())
    kernels = tuple({one.symbol: one for one in (*code.values(), *deferred.values())}.values())
    names = c_names(kernels)
    data = _data(parts, memory, code, names, drives, observed, h) + c_array("model_nominal", nominal)
    token = token_of(version, data + sha256(memory.image).hexdigest(), variables)
    files = {
        **layer_sources(version),
        **{one: source(one) for one in ("machine.c", "machine_exchange.c", "machine.h", "lapack.c", "lapack.h")},
        "data.c": (data + f'const char model_token[] = "{token}";\n').encode(),
        "deferred.c": bind_deferred(deferred, names).encode(),
    }
    written = {**files, **kernel_sources(kernels, names, memory)} if sources or not targets else {}
    name = Path(path).stem
    text = f"Multibody machine, {integrator.name}, steps of at most {h:g} s"
    exact = not any(isinstance(one, Acceleration) and isinstance(one.of, Frame) for _, one in named(outputs))
    unit = Description(name, identifier_of(name), token, text, variables, step, inner_step=h, differentiable=exact)
    libraries = {one: linked(files, kernels, memory, one) for one in targets}
    write_file(path, zipped(unit_members(unit, version, written, libraries)))


def _compiled(parts: Parts) -> dict[str, KernelProgram]:
    """The kernels of all calls, by what the calls are named."""
    calls = {"run": parts.run, "refresh": parts.refresh}
    calls |= {f"frame{k}": one.call for k, one in enumerate(parts.frames)}
    calls |= {f"flow{k}": call for k, call in enumerate(parts.flows)}
    calls |= {f"tangent{k}": call for k, call in enumerate(parts.tangents)}
    calls |= {f"behind{k}": call for k, (_, call) in enumerate(parts.behind)}
    return {name: kernel_for(call.kernel, call.arguments) for name, call in calls.items()}


def _data(
    parts: Parts, memory: MemoryImage, code: Mapping[str, KernelProgram], names: Mapping[str, str],
    drives: Sequence[Drive], observed: Sequence[ObservedVariable], h: float,
) -> str:  # fmt: skip
    """The numbers of model.h and machine.h, and the calls of the kernels, as C."""
    plan, state = parts.plan, parts.state
    breaks = ", ".join(repr(float(t)) for t in parts.breaks) or "0.0"
    impulses = ", ".join(repr(float(t)) for t in parts.impulses) or "0.0"
    starts = ", ".join(repr(drive.variable.start) for drive in drives) or "0.0"
    places_in = ", ".join(str(memory.place(plan.time_data, drive.offset)) for drive in drives) or "0"
    places_out = ", ".join(str(memory.place(one.array, one.index)) for one in observed) or "0"
    own = [(memory.place(part), part.nbytes) for part in parts.memory if part.size]
    histories = [memory.place(part) for part in parts.histories if part.size]
    matrices = [memory.place(one.arguments[-1]) for one in parts.tangents] or [0, 0, 0]
    rows = [memory.place(one.call.arguments[-1]) for one in parts.frames]
    sizes = {
        "model_inputs": len(drives),
        "model_parameters": 0,
        "model_outputs": len(observed),
        "model_memory": len(memory.image),
        "model_scratch": 0,
        "machine_numbers": memory.place(state.numbers),
        "machine_counts": memory.place(state.counts),
        "machine_accelerations": memory.place(state.a),
        "machine_velocities": len(state.v),
        "model_states": 2 * len(state.v) if parts.tangents else 0,
        "machine_x": memory.place(state.x),
        "machine_v": memory.place(state.v),
        "machine_mass": matrices[0],
        "machine_damping": matrices[1],
        "machine_stiffness": matrices[2],
        "machine_frame_rows": len(rows),
        "machine_own_arrays": len(own),
        "machine_histories": len(histories),
        "machine_breaks": len(parts.breaks),
        "machine_impulses": len(parts.impulses),
    }
    entries = {
        "machine_follows_time": int(_follows_time(plan, drives)),
        "machine_number_entries": st.N_NUMBER,
        "machine_count_entries": st.N_COUNT,
        "machine_time": st.TIME,
        "machine_time_end": st.TIME_END,
        "machine_step_size": st.STEP,
        "machine_stored": st.STORED,
        "machine_latest": st.LATEST,
        "machine_rest": st.STEP_REMAINDER,
        "machine_full": st.OUTPUT,
    }
    return (
        f'#include "{SYMBOLS}"\n#include "lapack.h"\n#include "machine.h"\n#include "model.h"\n\n'
        "#define WORD(address) ((uint64_t)(uintptr_t)(address))\n#define AT(word) ((void *)(uintptr_t)(word))\n\n"
        + "".join(f"const size_t {name} = {value};\n" for name, value in sizes.items())
        + "".join(f"const int {name} = {value};\n" for name, value in entries.items())
        + f"const double model_start[] = {{{starts}}};\n"
        f"const double machine_start_time = 0.0;\nconst double machine_step = {float(h)!r};\n"
        f"const size_t machine_own_places[] = {{{', '.join(str(place) for place, _ in own) or '0'}}};\n"
        f"const size_t machine_own_sizes[] = {{{', '.join(str(size) for _, size in own) or '0'}}};\n"
        f"const size_t machine_history_places[] = {{{', '.join(map(str, histories)) or '0'}}};\n"
        f"const double machine_break_times[] = {{{breaks}}};\n"
        f"const double machine_impulse_times[] = {{{impulses}}};\n"
        f"const size_t machine_input_places[] = {{{places_in}}};\n"
        f"const size_t machine_output_places[] = {{{places_out}}};\n"
        f"const size_t machine_frame_places[] = {{{', '.join(map(str, rows)) or '0'}}};\n\n"
        + _calls(parts, memory, code, names)
    )


def _calls(parts: Parts, memory: MemoryImage, code: Mapping[str, KernelProgram], names: Mapping[str, str]) -> str:
    """The functions of machine.h as C."""
    calls = [("run", parts.run), ("refresh", parts.refresh)]
    calls += [(f"frame{k}", one.call) for k, one in enumerate(parts.frames)]
    calls += [(f"flow{k}", one) for k, one in enumerate(parts.flows)]
    calls += [(f"tangent{k}", one) for k, one in enumerate(parts.tangents)]
    symbols = {name: one.symbol for name, one in code.items()}
    text = "".join(
        c_call(names[symbols[name]], symbols[name], call.arguments, memory, name=name) for name, call in calls
    )
    for name in ("run", "refresh"):
        text += (
            f"int64_t machine_{name}(unsigned char *m) {{\n    int64_t code = -1;\n"
            f"    return {name}(m, &code) == 0 ? code : -1;\n}}\n\n"
        )
    outputs = [*(f"frame{k}" for k in range(len(parts.frames))), *(f"flow{k}" for k in range(len(parts.flows)))]
    for name, called in (("frame", outputs), ("tangent", [f"tangent{k}" for k in range(len(parts.tangents))])):
        several = "".join(f"    failed |= {one}(m, &nothing);\n" for one in called)
        text += (
            f"int machine_{name}s(unsigned char *m) {{\n    void *nothing = 0;\n    int failed = 0;\n    (void)m;\n"
            f"{several}    (void)nothing;\n    return failed ? -1 : 0;\n}}\n\n"
        )
    text += _LAPACK
    addresses = {memory.place(parts.plan.lapack, k): name for k, name in enumerate(("factor", "solve"))}
    for k, (array, _) in enumerate(parts.behind):
        symbol = symbols[f"behind{k}"]
        text += f'extern void {names[symbol]}(void) SYMBOL("{symbol}");\n'
        addresses[memory.place(array)] = names[symbol]
    lines = "".join(f"    *(uint64_t *)(m + {place}) = WORD(&{name});\n" for place, name in addresses.items())
    return text + f"\nvoid machine_bind(unsigned char *m) {{\n{lines}}}\n"


#: LAPACK as kernels call it.
_LAPACK = """static void factor(uint64_t rows, uint64_t columns, uint64_t a, uint64_t lda, uint64_t pivot,
                   uint64_t info) {
    machine_dgetrf(AT(rows), AT(columns), AT(a), AT(lda), AT(pivot), AT(info));
}

static void solve(uint64_t transposed, uint64_t size, uint64_t sides, uint64_t a, uint64_t lda, uint64_t pivot,
                  uint64_t b, uint64_t ldb, uint64_t info) {
    machine_dgetrs(AT(transposed), AT(size), AT(sides), AT(a), AT(lda), AT(pivot), AT(b), AT(ldb), AT(info));
}

"""


def _follows_time(plan: Plan, drives: Sequence[Drive]) -> bool:
    """Whether anything but the inputs changes with time."""
    places = {drive.offset for drive in drives}
    for time in range(len(plan.times)):
        if not is_constant(plan, time) and constant_place(plan, time) not in places:
            return True
    return False
