"""A tree of boxes about the items of a table: which of them may be the nearest to a point.

A table begins with the count of its nodes, which follow in depth-first order: the box's lower and upper corners (m),
the node after all that is below it, and of a leaf where in the table its item begins, of others -1.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel

#: Numbers of a node.
NODE = 8


@kernel
def _beyond(x, low, high):
    """How far x is beyond an interval; 0 inside."""
    return max(max(low - x, x - high), 0.0)


@kernel
def _square_to_box(data, n, p):
    """The square of p's distance (m^2) from the box of the node at n."""
    x = _beyond(p[0], data[n], data[n + 3])
    y = _beyond(p[1], data[n + 1], data[n + 4])
    z = _beyond(p[2], data[n + 2], data[n + 5])
    return x * x + y * y + z * z


@kernel
def item_of(data, table, node):
    """Where the item of a leaf begins in ``data``."""
    return table + int(data[table + 1 + NODE * node + 7])


@kernel
def first_leaf(data, table, p):
    """The leaf that is reached by always entering the nearer box of two."""
    node, nodes = 0, table + 1
    while data[nodes + NODE * node + 7] < 0.0:
        left = node + 1
        right = int(data[nodes + NODE * left + 6])
        nearer = _square_to_box(data, nodes + NODE * left, p) <= _square_to_box(data, nodes + NODE * right, p)
        node = left if nearer else right
    return node


@kernel
def next_leaf(data, table, node, p, square):
    """The first leaf from a node on whose box is nearer to p than the root of ``square`` (m^2); -1 if none is."""
    nodes, count = table + 1, int(data[table])
    while node < count:
        n = nodes + NODE * node
        if _square_to_box(data, n, p) >= square:
            node = int(data[n + 6])
        elif data[n + 7] >= 0.0:
            return node
        else:
            node += 1
    return -1
