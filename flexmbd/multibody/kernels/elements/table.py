"""All kinds of force elements, and the kernels that choose among them, written from this table.

A row of ``Plan.elements`` says its kind by the place of the element here (``kind_of``).  To add an element: a file
beside this one, and a line in ELEMENTS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.bushing_wrench import BUSHING
from flexmbd.multibody.kernels.elements.characteristic import CHARACTERISTIC
from flexmbd.multibody.kernels.elements.distance_spring import DISTANCE_SPRING
from flexmbd.multibody.kernels.elements.element import (
    Behaviour,
    CoordinateLaw,
    ElementKind,
    FrameElement,
    GeneralisedForce,
)
from flexmbd.multibody.kernels.elements.frame_law import FRAME_LAW, STORING_FRAME_LAW
from flexmbd.multibody.kernels.elements.friction import FRICTION
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_F, GIVEN_IN_G
from flexmbd.multibody.kernels.elements.homogeneous_energy import HOMOGENEOUS_ENERGY
from flexmbd.multibody.kernels.elements.interior_wrench import INTERIOR_WRENCH
from flexmbd.multibody.kernels.elements.memory_law import ELASTOPLASTIC, ELASTOPLASTIC_LINE, MEMORY_LAW, MEMORY_LINE
from flexmbd.multibody.kernels.elements.modal_force import MODAL_FORCE
from flexmbd.multibody.kernels.elements.penalty import PENALTY
from flexmbd.multibody.kernels.elements.spring import SPRING
from flexmbd.multibody.kernels.elements.stop import STOP
from flexmbd.multibody.kernels.elements.user_law import USER_LAW
from flexmbd.multibody.kernels.elements.user_state_force import SOLVED_TOGETHER, STATE_FORCE

#: All kinds, in the order in which kernels ask for them.
ELEMENTS: tuple[ElementKind, ...] = (
    SPRING, CHARACTERISTIC, STOP, FRICTION,
    USER_LAW, ELASTOPLASTIC, MEMORY_LAW, MODAL_FORCE, STATE_FORCE, SOLVED_TOGETHER, HOMOGENEOUS_ENERGY,
    DISTANCE_SPRING, BUSHING, PENALTY, INTERIOR_WRENCH, GIVEN_IN_G, GIVEN_IN_F, FRAME_LAW, STORING_FRAME_LAW,
    ELASTOPLASTIC_LINE, MEMORY_LINE,
)  # fmt: skip


def kind_of(element: ElementKind) -> int:
    """The number of a kind in rows of ``Plan.elements``."""
    return ELEMENTS.index(element)


def behaviours(plan: Plan) -> list[Behaviour]:
    """What integrators must know of each element of a plan."""
    return [ELEMENTS[kind].behaviour for kind in plan.elements[:, at.EL_KIND]]


def stores(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan stores energy."""
    return np.array([ELEMENTS[kind].energy is not None for kind in plan.elements[:, at.EL_KIND]], bool)


