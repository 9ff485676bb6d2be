"""Frames of beams as points and lines, and bodies of such beams by the discrete element method.

numpy and scipy alone, and of flexmbd only the record and the errors: both sides of the wall may import it.
"""
