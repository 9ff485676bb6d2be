"""Readings of a solution: energies, the text of ``explain``, the watch on stretches.

Entered by trajectories and the system.
"""
