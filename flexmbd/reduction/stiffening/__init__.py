"""Stiffening by loads and motion: geometric stiffness, membrane strains, states under load.

Entered by the reductions; stands on static shapes and modes.
"""
