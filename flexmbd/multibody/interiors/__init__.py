"""The protocol of bodies with history: what they give a machine while it moves, and at rest.

The second gate between the continuum and the machine.
"""
