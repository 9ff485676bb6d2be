"""Fixed-interface modes: how they are found and counted, how many are kept, which signs they have.

Entered by the reductions and by stiffening; stands on static shapes.
"""
