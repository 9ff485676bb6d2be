"""Equilibria and linear machines: M, C, K, V, W about a working point, inputs and outputs.

Entered by `flexmbd.machine`.
"""
