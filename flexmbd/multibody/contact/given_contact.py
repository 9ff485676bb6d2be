"""What a contact is made of, checked: shape, sphere and law may vary in a compiled machine, whatever is given there."""

from __future__ import annotations

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers, refuse_other, shown
from flexmbd.multibody.contact.shapes import SHAPES, ConvexPolytope, Vertex


def refuse_wrong_arguments(shape: object, radius: object, centre: object) -> None:
    """Raise SceneError for what is no shape that spheres touch, a radius (m) or a centre (3,) m that is none."""
    refuse_other(shape, SHAPES, "what a sphere touches", wanted="a shape as fm.contact.HalfSpace(body.frame())")
    if isinstance(shape, Vertex | ConvexPolytope):
        raise SceneError(f"a {type(shape).__name__} on {shape.frame.label} is not touched by a sphere or a point")
    if not (is_number(radius) and float(radius) >= 0.0):  # type: ignore[arg-type]
        raise SceneError(f"the radius of a sphere that touches must be positive (m), 0 of a point, got {shown(radius)}")
    place = numbers(centre)
    if place.shape != (3,) or not all(map(is_number, place)):
        raise SceneError(f"the centre of a sphere that touches must be (3,) m, got {shown(centre)}")
