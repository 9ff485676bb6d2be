"""Exudyn: reduced bodies as its archives, read back, and put into its scenes.

Entered by users through `fm.export`, and by the list of formats.
"""
