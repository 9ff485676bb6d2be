"""A reduced body of two crosses on a beam, by hand."""

import dataclasses

import numpy as np

from flexmbd.record.reduced_body import InterfaceFrame, NodalModes, ReducedBody, Surface

# A rigid cross of four points at A = (0.1, 0.2, 0) and another at B, one metre on along x.  B moves
# along x on a spring and turns about x on a torsion spring.
CROSS = 0.3 * np.array([[0.0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
AT_A, AT_B = np.array([0.1, 0.2, 0.0]), np.array([1.1, 0.2, 0.0])
POINTS = np.vstack([AT_A + CROSS, AT_B + CROSS])
MASSES = np.array([2.0] * 4 + [0.5] * 4)
MASS_A, MASS_B = 8.0, 2.0
TURN_A, TURN_B = 8.0 * 0.3**2, 2.0 * 0.3**2
SPRING, TORSION = 5.0e4, 800.0
# B sits at A; its axes are those of A. The frame of B is turned a quarter about x.
QUARTER = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
# Modes by column, in displacement and rotation of B: axial, torsion; of unit modal mass.
SHAPE_B = np.zeros((6, 2))
SHAPE_B[0, 0] = 1 / np.sqrt(MASS_B)
SHAPE_B[3, 1] = 1 / np.sqrt(TURN_B)


def displacements():
    """(8 points, 3, 2) of the points in the two modes."""
    phi = np.zeros((8, 3, 2))
    phi[4:] = SHAPE_B[:3] + np.cross(SHAPE_B[3:].T, CROSS[:, None]).swapaxes(1, 2)
    return phi


def two_crosses(**changes):
    fields = np.concatenate(
        [np.ones((8, 1)), POINTS - AT_A, *np.moveaxis(displacements(), 2, 0)], axis=1
    )
    values = {
        "gram": (fields * MASSES[:, None]).T @ fields,
        "stiffness": np.array([TORSION / TURN_B, SPRING / MASS_B]),
        "damping": np.zeros((2, 2)),
        "interfaces": (
            InterfaceFrame("A", np.zeros(3), np.eye(3), np.zeros((6, 2))),
            InterfaceFrame("B", AT_B - AT_A, QUARTER, SHAPE_B),
        ),
        "frame": "A",
        "partition": np.diag([SHAPE_B[0, 0], SHAPE_B[3, 1]]),
        "partition_names": ("B.x", "B.rx"),
        "provenance": {"form": "by hand"},
    }
    # ascending: torsion first
    order = [0, 1, 2, 3, 7, 8, 9, 4, 5, 6]
    values["gram"] = values["gram"][np.ix_(order, order)]
    values["interfaces"] = tuple(
        dataclasses.replace(frame, modes=frame.modes[:, ::-1]) for frame in values["interfaces"]
    )
    values["partition"] = values["partition"][:, ::-1]
    return ReducedBody(**{**values, **changes})


def with_groups():
    phi = displacements()[..., ::-1]
    modes = NodalModes(np.array([3, 4, 8, 9, 11, 20, 21, 30]), POINTS - AT_A, phi)
    surface = Surface(POINTS[:4] - AT_A, np.array([[0, 1, 2], [0, 2, 3]]), phi[:4])
    return two_crosses(modes=modes, surface=surface)
