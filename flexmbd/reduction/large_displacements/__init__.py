"""Bodies that bend a lot: modal derivatives as further shapes, and the strain energy to the fourth degree on them.

Entered by the reductions; stands on static shapes and modes.
"""
