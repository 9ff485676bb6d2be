"""Functions of time and of the state that users give: data, compiled code, Python; where they break.

Entered by joints, forces and what steps a machine.
"""
