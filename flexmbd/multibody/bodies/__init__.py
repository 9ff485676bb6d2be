"""Bodies of a machine and their mass: rigid, reduced, pseudo-rigid, and those with history.

Entered by all of the machine; knows records, no scene.
"""