def couple_all(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether the tangent of each element of a plan may join any two coordinates.

    Interiors' frames are joined by the stiffness of what lies between them, which is added as a whole.
    """
    kinds = (ELEMENTS[kind] for kind in plan.elements[:, at.EL_KIND])
    return np.array(
        [
            one is INTERIOR_WRENCH
            or (isinstance(one, GeneralisedForce) and one.subtract_tangent is not None and one.couples)
            for one in kinds
        ],
        bool,
    )


def act_between_frames(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan acts between two frames."""
    return np.array([isinstance(ELEMENTS[kind], FrameElement) for kind in plan.elements[:, at.EL_KIND]], bool)


def are_of(plan: Plan, element: ElementKind) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan is of a kind."""
    return np.asarray(plan.elements[:, at.EL_KIND] == kind_of(element))


# ------------------------------------------------------------------------------------------------ kernels, by the table

# Written as text, for numba neither loops over functions nor caches what is closed over them.
_FAMILIES: dict[str, type] = {"law": CoordinateLaw, "frames": FrameElement, "force": GeneralisedForce}


def _having(family: str, part: str) -> Iterator[tuple[str, str]]:
    """A condition on ``kind`` and the name of what it calls, for each different function that elements have there."""
    of_family = (one for one in ELEMENTS if isinstance(one, _FAMILIES[family]) and vars(one)[part] is not None)
    for function, alike in groupby(of_family, lambda one: vars(one)[part]):
        numbers = [kind_of(one) for one in alike]
        name = f"_{family}_{part}_{numbers[0]}"
        globals()[name] = function
        yield " or ".join(f"kind == {k}" for k in numbers), name


def _write(name: str, taken: str, family: str, part: str, *, nothing: str, returns: bool = True) -> str:
    """Text of a function that calls what the row's kind has for a part, and gives ``nothing`` where it has none."""
    lines = [f"def {name}({taken}):", f"    kind = row[{at.EL_KIND}]"]
    for condition, called in _having(family, part):
        lines += [f"    if {condition}:", f"        {'return ' if returns else ''}{called}({taken})"]
    return "\n".join([*lines, f"    return {nothing}" if returns else ""])


def _write_question(name: str, kinds: list[int]) -> str:
    """Text of a function that tells whether a kind is one of some."""
    return "\n".join([f"def {name}(kind):", f"    return {' or '.join(f'kind == {k}' for k in kinds)}"])


def _compiled(text: str, how: Callable[[Any], Any]) -> Any:
    """The function of a text, as if it stood in this file, whose sources numba's cache then asks for."""
    exec(compile(text, __file__, "exec"), globals())
    return how(globals()[text[4 : text.index("(")]])


_ON_FRAMES = "plan, work, row, d, R, rate, spin"
_VARIED = f"{_ON_FRAMES}, dd, dtheta, drate, dspin, step"
_TANGENT = "plan, work, tw, row, x, v, per_x, per_v, matrix"
_NO_WRENCH = "(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)"

#: Force on a coordinate x (rad or m) and its derivatives by x and its rate, of a row that ``is_coordinate_law``.
coordinate_law = _compiled(
    _write("coordinate_law", "plan, row, x, rate", "law", "law", nothing="0.0, 0.0, 0.0"), entry_kernel
)
coordinate_energy = _compiled(_write("coordinate_energy", "plan, row, x", "law", "energy", nothing="0.0"), kernel)
#: The piece of the law in which x lies, a number.
law_piece = _compiled(_write("law_piece", "plan, row, x", "law", "piece", nothing="0"), kernel)
#: Force on G at G's origin and torque on G, in F's axes, of a row that ``is_between_frames``.
element_wrench = _compiled(_write("element_wrench", _ON_FRAMES, "frames", "wrench", nothing=_NO_WRENCH), entry_kernel)
#: Its variation for d + dd, exp(dtheta) R, rate + drate, spin + dspin.
element_wrench_variation = _compiled(
    _write("element_wrench_variation", _VARIED, "frames", "variation", nothing=_NO_WRENCH), entry_kernel
)
frame_energy = _compiled(_write("frame_energy", _ON_FRAMES, "frames", "energy", nothing="0.0"), kernel)
#: Subtract generalised forces, of a row that is neither of the two.
subtract_force = _compiled(
    _write("subtract_force", "plan, work, row, x, v, out", "force", "subtract", nothing="", returns=False), kernel
)
subtract_force_tangent = _compiled(
    _write("subtract_force_tangent", _TANGENT, "force", "subtract_tangent", nothing="", returns=False), kernel
)
force_energy = _compiled(_write("force_energy", "plan, work, row, x", "force", "energy", nothing="0.0"), kernel)

#: Derivative of a force on a coordinate x by it, of a row that ``changes`` and is no coordinate law.
force_slope = _compiled(
    _write("force_slope", "plan, work, row, x, v, size", "force", "slope", nothing="0.0"), kernel
)
#: Whether a step that ends at (x, v) leads onto another piece of a law with memory.
force_changes_piece = _compiled(
    _write("force_changes_piece", "plan, work, row, x, v", "force", "changes_piece", nothing="False"), kernel
)

is_coordinate_law = _compiled(
    _write_question("is_coordinate_law", [kind_of(one) for one in ELEMENTS if isinstance(one, CoordinateLaw)]), kernel
)
is_between_frames = _compiled(
    _write_question("is_between_frames", [kind_of(one) for one in ELEMENTS if isinstance(one, FrameElement)]), kernel
)
#: Whether the stiffness on an element's coordinate may change on the way.
changes = _compiled(_write_question("changes", [kind_of(one) for one in ELEMENTS if one.behaviour.changing]), kernel)
#: Whether an element between frames stores energy.
stores_between_frames = _compiled(
    _write_question(
        "stores_between_frames",
        [kind_of(one) for one in ELEMENTS if isinstance(one, FrameElement) and one.energy is not None],
    ),
    kernel,
)
