"""Loads on the contact patches of a record, from the unreduced mesh by rules of integration."""

from __future__ import annotations

import itertools

import numpy as np


def loads_of(body, full):
    """(3 n, 3 p) nodal forces of unit loads on patches of flat facets of degree 2, in the order of `FullModel`."""
    contact, numbers = body.contact, {tuple(np.round(x, 9) + 0.0): i for i, x in enumerate(full.x)}
    loads = np.zeros((len(full.x), 3, 3 * len(contact.area)))
    area = np.zeros(len(contact.area))
    for corners, patch in zip(contact.facet, contact.patch, strict=True):
        x = full.x[corners]
        one, other = x[1] - x[0], x[-1] - x[0]
        if len(x) == 4:  # of a parallelogram Simpson's rule
            nodes = [x[0] + one * s + other * t for s, t in itertools.product((0.0, 0.5, 1.0), repeat=2)]
            weights = [a * b / 36 for a, b in itertools.product((1, 4, 1), repeat=2)]
            size = np.linalg.norm(np.cross(one, other))
        else:  # of a triangle the middles of the edges
            nodes, weights = [(x[i] + x[i - 1]) / 2 for i in range(3)], [1 / 3] * 3
            size = np.linalg.norm(np.cross(one, other)) / 2
        area[patch] += size
        axes = body.R_MB @ contact.axes[patch]
        for node, weight in zip(nodes, weights, strict=True):
            loads[numbers[tuple(np.round(node, 9) + 0.0)], :, 3 * patch : 3 * patch + 3] += size * weight * axes
    np.testing.assert_allclose(contact.area, area, rtol=1e-12)
    return (loads / np.repeat(area, 3)).reshape(3 * len(full.x), -1)
