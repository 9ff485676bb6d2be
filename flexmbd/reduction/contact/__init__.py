"""Contact patches of a reduced body: where it may be touched, and the flexibility there that its modes leave out.

Entered by `flexmbd.reduction`'s files.  Knows models, modes and statics, and no laws of contact.
"""
