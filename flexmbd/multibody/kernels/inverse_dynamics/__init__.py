"""Forces that a motion asks for: the recursion outward and inward, force elements, loops, momenta.

Entered by integrators, the tangent and the forward dynamics.
"""
