"""Faults of a record: shapes that differ, numbers that are not finite, negative energies.

Asked whenever a record is made, by whoever: a reduction, an import, a file.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from flexmbd.record.group_faults import group_faults
from flexmbd.record.groups import GROUPS, FloatArray, InterfaceFrame, NonlinearStiffness, StressModes
from flexmbd.round_off import SEVEN_DIGITS, of_solver

# Of a mode's mass what solvers leave beside others that are a million times as stiff.
_UNIT_MASS = 1e-4


class _RecordParts(Protocol):
    """What is looked at of a `ReducedBody`, whose constructor asks."""

    @property
    def gram(self) -> FloatArray: ...
    @property
    def damping(self) -> FloatArray: ...
    @property
    def partition(self) -> FloatArray: ...
    @property
    def p_MB_M(self) -> FloatArray: ...
    @property
    def R_MB(self) -> FloatArray: ...
    @property
    def stiffness(self) -> FloatArray: ...
    @property
    def partition_names(self) -> tuple[str, ...]: ...
    @property
    def interfaces(self) -> tuple[InterfaceFrame, ...]: ...
    @property
    def frame(self) -> str | None: ...
    @property
    def nonlinear(self) -> NonlinearStiffness | None: ...
    @property
    def stress(self) -> StressModes | None: ...
    @property
    def n_modes(self) -> int: ...
    @property
    def mass(self) -> float: ...
    def mass_matrix(self) -> FloatArray: ...


def record_faults(record: _RecordParts) -> Iterator[str]:
    """The faults of a record, a line each."""
    faults = [*_array_faults(record), *_frame_array_faults(record)]
    yield from faults
    if not faults:  # of arrays that are as they should be, what they say
        yield from _mass_faults(record)
        yield from _deformation_faults(record)
        yield from _place_faults(record)
    if len(record.partition_names) != record.n_modes:
        yield f"{len(record.partition_names)} partition names for {record.n_modes} modes"
    names = [frame.name for frame in record.interfaces]
    if len(set(names)) != len(names):
        yield f"two interfaces share a name: {names}"
    if record.frame is not None and record.frame not in names:
        yield f"the body frame's interface {record.frame!r} is not among {names}"
    for attribute in GROUPS:
        group = getattr(record, attribute)
        if group is not None:
            yield from group_faults(group, n=record.n_modes)
    yield from _nonlinear_faults(record)


def _array_faults(record: _RecordParts) -> Iterator[str]:
    n = record.n_modes
    shapes = {
        "gram": (4 + 3 * n, 4 + 3 * n),
        "stiffness": (n,),
        "damping": (n, n),
        "partition": (n, n),
        "p_MB_M": (3,),
        "R_MB": (3, 3),
    }
    for item, shape in shapes.items():
        array = getattr(record, item)
        if array.shape != shape:
            yield f"{item} has shape {array.shape}, expected {shape}"
        elif not np.isfinite(array).all():
            yield f"{item} holds values that are not finite"


def _frame_array_faults(record: _RecordParts) -> Iterator[str]:
    for frame in record.interfaces:
        for item, shape in (("p_BI_B", (3,)), ("R_BI", (3, 3)), ("modes", (6, record.n_modes))):
            array = getattr(frame, item)
            if array.shape != shape:
                yield f"interface {frame.name!r} has {item} {array.shape}, expected {shape}"
            elif not np.isfinite(array).all():
                yield f"interface {frame.name!r}: {item} holds values that are not finite"


def _nonlinear_faults(record: _RecordParts) -> Iterator[str]:
    nonlinear = record.nonlinear
    if nonlinear is None:
        return
    twice = [name for name in ("geometric", "stretch") if getattr(record, name) is not None]
    if twice:
        yield f"it has {' and '.join(twice)} beside nonlinear, which holds that stiffness already"
    if record.stress is not None:
        yield "it has stress modes, which are of small displacements, beside nonlinear"
    if len(nonlinear.face_strain) != len(record.interfaces):
        yield f"nonlinear has {len(nonlinear.face_strain)} faces for {len(record.interfaces)} interfaces"
    if nonlinear.energy.size == 1 and not nonlinear.energy[0] >= 0.0:
        yield f"nonlinear has an energy of {nonlinear.energy[0]} J"
    if nonlinear.tolerance.size == 1 and not nonlinear.tolerance[0] > 0.0:
        yield f"nonlinear has a tolerance of {nonlinear.tolerance[0]}"


def _mass_faults(record: _RecordParts) -> Iterator[str]:
    """What makes the Gram matrix no mass integrals of a body: kinetic energies below zero."""
    if not record.mass > 0.0:
        yield f"the mass is {record.mass} kg"
        return
    if not _is_symmetric(record.gram):
        yield "gram is not symmetric"
        return
    m = record.mass_matrix()
    sizes = np.sqrt(np.abs(np.diag(m)))
    sizes[sizes == 0.0] = 1.0
    scaled = m / sizes / sizes[:, None]
    if not np.isfinite(scaled).all():
        yield "gram holds numbers beyond all bounds"
        return
    if (least := float(np.linalg.eigvalsh(scaled)[0])) < -SEVEN_DIGITS:
        yield f"the mass matrix is indefinite, {least:.1e} in its scale: some motions have negative kinetic energy"
    error = float(abs(m[6:, 6:] - np.eye(record.n_modes)).max(initial=0.0))
    if error > _UNIT_MASS:
        yield f"the modes are not of unit modal mass: gram is {error:.1e} off"


def _deformation_faults(record: _RecordParts) -> Iterator[str]:
    """Energies that deformations cannot have, and coordinates that do not describe them."""
    k = record.stiffness
    if not (k > 0.0).all():
        yield f"stiffness is not positive: {k.min():.3e} 1/s^2 is its least value"
        return
    omega = np.sqrt(k)
    # twice the damping ratios, which are pure numbers
    ratios = record.damping / np.sqrt(omega) / np.sqrt(omega)[:, None]
    if not np.isfinite(ratios).all():
        yield "damping holds numbers beyond all bounds"
    elif abs(ratios - ratios.T).max(initial=0.0) > SEVEN_DIGITS * abs(ratios).max(initial=0.0):
        yield "damping is not symmetric: forces that take no power belong in gyroscopic"
    elif (least := float(np.linalg.eigvalsh(ratios).min(initial=0.0))) < -SEVEN_DIGITS * abs(ratios).max(initial=0.0):
        yield f"damping is negative: some motions would gain energy, with the damping ratio {least / 2.0:.1e}"
    if not _is_regular(record.partition):
        yield "partition is singular: it is a change of basis, of modes to interface motions and fixed-interface modes"


def _place_faults(record: _RecordParts) -> Iterator[str]:
    """Rotations that are none; places from where the body is a point, as doubles have it."""
    if not _is_rotation(record.R_MB):
        yield "R_MB is no rotation"
    size = float(np.sqrt(max(np.trace(record.gram[1:4, 1:4]) / record.mass, 0.0))) if record.mass > 0.0 else 0.0
    for name, p in [("p_MB_M", record.p_MB_M), *((f"interface {one.name!r}", one.p_BI_B) for one in record.interfaces)]:
        away = float(abs(p).max())
        # of a point no size is known; squares of places are asked for everywhere
        if away * np.finfo(float).eps > size > 0.0 or away > np.sqrt(np.finfo(float).max):
            yield f"{name} is at {away:.3g} m, from where doubles do not resolve a body of {size:.3g} m"
    for frame in record.interfaces:
        if not _is_rotation(frame.R_BI):
            yield f"interface {frame.name!r}: R_BI is no rotation"
        with np.errstate(over="ignore"):
            flexibility = frame.modes**2 / record.stiffness
        if not np.isfinite(flexibility).all():
            yield f"interface {frame.name!r}: modes holds numbers beyond all bounds"


def _is_rotation(R: FloatArray) -> bool:
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(abs(R.T @ R - np.eye(3)).max() <= SEVEN_DIGITS and np.linalg.det(R) > 0.0)


def _is_symmetric(matrix: FloatArray) -> bool:
    """In the scales of its diagonal, whose numbers may have any units."""
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt(abs(np.diag(matrix)))
        return bool((abs(matrix - matrix.T) <= SEVEN_DIGITS * np.outer(sizes, sizes)).all())


def _is_regular(matrix: FloatArray) -> bool:
    """Whether a square matrix has an inverse, its rows and columns in whatever units."""
    if matrix.size == 0:
        return True
    rows = np.abs(matrix).max(axis=1)
    if not (rows > 0.0).all():
        return False
    scaled = matrix / rows[:, None]
    columns = np.abs(scaled).max(axis=0)
    if not (columns > 0.0).all():
        return False
    values = np.linalg.svd(scaled / columns, compute_uv=False)
    return bool(values[-1] > of_solver(len(matrix)) * values[0])
