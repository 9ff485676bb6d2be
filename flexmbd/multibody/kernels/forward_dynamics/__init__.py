"""Accelerations from forces by articulated bodies, in O(bodies).

Entered by the explicit integrators and by loops.
"""
