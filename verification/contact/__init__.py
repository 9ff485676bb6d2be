"""Bodies that touch."""
