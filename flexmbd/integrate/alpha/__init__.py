"""Lie-group generalized-alpha.

Entered by `flexmbd.integrate`.
"""
