"""Superelements of frames and modes, full matrices, and the formats that carry them.

DMIG, OP4, CalculiX, Simscape, ExtPtfm.

Entered by users through `fm.export`, and by the list of formats.
"""
