"""The subcommands of `flexmbd`, one a file: `describe` gives its parser the arguments, and a function runs it.

Each loads what it needs when it is called, so that a record is inspected where there is no DOLFINx.
"""
