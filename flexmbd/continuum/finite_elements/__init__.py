"""A mesh and a form made a model: unknowns, assembly, interfaces, masses, stresses.

Entered by the rooms of bodies with history and by the reduction, whose input the model is.
"""
