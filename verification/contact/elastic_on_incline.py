"""Elastic block that slides down an incline, at two sizes.

Cubes of 1.4 m and of 0.14 m, E = 100 MPa, mu = 0.3, on the slope on which Coulomb's law says 2.0385 m/s^2 whatever the
size; another program was seen to give 2.0427 and 1.3986. They start as they are made, so they sag and vibrate on the
incline until their damping has stilled them; patches that come down stick for an instant.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.forms import solid_linear
from flexmbd.reduction import ModalDamping, Patch, craig_bampton
from verification.contact._bodies import G, incline
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Closed form of Coulomb's law; the sizes are those of a public report on another program")
MU, SIZES, MODES, RTOL, SLIDES = 0.3, (1.4, 0.14), 10, 1e-4, 2.0385
ANGLE = float(np.arcsin(SLIDES / (G * np.hypot(1.0, MU))) + np.arctan(MU))
REFERENCES = (
    Reference("cubes of 1.4 m and of 0.14 m: acceleration", "m/s^2", (SLIDES,) * 2, 1e-9, Sureness.PRIMARY),
)


def slides(size: float) -> float:
    """m/s^2."""
    mesh = meshes.block(size, size, size, divisions=(4, 4, 4), comm=MPI.COMM_SELF)
    stuff = solid_linear.Parameters(E=1e8, nu=0.3, rho=1000.0)
    below = Patch("below", size=0.26 * size, facets="z_min")
    model = ContinuumModel(mesh, solid_linear, stuff, degree=2)
    record = craig_bampton(
        model, modes=MODES, geometric_stiffness=False, contact=[below], damping=ModalDamping(0.5)
    )
    scene, floor = incline(ANGLE)
    body = scene.add(fm.FlexibleBody(record), name="cube")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, 0.0, 0.5 * size, 1.0, 0.0, 0.0, 0.0)
    scene.touch(contact.ElasticSurface(body, "below"), floor, contact.Hard(mu=MU))
    run = scene.simulate(1.0, rtol=RTOL)
    t = np.array([0.6, 0.8, 1.0])
    x = run.position(body.frame(), t=t)
    moved = np.einsum("ni,tn->ti", record.gram[0, 4:].reshape(-1, 3), run.q(body, t=t)) / record.mass
    centre = x + np.einsum("tij,tj->ti", run.rotation(body.frame(), t=t), moved)
    return float(np.diff(centre[:, 0] + MU * centre[:, 2], n=2)[0] / 0.2**2)


def compute() -> Computed:
    """Both sizes."""
    return Computed(
        (numbers(*map(slides, SIZES)),), mesh="4 x 4 x 4 bricks, 10 modes, 16 patches", accuracy=f"rtol {RTOL:g}"
    )
