"""Rotations, spatial vectors and factors of small matrices.

Entered by all kernels; knows no plan.
"""
