"""Thin walls."""
