"""A cube pulled at the middle of two faces: pseudo-rigid, and by finite elements, as the load grows.

For a linear material the mean strain of a body depends on its surface loads' moments alone, which a pseudo-rigid body
takes in exactly; so its error in the mean stretch is of second order in the load.
"""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.forms import st_venant_kirchhoff
from flexmbd.reduction.unit_loads import Traction, load_vectors

HALF, E, NU, DENSITY = 0.1, 1.0e6, 0.3, 1000.0
CELLS = 4  # along an edge of the eighth; two of them along the patch's
PATCH = 0.25  # share of the face that is pulled
TENSIONS = np.array([0.0025, 0.005, 0.01]) * E / PATCH  # Pa on the patch


def eighth():
    """The cube's eighth from its middle, of bricks."""
    ticks = np.linspace(0.0, HALF, CELLS + 1)
    z, y, x = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    number = np.arange((CELLS + 1) ** 3).reshape((CELLS + 1,) * 3)
    corners = [number[k : k + CELLS, j : j + CELLS, i : i + CELLS] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    near, middle = 1e-9, HALF / 2 + 1e-9
    groups = {f"{axis}_min": lambda x, i=i: x[i] < near for i, axis in enumerate("xyz")}
    groups["patch"] = lambda x: (x[0] > HALF - near) & (x[1] < middle) & (x[2] < middle)
    groups["right"] = lambda x: (x[0] > HALF - near) & (x[1] > HALF / 2 - near)
    groups["above"] = lambda x: (x[0] > HALF - near) & (x[1] < middle) & (x[2] > HALF / 2 - near)
    groups["y_max"] = lambda x: x[1] > HALF - near
    return from_arrays(
        MPI.COMM_SELF,
        np.column_stack([part.ravel() for part in (x, y, z)]),
        np.stack([part.ravel() for part in corners], axis=1),
        cell="hexahedron",
        degree=1,
        facet_groups=groups,
    )


def mean_stretches(tensions):
    """(k, 2) of the finite elements, along the pull and across: the mean of grad u is that of u n over the surface."""
    body = NonlinearModel(
        eighth(), st_venant_kirchhoff, st_venant_kirchhoff.Parameters(E=E, nu=NU, rho=DENSITY), degree=1
    )
    loads = [Traction(name, name, (1.0, 0.0, 0.0)) for name in ("patch", "right", "above")]
    patch, *rest = load_vectors(body, loads).T
    (side,) = load_vectors(body, [Traction("side", "y_max", (0.0, 1.0, 0.0))]).T
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z"})
    found = []

    def look(_):
        u = body.displacement[: len(patch)]
        found.append([1.0 + (patch + sum(rest)) @ u / HALF**3, 1.0 + side @ u / HALF**3])

    follow(body, tensions, prescribed=held, load=lambda p: p * patch, accepted=look)
    return np.array(found)


def pseudo_rigid_stretches(tension):
    """(2,) at rest, in a machine: two forces pull the damped body at the middles of its faces."""
    cube = fm.Solid.box((2 * HALF,) * 3, density=DENSITY)
    scene = fm.System()
    body = scene.add(fm.PseudoRigidBody(cube, fm.StVenantKirchhoff(E, NU), damping=1.0))
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    force = tension * PATCH * (2 * HALF) ** 2
    for side in (-1.0, 1.0):
        end = body.frame((side * HALF, 0.0, 0.0))
        scene.add_force(fm.force.FrameForce(end, force=(side * force, 0.0, 0.0)))
    eight = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
    return scene.simulate(0.3, rtol=1e-9, integrator=eight).stretch(body)[-1][[0, 1], [0, 1]]


def test_the_error_is_of_second_order_in_the_load():
    rigid = np.array([pseudo_rigid_stretches(p) for p in TENSIONS])
    solid = mean_stretches(TENSIONS)
    off = abs(rigid - solid)
    strain = solid - 1.0
    assert (off[0] < 0.02 * abs(strain[0])).all()
    assert np.log2(off[1:] / off[:-1]) == pytest.approx(np.full((2, 2), 2.0), abs=0.15)
    # and a pull over the whole faces, which leaves the cube homogeneous, has no error: W' = P
    lam, mu = fm.StVenantKirchhoff(E, NU).lame
    U = np.diag([rigid[-1, 0], rigid[-1, 1], rigid[-1, 1]])
    strains = 0.5 * (U @ U - np.eye(3))
    stress = U @ (lam * np.trace(strains) * np.eye(3) + 2 * mu * strains)
    assert np.diag(stress) == pytest.approx([PATCH * TENSIONS[-1], 0.0, 0.0], abs=1e-6 * E)
