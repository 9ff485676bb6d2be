"""MBDyn: modal joints' files, read back, and decks that use them.

Entered by users through `fm.export`, and by the list of formats.
"""
