"""Quantities of a compiled scene that may take other values from run to run, one class each.

Users enter by `flexmbd.parameter`.
"""
