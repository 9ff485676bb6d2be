"""What loads and motion do to the stiffness: geometric stiffness, membrane strains, states under load.

Entered by the reductions; stands on static shapes and modes.
"""
