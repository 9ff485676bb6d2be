"""Radau IIA of order 5.

Entered by `flexmbd.integrate`.
"""
