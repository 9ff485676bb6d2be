"""The contract of a form file: its Protocol, its violations, and the layout of its unknowns.

Entered by the continuum's other rooms and by `flexmbd check`.  Knows no mesh but a reference cell.
"""
