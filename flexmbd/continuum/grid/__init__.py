"""Meshes with named groups, spread over ranks: how they are given, divided, checked and tagged.

Entered by the continuum's other rooms, by `flexmbd.meshes` and the commands.  Knows no form and no matrix.
"""
