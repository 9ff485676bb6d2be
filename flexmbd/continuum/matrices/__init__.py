"""Distributed matrices: blocks of columns, null spaces, eigenvalues.

Entered by the continuum's other rooms and the reduction.  Knows matrices alone, neither forms nor meshes.
"""
