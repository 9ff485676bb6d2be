"""Contact of a sphere, or a point, with a shape: distances, the normal force, friction; what changes them all."""
