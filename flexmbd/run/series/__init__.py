"""What a trajectory is asked for: the motion between its steps, forces, and columns of tables."""
