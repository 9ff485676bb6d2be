"""A consistent start: loops closed, rates matched, rows chosen, impulses taken.

Entered by what runs or linearises a machine; works on a compiled scene.
"""
