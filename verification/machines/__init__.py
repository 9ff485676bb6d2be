"""Machines of rigid bodies."""
