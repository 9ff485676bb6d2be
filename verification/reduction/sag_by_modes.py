"""Cantilever under its weight by static shapes and modes.

1 m x 0.1 m x 0.1 m, E = 100 MPa, nu = 0.3, 1000 kg/m^3, held at one end by an interface: the tip sinks by rho A g L^4
/ 8 EI.
"""

from __future__ import annotations

from mpi4py import MPI

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Zwoelfer & Gerstmayr, Exudyn's CMS tutorial; Euler and Bernoulli's beam")
SAG = 1000.0 * 9.81 * 0.01 / (8.0 * 1e8 * 0.1**4 / 12.0)
REFERENCES = (Reference("sag of the tip, linear", "m", (SAG,), 5e-4, Sureness.PRIMARY),)


def compute() -> Computed:
    """Stiff in shear, and with both ends as interfaces, so that weight asks for the modes."""
    second = 0.1**4 / 12.0
    section = beam_timoshenko.Parameters(
        E=1e8,
        nu=0.3,
        rho=1000.0,
        A=0.01,
        Iy=second,
        Iz=second,
        J=2.0 * second,
        ky=1e4,
        kz=1e4,
        orientation=(0.0, 1.0, 0.0),
    )
    mesh = meshes.line(1.0, divisions=16, comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, beam_timoshenko, section, degree=2, interfaces=[Interface("start"), Interface("end")])
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    beam = scene.add(fm.FlexibleBody(craig_bampton(model, modes=11, frame="start")), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("start"))
    sag = -scene.equilibrium().position(beam.frame("end"))[2]
    return Computed((numbers(sag),), mesh="16 quadratic beam elements, 11 modes of Craig and Bampton")
