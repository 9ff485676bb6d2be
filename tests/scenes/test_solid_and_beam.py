"""The solid of demos/cantilever_tip_mass.py under loads of its throw: reduced it is its full model, and no beam."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import st_venant_kirchhoff
from flexmbd.record.strain_polynomial import StrainPolynomial
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction import ModalDerivatives, craig_bampton, prestressed

LENGTH, SIDE, E = 60.0, 12.0**0.5, 1e5
BENDING, AXIAL, SHEAR = E * 12.0, E * 12.0, 5.0 / 6.0 * E / 2.0 * 12.0
MOMENT = 0.5 * BENDING * 2.6 / LENGTH


def exact_beam(force, moment):
    """Deflection and angle of the tip of Reissner's plane beam under a dead force across it and a moment."""

    def slope(_, y):
        along, across = force * np.sin(y[2]), force * np.cos(y[2])
        stretch, slide = 1.0 + along / AXIAL, across / SHEAR
        dx = stretch * np.cos(y[2]) - slide * np.sin(y[2])
        dy = stretch * np.sin(y[2]) + slide * np.cos(y[2])
        return np.array([dx, dy, y[3] / BENDING, -force * dx])

    s = np.linspace(0.0, LENGTH, 61)
    found = solve_bvp(slope, lambda a, b: np.array([*a[:3], b[3] - moment]), s, np.zeros((4, 61)), tol=1e-9)
    return found.y[1:3, -1]


def reduced_solid(body, force, moment):
    """The same of the frame's displacement and polar rotation."""
    own = StrainPolynomial(body.stiffness, body.nonlinear.cubic, body.nonlinear.quartic)
    rows, (xx, yy, zz, yz, xz, xy) = body.interface("x_max").modes, body.nonlinear.face_strain[1]
    x, y, z = rows[3:]
    slopes = np.array([[xx, xy - z, xz + y], [xy + z, yy, yz - x], [xz - y, yz + x, zz]])
    q, R = np.zeros(body.n_modes), np.eye(3)
    for _ in range(40):
        R, turn = turned_face(np.eye(3) + slopes @ q, slopes)
        q = own.equilibrium(force * rows[2] - moment * turn[1], start=q)
    return np.array([rows[2] @ q, -Rotation.from_matrix(R).as_rotvec()[1]])


@pytest.fixture(scope="module")
def solid():
    """The model and its reduced body of twenty coordinates."""
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(20, 1, 1), cell="hexahedron", comm=MPI.COMM_SELF)
    steel = st_venant_kirchhoff.Parameters(E=E, nu=0.0, rho=0.02)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, st_venant_kirchhoff, steel, degree=2, interfaces=ends)
    choice = ModalDerivatives({"x_max.z": MOMENT / LENGTH, "x_max.ry": MOMENT}, tol=1e-5)
    return model, craig_bampton(model, modes=6, frame="x_min", nonlinear=choice)


@pytest.mark.parametrize(("force", "moment"), [(MOMENT / LENGTH, 0.0), (0.7 * MOMENT / LENGTH, 0.4 * MOMENT)])
def test_the_reduced_solid_is_its_own_full_solid(solid, force, moment):
    model, body = solid
    assert body.n_modes <= 20
    tip = prestressed(model, frame="x_min", forces={"x_max": [0.0, 0.0, force, 0.0, -moment, 0.0]}).interface("x_max")
    full = np.array([(tip.p - model.interface("x_max").p)[2], -Rotation.from_matrix(tip.R).as_rotvec()[1]])
    np.testing.assert_allclose(reduced_solid(body, force, moment), full, rtol=5e-6)
    # the beam is another continuum
    assert (abs(exact_beam(force, moment) / full - 1.0) > 2e-4).all()
