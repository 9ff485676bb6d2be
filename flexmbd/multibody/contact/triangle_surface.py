"""A surface of triangles that spheres and points touch; what is smooth is curved, sharp edges stay sharp."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, refuse_no_truth, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.closed_surface import whole_rows
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.multibody.contact.curved_triangles import control_points, corner_normals
from flexmbd.multibody.contact.facets import Facets
from flexmbd.multibody.contact.table_shape import TableShape, finite_points, tabulated
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.contact import signed_distance as kinds
from flexmbd.multibody.kernels.contact import triangle_distance as at
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TriangleSurface(TableShape):
    """A surface of triangles, in the frame's axes; spheres and points touch it from the side of its normals.

    Between triangles that meet at less than the crease angle the surface is smooth: their corners have one normal, the
    mean of the triangles' weighed by their angles (Thuermer & Wuethrich 1998), and they are curved so that they have
    one tangent plane all along the edge (Walton & Meek 1996).  Triangles in one plane stay flat, sharper edges sharp.

    Attributes:
        frame: on a body or on the ground.
        points: (n, 3) m; points at one place are one.
        triangles: (t, 3) rows of points, anticlockwise as seen from outside.
        crease_angle: rad between the normals of two triangles, from which on their edge is sharp; 0: all stay flat.
        open: whether the surface may have a rim.  What is beside the rim is not behind the surface.

    Raises:
        SceneError: arrays that do not fit; a triangle without area; an edge of more than two triangles, or of two that
            disagree which side is out; a rim that is not allowed for; a closed surface that faces inwards.
    """

    frame: Frame
    points: ArrayLike
    triangles: ArrayLike
    crease_angle: float = 0.5
    open: bool = False

    _kind = kinds.TRIANGLES

    def __post_init__(self) -> None:
        refuse_other(self.frame, Frame, "the frame of a TriangleSurface", wanted="a frame as body.frame()")
        refuse_no_truth(open=self.open)
        if not (is_number(self.crease_angle) and 0.0 <= self.crease_angle < 0.5 * np.pi):
            angle = f"{self.crease_angle!r:.50}"
            raise SceneError(f"{self._what}: crease_angle must be from 0 to below pi / 2 (rad), got {angle}")
        _ = self.table  # built now: what is wrong is told where it is given

    @classmethod
    def of_shape(cls, frame: Frame, shape: Shape, *, crease_angle: float = 0.5, open: bool = False) -> TriangleSurface:
        """The surface of a shape, as ``fm.Shape.from_file("part.stl", unit="mm")`` reads it.

        Raises:
            SceneError: as the class.
        """
        refuse_other(shape, Shape, "shape", wanted="a fm.Shape")
        return cls(frame, shape.points, shape.triangles, crease_angle=crease_angle, open=open)

    @property
    def _what(self) -> str:
        return f"TriangleSurface on {self.frame.label}"

    def curvatures(self) -> tuple[float, float]:
        """Not one pair: see ``Hertz``."""
        raise SceneError(
            f"{self._what}: its curvatures change along it, and Hertz's law is of one pair; take PowerLaw, as "
            "PowerLaw.bearing(load=..., depth=...)"
        )

    @cached_property
    def _facets(self) -> Facets:
        x, rows = finite_points(self.points, 3, self._what), whole_rows(self.triangles)
        if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0 or not np.issubdtype(rows.dtype, np.integer):
            raise SceneError(
                f"{self._what}: triangles must be whole numbers of shape (t, 3), t > 0, got {rows.dtype} {rows.shape}"
            )
        if rows.min() < 0 or rows.max() >= len(x):
            raise SceneError(
                f"{self._what}: triangles must name points 0 to {len(x) - 1}, got {rows.min()} to {rows.max()}"
            )
        facets = Facets.of(x, rows.astype(np.int64), self._what)
        if not self.open:
            facets.refuse_rim(self._what)
            facets.refuse_inwards(self._what)
        return facets

    @cached_property
    def table(self) -> SharedNumbers:
        """Its triangles."""
        facets = self._facets
        sharp = facets.sharp(self.crease_angle)
        normals = corner_normals(facets, sharp)
        control = control_points(facets, sharp, normals)
        x, n = facets.corners, facets.normals
        places = x[:, :1] + control
        flat = (np.abs(normals - n[:, None]).max(axis=(1, 2)) <= EQUAL) & ~facets.has_curved_edge(control)
        edges, points = facets.signing_normals(sharp)
        low = np.where(flat[:, None], x.min(axis=1), places.min(axis=1))
        high = np.where(flat[:, None], x.max(axis=1), places.max(axis=1))
        head = np.concatenate([_placed(facets), n, edges.reshape(-1, 9), points.reshape(-1, 9)], axis=1)
        curved = np.concatenate([head, _farthest(facets.arms, control)[:, None], control.reshape(len(x), -1)], axis=1)
        items = [_item(at.FLAT, head[k]) if flat[k] else _item(at.PATCH, curved[k]) for k in range(len(x))]
        return tabulated(low, high, items)

    def _behind(self) -> tuple[FloatArray, FloatArray, SharedNumbers]:
        """Of the flat triangles: the curved ones are as thick, and are far slower to search."""
        x, n = self._facets.corners, self._facets.normals
        head = np.concatenate([_placed(self._facets), n, np.zeros((len(x), 18))], axis=1)
        flat = tabulated(x.min(axis=1), x.max(axis=1), [_item(at.FLAT, one) for one in head])
        some = slice(0, 0) if self.open else slice(None)
        return x.mean(axis=1)[some], n[some], flat


def _placed(facets: Facets) -> FloatArray:
    """(t, 9) m, the first corner, and the two others as seen from it (``kernels.contact.triangle_distance``)."""
    return np.concatenate([facets.corners[:, 0], facets.arms[:, 1:].reshape(-1, 6)], axis=1)


def _item(kind: int, numbers: FloatArray) -> FloatArray:
    return np.concatenate([[kind], numbers])


def _farthest(x: FloatArray, control: FloatArray) -> FloatArray:
    """(t,) m, bounds of how far control points (t, k, 3) are from their triangles (t, 3, 3): from points of these."""
    at_corner = np.linalg.norm(control[:, :, None] - x[:, None], axis=3).min(axis=2)
    edge = np.roll(x, -1, axis=1) - x
    size = np.einsum("tei,tei->te", edge, edge)[:, None]
    along = np.einsum("tkei,tei->tke", control[:, :, None] - x[:, None], edge) / size
    on_edge = x[:, None] + np.clip(along, 0.0, 1.0)[..., None] * edge[:, None]
    least = np.minimum(at_corner, np.linalg.norm(control[:, :, None] - on_edge, axis=3).min(axis=2))
    normal = np.cross(edge[:, 0], edge[:, 1])
    area = np.einsum("ti,ti->t", normal, normal)
    q = control - x[:, :1]
    shares = [
        np.einsum("tki,ti->tk", np.cross(control - x[:, k : k + 1], edge[:, k : k + 1]), -normal) / area[:, None]
        for k in range(3)
    ]
    inside = np.min(shares, axis=0) >= 0.0
    height = np.abs(np.einsum("tki,ti->tk", q, normal)) / np.sqrt(area)[:, None]
    return np.asarray(np.where(inside, height, least).max(axis=1))
