"""Sparse matrices of blocks: in which order they are eliminated, their LU factors, solutions."""

from __future__ import annotations
