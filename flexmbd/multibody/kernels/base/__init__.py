"""What kernels stand on: how they are compiled, called by address, and the layout of the plan.

Entered by all kernels; knows numba and LAPACK.
"""
