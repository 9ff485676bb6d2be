"""The discrete-gradient method that keeps energy and momenta.

Entered by `flexmbd.integrate`.
"""
