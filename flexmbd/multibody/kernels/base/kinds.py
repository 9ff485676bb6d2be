"""The vocabulary of a compiled scene: kinds of joints, constraint rows, functions of time.

Plain integers, which kernels compile as constants.  Joints say by them what they are; nothing is to be read from their
order.  Force elements: ``elements.table``.
"""

from __future__ import annotations

# How a joint lets its outer frame turn: not at all, about the z axis that both frames share, or about any axis, by a
# quaternion.
TURN_NONE, TURN_ABOUT_Z, TURN_BALL = range(3)

# Whether a body's frame may rotate, decided from the joints between it and the ground.  Of a flexible body whose frame
# never does, the residual leaves out angular accelerations, Coriolis and centrifugal terms: 1.33 times faster, of 20
# modes (benchmarks/skipping.py).
NONROTATING, ROTATING = range(2)

# Kinds of constraint rows between frames F and G; d = p_FG_F, R = R_FG, n the z axis of G in F, "angle" that of the
# turn about z (the twist).
ROW_TRANSLATION = 0  # d[index] = 0
ROW_DIRECTION = 1  # R[index // 3, index % 3] = 0
ROW_AXIS = 2  # component index of the axis of R = 0
ROW_ANGLE = 3  # angle = 0, to the nearest turn
ROW_SCREW = 4  # d[2] - pitch angle = 0, to the nearest turn; data: pitch (m/rad)
ROW_DISTANCE = 5  # |d| = L; data: L (m)
ROW_TOUCH = 6  # the rim of a disc about n in the plane z = 0; data: its radius (m)
ROW_ROLL = 7  # the touching point's velocity along axis index of F = 0 (velocity level); data: the radius
# sum r_k x_k = c over coordinates of the tree, no frames; data: their number, c, (tree row, which of its joint's
# coordinates that add, r_k) ...
ROW_COUPLING = 8
ROWS_IN_RAD = (ROW_DIRECTION, ROW_AXIS, ROW_ANGLE)  # their multipliers are moments, those of the others forces
# What a row holds: positions, or velocities alone.
LEVEL_POSITION, LEVEL_VELOCITY = range(2)

# Kinds of functions of time.
TIME_PIECEWISE, TIME_SINE, TIME_COMPILED, TIME_PYTHON = range(4)

# Kinds of error-norm groups: coordinates of one group share one scale.
# GROUP_STATE: states of a user's equations, in their own scales; what is theirs is the velocity of a link.
GROUP_ANGLE, GROUP_LENGTH, GROUP_MODAL, GROUP_STATE = range(4)

# Values of Plan.flag.
FLAG_PYTHON, FLAG_ELEMENT, FLAG_TIME = 1, 2, -1
