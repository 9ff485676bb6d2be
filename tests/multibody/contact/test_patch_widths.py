"""How far around the patches of a surface something is felt: widths of rectangles, from places and areas alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmbd.multibody.contact.patch_widths import felt_forms

SUPPORT = 1.75


def grid(counts, widths, R):
    """Centroids, normals and areas of rectangles in rows."""
    x = np.array([[i * widths[0], j * widths[1], 0.0] for i in range(counts[0]) for j in range(counts[1])])
    return x @ R.T, np.tile(R[:, 2], (len(x), 1)), np.full(len(x), widths[0] * widths[1])


SQUARES, ONE, STRIPS = ((5, 4), (1.0, 1.0)), ((1, 1), (2.0, 2.0)), (10.0, 0.087)


@pytest.mark.parametrize(
    ("counts", "widths"), [SQUARES, ONE, ((5, 4), (2e-3, 1e-3)), ((2, 9), STRIPS), ((1, 9), STRIPS)]
)
def test_rectangles_are_felt_by_their_widths(counts, widths):
    """In any frame, at edges and corners of the surface too; a row of strips is as wide as the area says."""
    R = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    forms = R.T @ felt_forms(*grid(counts, widths, R)) @ R
    reach = SUPPORT * np.array([*widths, np.sqrt(widths[0] * widths[1])])
    np.testing.assert_allclose(reach[:, None] * forms * reach, np.broadcast_to(np.eye(3), forms.shape), atol=1e-4)


def test_areas_are_kept_where_patches_are_anyhow():
    """Widths of scattered patches have the product that the area has; what is on the back does not count."""
    rng = np.random.default_rng(0)
    x = np.pad(rng.uniform(size=(60, 2)), ((0, 0), (0, 1)))
    area, normal = rng.uniform(0.5, 1.5, 60) / 60.0, np.tile([0.0, 0.0, 1.0], (60, 1))
    forms = felt_forms(x, normal, area)
    np.testing.assert_allclose(np.linalg.det(forms[:, :2, :2]) * (SUPPORT**2 * area) ** 2, 1.0, rtol=1e-9)
    back = np.concatenate([x, x - [0.0, 0.0, 2.0]])
    both = felt_forms(back, np.concatenate([normal, -normal]), np.tile(area, 2))
    np.testing.assert_allclose(both[:60], forms, rtol=1e-9)
    one = felt_forms(x[:1], normal[:1], area[:1])
    np.testing.assert_allclose(one[0] * SUPPORT**2 * area[0], np.eye(3), atol=1e-12)
