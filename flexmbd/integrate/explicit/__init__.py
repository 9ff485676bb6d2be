"""Explicit Runge-Kutta pairs and central differences, and loops by accelerations.

Entered by `flexmbd.integrate`.
"""
