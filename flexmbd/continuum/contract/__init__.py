"""What a form file must provide: its Protocol, what breaks it, and where its unknowns lie.

Entered by the continuum's other rooms and by `flexmbd check`.  Knows no mesh but a reference cell.
"""
