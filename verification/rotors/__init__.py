"""Rotating beams and vibrations."""
