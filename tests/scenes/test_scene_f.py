"""A slender beam of 19251 dofs, reduced, as a pendulum and spun up, against an independent oracle.

Box 1 x 0.05 x 0.05 m of 10-node tetrahedra (tests/data/beam_tet10), E = 2.1e9 Pa, rigid faces,
body frame on the face x = 0, 14 modes and six of the face x = 1, and what is stretched.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from exact_beam import PlanarBeam, hinged_tip

import flexmbd as fm
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid.tagged_mesh import from_arrays
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


def linear(beam):
    """Without the stretch of the modes."""
    return replace(beam, stretch=None)


@pytest.mark.parametrize(
    ("change", "expected", "within"),
    [(replace, [-0.08958, -0.99604], 5e-5), (linear, [-0.08977, -0.99602], 3e-5)],
    ids=["with stiffening", "without"],
)
def test_pendulum(beam, change, expected, within):
    """From the horizontal at rest: the tip after 0.5 s."""
    scene, body, _ = hinged(change(beam), "y", (0.0, 0.0, -9.81))
    run = scene.simulate(0.5, rtol=1e-4)
    tip = run.position(body.frame("tip"))[-1]
    assert tip[[0, 2]] == pytest.approx(expected, abs=within)
    assert abs(tip[1]) < 1e-6
    energy = run.energy()
    scale = np.ptp(energy.kinetic)
    np.testing.assert_allclose(energy.total, energy.total[0], atol=1e-6 * scale)


@pytest.mark.parametrize("change", [replace, linear], ids=["with stiffening", "without"])
def test_spin_up(beam, change):
    """A torque of 20 N m on the root face: the tip after 0.5 s, (0.92802, 0.37254) within 1e-4."""
    scene, body, hinge = hinged(change(beam), "z", (0.0, 0.0, 0.0))
    scene.add_force(fm.force.JointTorque(hinge, 20.0))
    # the torque sets in at once; the stiff vibrations that it excites are followed only at a tight rtol
    run = scene.simulate(0.5, rtol=1e-6)
    tip = run.position(body.frame("tip"))[-1]
    assert tip[:2] == pytest.approx([0.92802, 0.37254], abs=1e-4)
    # the work of the torque is the energy gained
    work = 20.0 * run.beta(hinge)
    np.testing.assert_allclose(run.energy().total, work, atol=1e-4 * work[-1])


SIDE = 0.05  # m, of the square section
EXACT = PlanarBeam(
    EA=2.1e9 * SIDE**2,
    # shear factor of a rectangle (Cowper 1966, doi:10.1115/1.3625046)
    GA=2.1e9 * SIDE**2 / (2 * 1.3) * 10 * 1.3 / (12 + 11 * 0.3),
    EI=2.1e9 * SIDE**4 / 12,
    rho_A=7850.0 * SIDE**2,
    rho_I=7850.0 * SIDE**4 / 12,
    length=1.0,
)


@pytest.mark.parametrize(("peak", "within", "apart"), [(40.0, 2e-5, 0.0), (600.0, 5e-4, 0.05)])
def test_swing_against_a_geometrically_exact_beam(beam, peak, within, apart):
    """A torque peak sin^2(2 pi t) N m on the hinge; at the higher one a linear body is a tenth of the length away."""
    exact = hinged_tip(EXACT, lambda t: peak * np.sin(2 * np.pi * t) ** 2, elements=20, h=5e-4, end=0.5)
    tips = []
    for body in (beam, linear(beam)):
        scene, one, hinge = hinged(body, "z", (0.0, 0.0, 0.0))
        scene.add_force(fm.force.JointTorque(hinge, lambda t: peak * np.sin(2 * np.pi * t) ** 2))
        tips.append(scene.simulate(0.5, rtol=1e-6).position(one.frame("tip"))[-1, :2])
    assert np.linalg.norm(tips[0] - exact) < within
    assert np.linalg.norm(tips[1] - exact) >= apart


def test_the_solution_does_not_depend_on_the_step_control(beam):
    """A fixed step gives the same tip, to its own second-order error."""
    scene, body, _ = hinged(beam, "y", (0.0, 0.0, -9.81))
    tips = [
        run.position(body.frame("tip"))[-1]
        for run in (scene.simulate(0.5, h=2.5e-4), scene.simulate(0.5, rtol=1e-4))
    ]
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-5)
