"""Reduced bodies and frequencies of parts."""
