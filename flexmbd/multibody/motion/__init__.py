"""A machine at an instant: places and motions of its frames, its coordinates, what its joints pass on.

Entered by events, working points, trajectories and Kane's equations, which all ask ``Instant``.
"""
