"""Standard input data (SID_FEM): written, read, and its Taylor expansions.

Entered by users through `fm.export`, and by the list of formats.
"""
