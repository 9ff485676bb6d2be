"""The laws: joints, rows of constraints, inertia, elasticity, energies, functions of time.

Entered by the recursions; each law for one body, joint or frame.
"""
