"""A slender beam of 19251 dofs, reduced, as a pendulum and spun up, against an independent oracle.

Box 1 x 0.05 x 0.05 m of 10-node tetrahedra (tests/data/beam_tet10), E = 2.1e9 Pa, rigid faces,
body frame on the face x = 0, 20 modes; no geometric stiffening.
"""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.tagged_mesh import from_arrays
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton

MESH = Path(__file__).parents[1] / "data" / "beam_tet10" / "beam_19k_tet10_netgen.npz"


@pytest.fixture(scope="module")
def beam():
    arrays = np.load(MESH)
    mesh = from_arrays(
        MPI.COMM_SELF,
        arrays["points"],
        arrays["tet10"],
        cell="tetrahedron",
        degree=2,
        facet_groups={
            "root": lambda x: np.isclose(x[0], 0.0),
            "tip": lambda x: np.isclose(x[0], 1.0),
        },
    )
    steel_like = solid_linear.Parameters(E=2.1e9, nu=0.3, rho=7850.0)
    model = ContinuumModel(
        mesh, solid_linear, steel_like, degree=2, interfaces=[Interface("root"), Interface("tip")]
    )
    return craig_bampton(model, modes=14, frame="root")


def hinged(beam, axis, gravity):
    scene = fm.System(gravity=gravity)
    body = scene.add(fm.FlexibleBody(beam), name="beam")
    return scene, body, scene.connect(fm.joint.Revolute(axis), scene.ground.frame(), body.frame("root"))


def test_frequencies(beam):
    """Clamped 4.181 and 25.90 Hz, hinged about y 18.204 Hz."""
    assert beam.frequencies(clamped=["root"])[[0, 2]] == pytest.approx([4.181, 25.90], abs=5e-3)
    hinge = beam.frequencies(clamped={"root": ("x", "y", "z", "rx", "rz")})
    assert hinge[1] == pytest.approx(18.204, abs=5e-4)


def test_pendulum(beam):
    """From the horizontal at rest: the tip after 0.5 s, (-0.08977, -0.99602) within 3e-5."""
    scene, body, _ = hinged(beam, "y", (0.0, 0.0, -9.81))
    run = scene.simulate(0.5, rtol=1e-4)
    tip = run.position(body.frame("tip"))[-1]
    assert tip[[0, 2]] == pytest.approx([-0.08977, -0.99602], abs=3e-5)
    assert abs(tip[1]) < 1e-6
    energy = run.energy()
    scale = np.ptp(energy.kinetic)
    np.testing.assert_allclose(energy.total, energy.total[0], atol=1e-5 * scale)


def test_spin_up(beam):
    """A torque of 20 N m on the root face: the tip after 0.5 s, (0.92802, 0.37254) within 1e-4."""
    scene, body, hinge = hinged(beam, "z", (0.0, 0.0, 0.0))
    scene.add_force(fm.force.JointTorque(hinge, 20.0))
    run = scene.simulate(0.5, rtol=1e-4)
    tip = run.position(body.frame("tip"))[-1]
    assert tip[:2] == pytest.approx([0.92802, 0.37254], abs=1e-4)
    # the work of the torque is the energy gained
    work = 20.0 * run.beta(hinge)
    np.testing.assert_allclose(run.energy().total, work, atol=1e-4 * work[-1])


def test_the_solution_does_not_depend_on_the_step_control(beam):
    """A fixed step gives the same tip, to its own second-order error."""
    scene, body, _ = hinged(beam, "y", (0.0, 0.0, -9.81))
    tips = [
        run.position(body.frame("tip"))[-1]
        for run in (scene.simulate(0.5, h=2.5e-4), scene.simulate(0.5, rtol=1e-4))
    ]
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-5)
