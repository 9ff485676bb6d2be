"""Many pseudo-rigid bodies as arrays: their free flight, and where they touch."""
