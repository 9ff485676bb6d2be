"""Readings of a solution: energies, the text of ``explain``, the watches on what bodies are made for.

Entered by trajectories and the system.
"""
