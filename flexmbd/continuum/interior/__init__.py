"""Whole meshes between rigid frames, explicit or implicit: the interiors of a machine's bodies with history.

The gate to the machine that is not a record: these classes keep the protocol of interiors, and nothing else of the
continuum is seen there.
"""
