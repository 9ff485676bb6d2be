"""Material laws that are compiled functions of a point, and the formulations made of them.

docs/laws.md.
"""
