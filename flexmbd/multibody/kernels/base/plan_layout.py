"""The columns of a compiled scene's arrays (``arrays.Plan``, ``arrays.Work``): for the kernels and the plan's room."""

from __future__ import annotations

# Columns of Plan.tree, one row a body, parents before children.  The inner links of a joint of several steps are
# rows of no mass.
PARENT = 0  # row of the parent body, -1 the ground
JOINT_TURN = 1  # how the inboard joint turns: kinds.TURN_NONE to kinds.TURN_BALL
FRAME_PARENT = 2  # row of Plan.frames: the joint's frame on the parent
FRAME_CHILD = 3  # row of Plan.frames: the joint's frame on this body
JOINT_X = 4  # first entry of the joint in the configuration x
JOINT_V = 5  # first entry of the joint in the velocity v
FLEX = 6  # row of Plan.flex, -1 for a rigid body
MODAL_X = 7  # first entry of q in x
MODAL_V = 8  # first entry of q's rate in v
JOINT_DATA = 9  # offset in Plan.data of the turn and slide of each coordinate that adds, see physics.joints
ROTATION = 10  # whether the body's frame may rotate: kinds.NONROTATING or kinds.ROTATING
JOINT_ADDS = 11  # how many of the joint's coordinates add; a ball's quaternion follows them
JOINT_SIZE = 12  # number of the joint's velocities: those that add, and a ball's three
N_TREE = 13

# Columns of Plan.frames: p_BF_B (3), R_BF (9).
FRAME_P, FRAME_R, N_FRAME = 0, 3, 12

# Columns of Plan.frame_of: the body (-1 ground), the offset of its 6 x n mode rows in Plan.modal (-1: the frame does
# not deform against the body frame), and that of the 6 x n rows of its face's strain (-1: its modes turn it by
# exp(theta); else see physics.face_modes).
FRAME_BODY, FRAME_MODES, FRAME_STRAIN, N_FRAME_OF = 0, 1, 2, 3

# Columns of Plan.rigid: mass, first moment (3), second moment xx xy xz yy yz zz, all about B.
MASS, FIRST_MOMENT, SECOND_MOMENT, N_RIGID = 0, 1, 4, 10

# Columns of Plan.shafts, one-dimensional inertias: index in v of a joint's coordinate, kg m^2 or kg per unit of it.
SHAFT_V, SHAFT_INERTIA, N_SHAFT = 0, 1, 2

# Columns of Plan.flex: number of modes and offsets in Plan.modal.  What a record has not is left out: damping is 1.2 of
# an evaluation's time, of 20 modes, five membrane strains are 1.9 of it (benchmarks/skipping.py).
N_MODES = 0
MODAL_FIRST = 1  # (3, n) integrals of rho phi_i
MODAL_MOMENTS = 2  # (1 + n, 9, n) moments of the modes with x and with each mode, see physics.modal_moments
MODAL_STIFFNESS = 3  # (n,) diagonal of K_qq
MODAL_DAMPING = 4  # (n, n) D_qq and the skew G of gyroscopic forces, or -1 where both are zero
# Rows of stretch: a membrane strain's slope c (n), and the lower triangle of its C (n (n + 1) / 2); their number, 0
# where there are none.
STRETCH = 5
N_STRETCH = 6
GYROSCOPIC = 7  # angular momentum h (3) of rotors inside, and its slope H (3, n) by the modes; -1 where there are none
POLYNOMIAL = 8  # cubic and quartic coefficients of the strain energy, see physics.energy_polynomial; -1: there are none
N_FLEX = 9

