"""The flat plan of a scene: its numbering, rows, forces, and the compiled scene that carries it.

The only room beside the kernels that writes the layout of columns.
"""
