"""Motions of frames and states between steps, for results.

Entered by trajectories, events and exports.
"""
