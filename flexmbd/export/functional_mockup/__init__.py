"""Functional mock-up units (FMI 3.0 and 2.0, co-simulation) whose binary is C: the importing host needs no Python."""
