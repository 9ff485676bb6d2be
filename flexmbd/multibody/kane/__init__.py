"""Kane's equations by definition, a second way to the equations of motion, and bodies that users write so.

Entered by forces, the plan and reactions; knows bodies and joints.
"""
