"""Static shapes: the stiffness inverted, by a factor or by conjugate gradients, with interfaces bound or averaged.

Entered by the other rooms of the reduction.  Knows models and matrices, and no modes.
"""
