"""What the arrays of a compiled scene say, in the words of the field: the one place beside kernels that knows columns.

Plain functions for Python code on ``arrays.Plan`` and ``arrays.Work``; ``columns`` has those that kernels of other
rooms call. Whoever asks by body, joint or force finds the numbers that are asked for here in ``SceneIndex``.
"""
