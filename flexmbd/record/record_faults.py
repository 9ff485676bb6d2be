"""What makes a record no reduced body: shapes that differ, numbers that are not finite, negative energies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from flexmbd.record.groups import GROUPS, FloatArray, InterfaceFrame, NonlinearStiffness, StressModes, group_faults

# Of the mass matrix in its own scales: files of other programs have eight digits.
_ROUND_OFF = 1e-6


class _RecordParts(Protocol):
    """What is looked at of a `ReducedBody` beside its arrays by name; its constructor asks."""

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
    """What does not fit together in a record, a line each."""
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
        elif item == "gram":
            yield from _mass_faults(record)
    if not (record.stiffness > 0.0).all() and np.isfinite(record.stiffness).all():
        yield f"stiffness is not positive: {record.stiffness.min():.3e} 1/s^2 is its least value"
    if len(record.partition_names) != n:
        yield f"{len(record.partition_names)} partition names for {n} modes"
    for frame in record.interfaces:
        for item, shape in (("p_BI_B", (3,)), ("R_BI", (3, 3)), ("modes", (6, n))):
            array = getattr(frame, item)
            if array.shape != shape:
                yield f"interface {frame.name!r} has {item} {array.shape}, expected {shape}"
            elif not np.isfinite(array).all():
                yield f"interface {frame.name!r}: {item} holds values that are not finite"
    names = [frame.name for frame in record.interfaces]
    if len(set(names)) != len(names):
        yield f"two interfaces share a name: {names}"
    if record.frame is not None and record.frame not in names:
        yield f"the body frame's interface {record.frame!r} is not among {names}"
    for attribute in GROUPS:
        group = getattr(record, attribute)
        if group is not None:
            yield from group_faults(group, n=n)
    yield from _nonlinear_faults(record)


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
    m = record.mass_matrix()
    sizes = np.sqrt(np.abs(np.diag(m)))
    sizes[sizes == 0.0] = 1.0
    scaled = m / sizes / sizes[:, None]
    if not np.isfinite(scaled).all():
        yield "gram holds numbers beyond all bounds"
    elif (least := float(np.linalg.eigvalsh(scaled)[0])) < -_ROUND_OFF:
        yield f"the mass matrix is indefinite, {least:.1e} in its scale: some motions have negative kinetic energy"
