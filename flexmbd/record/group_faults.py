"""Faults of a record's optional groups: shapes that differ, numbers that are not finite, parts that do not fit.

Asked by `flexmbd.record.record_faults`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from flexmbd.record.contact_patches import ContactPatches, contact_array_shapes, contact_faults
from flexmbd.record.groups import (
    NAMES,
    DistributedLoads,
    FloatArray,
    FurtherUnknowns,
    GeometricStiffness,
    Gyroscopic,
    Heat,
    ModalStretch,
    NodalInterfaces,
    NodalModes,
    NonlinearStiffness,
    Ports,
    RecordGroup,
    StressModes,
    Surface,
)
from flexmbd.round_off import SEVEN_DIGITS

#: What a group has names of, other than loads.
_NAMED: dict[type[RecordGroup], str] = {NodalInterfaces: "an interface", ContactPatches: "a surface", Ports: "a port"}


def group_faults(group: RecordGroup, *, n: int) -> Iterable[str]:
    """Faults of a group of a body of n modes."""
    kind, misshapen = type(group).__name__, False
    for item, shape in _shapes(group, n).items():
        array = getattr(group, item)
        if array.shape != shape:
            misshapen = True
            yield f"{kind} has {item} {array.shape}, expected {shape}"
        elif not np.isfinite(array).all():
            misshapen = True
            yield f"{kind}: {item} holds values that are not finite"
    if isinstance(group, Surface) and group.triangle.size > 0:
        low, high = group.triangle.min(), group.triangle.max()
        if low < 0 or high >= len(group.x):
            yield f"{kind} has vertices {low} to {high} in its triangles, and {len(group.x)} vertices"
    if isinstance(group, NodalInterfaces) and not np.isin(group.interface, np.arange(len(group.names))).all():
        yield f"{kind} has nodes of interfaces {np.unique(group.interface)}, and {len(group.names)} names"
    if isinstance(group, Gyroscopic) and group.G.shape == (n, n) and not np.array_equal(group.G, -group.G.T):
        yield f"{kind} has a G that is not skew, whose forces would do work"
    symmetric = {"K": group.K} if isinstance(group, GeometricStiffness) else {}
    symmetric |= {"P": group.P} if isinstance(group, ModalStretch) else {}
    for item, array in symmetric.items():
        if array.shape[1:] == (n, n) and not _are_symmetric(array):
            yield f"{kind}: {item} is not symmetric"
    for names in (getattr(group, item) for item in NAMES if hasattr(group, item)):
        if len(set(names)) != len(names):
            yield f"{kind} names {_NAMED.get(type(group), 'a load')} twice: {names}"
    if isinstance(group, Ports):
        yield from _port_faults(group, sound=not misshapen)
    if isinstance(group, ContactPatches) and not misshapen:
        yield from (f"{kind}: {fault}" for fault in contact_faults(group))


def _port_faults(group: Ports, *, sound: bool) -> Iterable[str]:
    for item in ("efforts", "effort_units", "flows", "flow_units"):
        texts = getattr(group, item)
        if len(texts) != len(group.names) or not all(texts):
            yield f"Ports has {item} {texts} for {len(group.names)} ports"
    if not sound:
        return
    sizes = np.sqrt(np.abs(np.diag(group.capacity)))
    scaled = group.capacity / np.outer(np.where(sizes > 0.0, sizes, 1.0), np.where(sizes > 0.0, sizes, 1.0))
    if not _are_symmetric(group.capacity[None]):
        yield "Ports: capacity is not symmetric: some efforts would gain energy on the way round"
    elif (least := float(np.linalg.eigvalsh(scaled).min(initial=0.0))) < -SEVEN_DIGITS:
        yield f"Ports: capacity is negative, {least:.1e} in its scale: some efforts would take no energy to be set"


def _are_symmetric(matrices: FloatArray) -> bool:
    """Each (n, n) of (k, n, n), to the eight digits that files of other programs have."""
    errors = abs(matrices - matrices.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    return bool((errors <= 1e-6 * abs(matrices).max(axis=(1, 2), initial=0.0)).all())


def _shapes(group: RecordGroup, n: int) -> Mapping[str, tuple[int, ...]]:
    """The shape that each array of a group should have."""
    match group:
        case NodalModes():
            k = group.node.size
            return {"node": (k,), "x": (k, 3), "phi": (k, 3, n)}
        case NodalInterfaces():
            k = group.node.size
            return {"node": (k,), "x": (k, 3), "interface": (k,), "phi": (k, 3, n)}
        case FurtherUnknowns():
            return {"dof": (group.dof.size,), "phi": (group.dof.size, n)}
        case Surface():
            k, t = len(group.x), len(group.triangle)
            return {"x": (k, 3), "triangle": (t, 3), "phi": (k, 3, n)}
        case GeometricStiffness():
            return {"K": (len(group.loads), n, n)}
        case ModalStretch():
            s = len(group.strain)
            return {"strain": (s, n), "P": (s, n, n)}
        case NonlinearStiffness():
            cubic = n * (n + 1) * (n + 2) // 6
            strain = (len(group.face_strain), 6, n)
            one = {"energy": (1,), "tolerance": (1,), "compared": (n, group.compared.size // max(n, 1))}
            return {"cubic": (cubic,), "quartic": (cubic * (n + 3) // 4,), "face_strain": strain, **one}
        case Gyroscopic():
            return {"momentum": (3,), "slope": (3, n), "G": (n, n)}
        case DistributedLoads():
            k = len(group.names)
            return {"force": (k, 3), "moment": (k, 3), "modal": (k, n)}
        case Ports():
            k = len(group.names)
            return {"load": (k, n), "capacity": (k, k)}
        case Heat():
            return {"node": (group.node.size,), "rise": (len(group.names), group.node.size)}
        case StressModes():
            k = group.node.size
            return {"node": (k,), "x": (k, 3), "interface": (k,), "sigma": (k, 6, n)}
        case ContactPatches():
            return contact_array_shapes(group, n)
