"""Many pseudo-rigid bodies as arrays, which fly freely or touch each other."""