# Columns of Plan.rows, one row a scalar constraint between frames F and G: its kind and index, the offset of its
# parameters in Plan.data, whether it holds positions or velocities alone, the function of time (-1: none) that is
# subtracted from its value, and the offset in Plan.data of its augmented Lagrangian's parameters (0: none).
ROW_F, ROW_G, ROW_KIND, ROW_INDEX, ROW_DATA, ROW_LEVEL, ROW_TIME, ROW_ENFORCEMENT, N_ROW = range(9)
# Those parameters: stiffness, damping, the largest gap that counts as closed (m or rad; m/s where velocities are
# held), and the same divided by the machine's extent.
ENFORCEMENT_STIFFNESS, ENFORCEMENT_DAMPING, ENFORCEMENT_GAP, ENFORCEMENT_TOLERANCE, N_ENFORCEMENT = range(5)

# Columns of Plan.forces: v index and time function of a joint force.
FORCE_V, FORCE_TIME, N_FORCE = 0, 1, 2

# Columns of Plan.elements, one row a force element: its kind; frames F and G; index in x and in v of its coordinate;
# row of Plan.times that scales it (-1: one); offset in Plan.data; a count; the addresses of a user's function and of
# its derivative; its number in the scene, by which messages name it where others are left out.
EL_KIND, EL_F, EL_G, EL_X, EL_V, EL_TIME, EL_DATA, EL_COUNT, EL_ADDRESS = range(9)
EL_NUMBER, EL_MEMORY, EL_SIDE, EL_SCRATCH, N_ELEMENT = 10, 11, 12, 13, 14
# EL_X, EL_V of an element between frames: which of the loads on frames that states set it is, and where the states of
# its own begin in v; -1 where there are none.
# EL_SCRATCH: how many numbers of ``Work.generalized`` it needs; 0, or less than 0, where it says so by EL_COUNT.
# EL_SIDE: where in x it stands on which side (1, -1) of its switch a user's function is, -1 where it has none; on the
# negative side the second address is that of the function.
# EL_MEMORY: where its memory begins in the configuration x, -1 where it has none: when it was written (s), at which
# deformation (m or rad) and rate, on which piece of the law; then as many numbers of the law as EL_COUNT says
# (of a rough contact ``contact.bristle``).
MEMORY_TIME, MEMORY_DEFORMATION, MEMORY_RATE, MEMORY_PIECE, N_MEMORY_HEAD = range(5)
# Of such an element, in Plan.data: where the deformation is zero, how many numbers its law has, and these.
MEMORY_LAW_NUMBERS = 2

# Columns of Plan.driven: v index, x index, time function of a prescribed coordinate.
DRIVEN_V, DRIVEN_X, DRIVEN_TIME, N_DRIVEN = 0, 1, 2, 3

# Columns of Plan.times: kind, offset in Plan.time_data, and a count or an address.
TIME_KIND, TIME_OFFSET, TIME_COUNT, TIME_ADDRESS, N_TIME = 0, 1, 2, 3, 6
# TIME_ADDRESS .. TIME_ADDRESS + 2: addresses of value, rate, acceleration, 0 where absent.

# Columns of Work.body.
B_R, B_P = 0, 9  # pose R_WB, p_WB_W
B_W, B_V = 12, 15  # w_WB_B, velocity of B's origin in B's axes
B_DW, B_A = 18, 21  # angular acceleration; acceleration of the origin minus gravity; in B
B_F, B_T = 24, 27  # wrench about B's origin that the motion requires, in B
B_JOINT_P, B_JOINT_R = 30, 33  # p_FG_F and R_FG of the inboard joint
B_COORDINATE = 42  # the coordinates of the inboard joint that add, four at most: each with its rate and acceleration
N_BODY_WORK = 54

# Rows of Work.moments, see physics.modal_moments.
N_MOMENTS = 15

# Columns of Work.frame.
F_P, F_R = 0, 3  # p_BF_B, R_BF of the deformed body
F_THETA = 12  # rotation vector of the deformation
F_V, F_W, F_A, F_DW = 15, 18, 21, 24  # motion of the frame against B, in B
F_STRAIN = 27  # S of the face's motion [F_THETA] + S, where FRAME_STRAIN says that it has one
N_FRAME_WORK = 33
