"""The machine: bodies, joints, forces, topology and the flat plan; numpy, scipy and numba only."""
