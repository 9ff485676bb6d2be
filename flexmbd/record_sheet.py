"""The readable sheet of a reduced body."""
