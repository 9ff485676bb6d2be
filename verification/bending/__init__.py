"""Beams that bend far."""
