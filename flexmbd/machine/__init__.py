"""Machines as users build and ask them: the system, the compiled machine, the linearised machine.

Entered by users through `flexmbd.names`, and by exports and scene files.
"""
