"""A quarter of a thick cylinder of perfect plasticity in plane strain, under pressure inside."""

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.slow_loading.static_path import prescribed_dofs
from flexmbd.forms import j2_plasticity as j2
from flexmbd.reduction.unit_loads import Pressure, load_vectors

COMM = MPI.COMM_WORLD

# A thick cylinder of perfect plasticity: inner and outer radius, m, and the flow stress of plane strain, Pa.
INNER, OUTER, E, NU = 0.1, 0.2, 210e9, 0.3
FLOW = 2 * 0.24e9 / np.sqrt(3)
LIMIT = FLOW * np.log(OUTER / INNER)


def cylinder(divisions, *, form=j2, comm=COMM, **options):
    """A quarter of it, what is held, and the forces of 1 Pa inside."""
    mesh = meshes.quarter_ring(0.02, OUTER, INNER, divisions=(*divisions, 1), comm=comm)
    p = form.Parameters(E=E, nu=NU, rho=7800.0, yield_stress=0.24e9)
    body = NonlinearModel(mesh, form, p, degree=1, **options)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"})
    return body, held, load_vectors(body, [Pressure("p", "inner")])[:, 0]
