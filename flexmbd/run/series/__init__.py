"""Series of a trajectory: the motion between its steps, forces, and columns of tables."""
