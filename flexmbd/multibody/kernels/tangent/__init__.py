"""Derivatives of the equations of motion, and factors of trees.

Entered by the implicit integrators and by linear machines.
"""
