"""Loads on a body with history: on facets, at nodes, and in its cells; dead, or following the surface.

Each is a field of unit size times a factor, a function of time, or of the load parameter in slow loading. Vectors are
in inertial axes where the body moves, and in body axes in slow loading, where the body does not turn. A dead load keeps
its direction and its size by undeformed area; one that follows goes by the present surface (Bonet & Wood 2008,
section 8.5.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum.finite_elements.temperature import checked_rise
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.interiors.time_factor import TimeFactor
from flexmbd.record.groups import frozen

FloatArray = NDArray[np.float64]

#: A function of time, or of the load parameter: a number, data (fm.Table, fm.Sine, a PPoly), compiled or a callable.
LoadFactor = Any

_FEW = 100  # numbers that are named one by one where the ranks disagree


@checked("facets", "follows", "name")
@dataclass(frozen=True, eq=False)
class PressureOnFacets:
    """A pressure on facets of the body's surface; it pushes inwards where it is positive.

    Attributes:
        facets: facet group of the mesh.
        factor: Pa.
        follows: whether it goes by the present area and normal; else by those of the undeformed body.
        name: in messages and series; by default that of the facets.

    Raises:
        SceneError: a value is not of its kind.
    """

    facets: str
    factor: LoadFactor
    follows: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        _check(self, self.facets)


@checked("facets", "follows", "name")
@dataclass(frozen=True, eq=False)
class TractionOnFacets:
    """A force per undeformed area on facets of the body's surface.

    Attributes:
        facets: facet group of the mesh.
        traction: (3,) Pa, in the axes of the undeformed body where it follows.
        factor: dimensionless.
        follows: whether it turns with the surface at each of its points: with the rotation in the polar decomposition
            of the surface's deformation gradient.
        name: in messages and series; by default that of the facets.

    Raises:
        SceneError: a value is not of its kind, or the traction is not three finite numbers.
    """

    facets: str
    traction: ArrayLike
    factor: LoadFactor = 1.0
    follows: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        _check(self, self.facets)
        object.__setattr__(self, "traction", _vector(self, "traction"))


@checked("name")
@dataclass(frozen=True, eq=False)
class ForceAtNodes:
    """A force on each of some nodes, of fixed direction.

    Attributes:
        nodes: their numbers in the mesh's input.
        force: (3,) N.
        factor: dimensionless.
        name: in messages and series.

    Raises:
        SceneError: a value is not of its kind, no nodes, or the force is not three finite numbers.
    """

    nodes: Sequence[int]
    force: ArrayLike
    factor: LoadFactor = 1.0
    name: str = "force"

    def __post_init__(self) -> None:
        numbers = np.asarray(self.nodes)
        if numbers.ndim != 1 or not numbers.size or not np.issubdtype(numbers.dtype, np.integer):
            raise SceneError(f"load {self.name!r}: nodes must be a list of node numbers, got {self.nodes!r:.80}")
        _check(self, self.name)
        object.__setattr__(self, "force", _vector(self, "force"))


@checked("name")
@dataclass(frozen=True, eq=False)
class BodyAcceleration:
    """A force per mass in all cells: the weight in slow loading, or the apparent forces of a shaken ground.

    The weight in a machine is the machine's gravity.

    Attributes:
        acceleration: (3,) m/s^2.
        factor: dimensionless.
        name: in messages and series.

    Raises:
        SceneError: a value is not of its kind, or the acceleration is not three finite numbers.
    """

    acceleration: ArrayLike
    factor: LoadFactor = 1.0
    name: str = "body acceleration"

    def __post_init__(self) -> None:
        _check(self, self.name)
        object.__setattr__(self, "acceleration", _vector(self, "acceleration"))


@checked("name")
@dataclass(frozen=True, eq=False)
class CentrifugalLoad:
    """The centrifugal force on a body that turns steadily, in axes that turn with it: for slow loading.

    A body that turns in a machine needs none: its nodes have inertia.

    Attributes:
        angular_velocity: (3,) rad/s.
        point: (3,) m, on the axis.
        factor: dimensionless, of the square of the angular velocity.
        name: in messages and series.

    Raises:
        SceneError: a value is not of its kind, or not three finite numbers.
    """

    angular_velocity: ArrayLike
    point: ArrayLike = (0.0, 0.0, 0.0)
    factor: LoadFactor = 1.0
    name: str = "centrifugal"

    def __post_init__(self) -> None:
        _check(self, self.name)
        for item in ("angular_velocity", "point"):
            object.__setattr__(self, item, _vector(self, item))


@checked("name")
@dataclass(frozen=True, eq=False)
class Heating:
    """A rise of temperature above that at which the body is free of stress; several of one body add up.

    For bodies made with ``NonlinearModel(..., heated=True)``, whose formulations say how they expand.

    Attributes:
        rise: K: a number, a function of points (n, 3) m of the undeformed body that gives (n,), or the values (nodes,)
            at the mesh's nodes in the order of its input.
        factor: dimensionless.
        name: in messages.

    Raises:
        SceneError: a value is not of its kind.
    """

    rise: Any = 1.0
    factor: LoadFactor = 1.0
    name: str = "heating"

    def __post_init__(self) -> None:
        _check(self, self.name)
        object.__setattr__(self, "rise", checked_rise(self.rise, f"load {self.name!r}", kind=SceneError))


@checked("electrode", "name")
@dataclass(frozen=True, eq=False)
class Voltage:
    """The voltage of an electrode of the body, a port: ``NonlinearModel(..., conditions=[Electrode("top")])``.

    Attributes:
        electrode: its group of the mesh.
        factor: V.
        name: in messages; by default that of the electrode.

    Raises:
        SceneError: a value is not of its kind.
    """

    electrode: str
    factor: LoadFactor
    name: str = ""

    def __post_init__(self) -> None:
        _check(self, self.electrode)


BodyLoad = (
    PressureOnFacets | TractionOnFacets | ForceAtNodes | BodyAcceleration | CentrifugalLoad | Heating | Voltage
)
"""A load on a body with history."""


def factors_of(loads: Sequence[BodyLoad]) -> tuple[TimeFactor, ...]:
    """Their factors as functions; not collective."""
    return tuple(TimeFactor(load.factor, f"load {load.name!r}") for load in loads)


def listed(loads: Sequence[BodyLoad]) -> tuple[BodyLoad, ...]:
    """Loads of unlike names; not collective.

    Raises:
        SceneError: they are no list of loads, or two have one name.
    """
    if isinstance(loads, BodyLoad) or not isinstance(loads, Sequence):
        raise SceneError(f"loads must be a list, as loads=[PressureOnFacets(...)], got {loads!r:.80}")
    for load in loads:
        if not isinstance(load, BodyLoad):
            raise SceneError(
                f"a load on a body with history is a PressureOnFacets, TractionOnFacets, ForceAtNodes, "
                f"BodyAcceleration, CentrifugalLoad, Heating or Voltage, got {load!r:.80}"
            )
    names = [load.name for load in loads]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"two loads are called {name!r}; give each its own name")
    return tuple(loads)


def told(load: BodyLoad) -> str:
    """A load by all that it was given; of functions the kind alone. A factor is rank 0's anyway."""
    parts = [type(load).__name__]
    for item in fields(load):
        value = getattr(load, item.name)
        if item.name == "factor" or callable(value):
            parts.append(type(value).__name__)
        else:
            values = np.asarray(value)
            parts.append(str(values.tolist()) if values.size <= _FEW else sha256(values.tobytes()).hexdigest())
    return " ".join(parts)


def _check(load: Any, name: str) -> None:
    if not isinstance(name, str) or not name:
        raise SceneError(f"{type(load).__name__}: it needs the name of a facet group, got {name!r}")
    if not load.name:
        object.__setattr__(load, "name", name)
    TimeFactor(load.factor, f"load {load.name!r}")


def _vector(load: Any, item: str) -> FloatArray:
    try:
        vector = np.array(getattr(load, item), dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise SceneError(f"load {load.name!r}: {item} must be three finite numbers, got {getattr(load, item)!r}")
    return frozen(vector)


