"""Readers of a compiled scene's arrays, in the field's terms: the only code beside the kernels that knows columns.

Plain functions for Python code on ``arrays.Plan`` and ``arrays.Work``; ``plan_entries`` has those that kernels of
other rooms call.  ``SceneIndex`` gives the rows and entries of a body, joint or force.
"""
