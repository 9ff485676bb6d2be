"""Integrators, one a file, written against the residual, the retraction and the constraints."""
