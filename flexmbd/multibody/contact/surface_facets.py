"""Facets that nodes of a body with history touch: of another one, or of a reduced body, moved by frame and modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_no_name, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.interiors.touching_interior import ReducedFacets, TouchingInterior

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_WANTED = "a fm.ContinuumBody or a fm.FlexibleBody, as scene.add returned it"


@dataclass(frozen=True, eq=False)
class SurfaceFacets:
    """A surface of another body that nodes of a body with history touch.

    Attributes:
        body: in the scene: with history, or reduced.
        surface: of a body with history the name of a group of facets of its mesh; of a reduced body a surface of
            ``record.contact.names``, or None: the whole boundary that the record keeps.

    Raises:
        SceneError: it is no such body, or has no such surface.
    """

    body: ContinuumBody | FlexibleBody
    surface: str | None = None

    def __post_init__(self) -> None:
        refuse_other(self.body, (ContinuumBody, FlexibleBody), "the body of contact.SurfaceFacets", wanted=_WANTED)
        if isinstance(self.body, FlexibleBody):
            _geometry(self.body, self.surface, self.what)
        else:
            check_surface(self.body, self.surface, kind="SurfaceFacets", what=self.what)

    @property
    def what(self) -> str:
        """How messages call it."""
        name = "of the whole boundary" if self.surface is None else repr(self.surface)
        return f"facets {name} of body {self.body.name!r}"

    @property
    def label(self) -> str:
        """A short name."""
        return self.body.name if self.surface is None else f"{self.body.name}.{self.surface}"


def check_surface(body: object, surface: object, *, kind: str, what: str) -> None:
    """Raise SceneError unless a body with history has a surface that touches; ``kind`` and ``what`` ask for it."""
    wanted = "a fm.ContinuumBody, as scene.add returned it"
    refuse_other(body, ContinuumBody, f"the body of contact.{kind}", wanted=wanted)
    if not isinstance(body, ContinuumBody):
        return
    interior = body.interior
    if not isinstance(interior, TouchingInterior):
        raise SceneError(
            f"contact.{kind} of body {body.name!r}: its interior, {type(interior).__name__}, has no surface that "
            "touches; take ExplicitContinuum or ImplicitContinuum"
        )
    refuse_no_name(surface, f"the surface of contact.{kind}")
    interior.check_surface(str(surface), what=what)


def reduced_facets(body: FlexibleBody, group: str | None, *, what: str, **told: Any) -> ReducedFacets:
    """What an interior is told of a surface of a reduced body.

    The modes are read and loaded by markers on the body's frame, each of which three of them move along its axes: by
    as much as they move the surface at most, so that these coordinates are lengths and their forces are forces.

    Args:
        body: the body.
        group: the surface, as of `SurfaceFacets`.
        what: in messages.
        told: of the contact, as of `ReducedFacets`.
    """
    points, phi, facets = _geometry(body, group, what)
    most = np.sqrt((phi**2).sum(axis=1).max(axis=0))
    felt = np.flatnonzero(most > 0.0)
    markers = -(-len(felt) // 3)
    shapes = np.zeros((len(points), 3, 3 * markers))
    shapes[:, :, : len(felt)] = phi[:, :, felt] / most[felt]
    frames = [body.frame()]
    for k in range(markers):
        modes = np.zeros((6, body.record.n_modes))
        mine = felt[3 * k : 3 * k + 3]
        modes[np.arange(len(mine)), mine] = most[mine]
        frames.append(Frame(body, np.zeros(3), np.eye(3), modes, f"{frames[0].label} modes {3 * k} to {3 * k + 2}"))
    mass, stiffness = body.record.mass_matrix(), np.zeros(6 + body.record.n_modes)
    stiffness[6:] = body.record.stiffness
    import scipy.linalg  # on need: it takes longer to load than a first run

    rate = float(scipy.linalg.eigh(np.diag(stiffness), mass, eigvals_only=True)[-1])
    # of lengths, and of what no mode moves none
    kept = np.concatenate([np.arange(6), 6 + felt])
    inverse = np.linalg.inv(mass)[np.ix_(kept, kept)]
    scale = np.concatenate([np.ones(6), most[felt]])
    mobility = np.zeros((6 + 3 * markers, 6 + 3 * markers))
    mobility[: len(kept), : len(kept)] = scale[:, None] * inverse * scale
    return ReducedFacets(
        frames=tuple(frames), points=points, shapes=shapes, facets=facets, mobility=mobility, rate=rate, **told
    )


def _geometry(body: FlexibleBody, surface: str | None, what: str) -> tuple[FloatArray, FloatArray, IntArray]:
    """Points (k, 3) m, modes there (k, 3, n), and facets (f, 3 or 4) of a reduced body's surface.

    Raises:
        SceneError: its record does not have them.
    """
    record = body.record
    if surface is None:
        if record.surface is None:
            raise SceneError(
                f"{what}: its record keeps no boundary; reduce the part with keep=Keep(surface=True), or name a "
                "surface that contact=[Patch(name, size=...)] made"
            )
        whole = record.surface
        return whole.x, whole.phi, whole.triangle.astype(np.int64)
    refuse_no_name(surface, "the surface of contact.SurfaceFacets")
    group, modes = record.contact, record.modes
    remedy = f"reduce the part with craig_bampton(..., contact=[Patch({surface!r}, size=...)], keep=Keep(modes=True))"
    if group is None:
        raise SceneError(f"{what}: its record has no surfaces that are touched; {remedy}")
    if surface not in group.names:
        there = ", ".join(map(repr, group.names))
        raise SceneError(f"{what}: its record has no surface {surface!r}; it has {there}")
    facets = group.facet[np.isin(group.patch, np.flatnonzero(group.surface == group.names.index(surface)))]
    if modes is None or not len(facets):
        raise SceneError(f"{what}: its record keeps no facets and no modes at their nodes; {remedy}")
    node, rows = np.unique(facets, return_inverse=True)
    at = np.searchsorted(modes.node, node)
    return modes.x[at], modes.phi[at], rows.reshape(facets.shape).astype(np.int64)
