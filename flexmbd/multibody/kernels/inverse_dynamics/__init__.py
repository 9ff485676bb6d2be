"""Forces that a motion requires: the recursion outward and inward, force elements, loops, momenta.

Entered by integrators, the tangent and the forward dynamics.
"""
