"""A simulation: stepping, events, checkpoints, limits, and the trajectory that it leaves.

Entered by the system, monitors, exports and pictures.
"""
