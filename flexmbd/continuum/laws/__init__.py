"""Material laws that are compiled functions of a point, and formulations made of laws and of other formulations.

docs/laws.md.
"""
