"""Solids that yield."""
