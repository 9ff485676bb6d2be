"""First frequency of a beam on a spinning hub, across the plane of turning, by more and more modes.

Against Timoshenko's equations of the whole blade, by polynomials: under the tension N(x) of the centrifugal force the
strain energy has N (theta w' - theta^2 / 2), w the deflection and theta the section's rotation, and the sections'
rotary inertia softens it.
"""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from numpy.polynomial import legendre

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import craig_bampton

HUB, OMEGA = 0.1, 40.0
SECTION = forms.beam_timoshenko.Parameters.rectangle(
    7e10, 0.3, 3000.0, width=0.02, height=0.01, orientation=(0, 1.0, 0)
)


def exact(omega):
    """First angular frequency, rad/s, of a blade 1 m long."""
    x, weight = legendre.leggauss(60)
    x, weight = (x + 1.0) / 2.0, weight / 2.0
    clamped = legendre.Legendre([0.5, 0.5], domain=[0, 1])  # x
    basis = [legendre.Legendre.basis(k, domain=[0, 1]) * clamped for k in range(16)]
    values, slopes = (np.array([f(x) for f in functions]) for functions in (basis, [f.deriv() for f in basis]))
    nothing = np.zeros_like(values)
    w, dw = np.vstack([values, nothing]), np.vstack([slopes, nothing])
    theta, dtheta = np.vstack([nothing, values]), np.vstack([nothing, slopes])

    def form(a, b, factor):
        product = (a * (weight * factor)) @ b.T
        return 0.5 * (product + product.T)

    p = SECTION
    shear, line = p.E / (2 * (1 + p.nu)) * p.A * p.kz, p.rho * p.A
    tension = line * omega**2 * ((1 - x**2) / 2 + HUB * (1 - x))
    stiffness = form(dtheta, dtheta, p.E * p.Iy) + form(dw - theta, dw - theta, shear)
    stiffness += 2 * form(theta, dw, tension) - form(theta, theta, tension + omega**2 * p.rho * p.Iy)
    mass = form(w, w, line) + form(theta, theta, p.rho * p.Iy)
    return np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[0])


def spun(record, speed):
    """The reduced blade on its hub at a speed (rad/s), linearised."""
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    blade = scene.add(fm.FlexibleBody(record), name="blade")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame())
    scene.connect(fm.joint.Fixed(), hub.frame(p=(HUB, 0, 0)), blade.frame("start"))
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    return scene.linearize(about=scene.equilibrium())


def first_frequency(model, modes):
    """rad/s, of the reduced blade."""
    return 2 * np.pi * spun(craig_bampton(model, modes=modes, frame="start"), OMEGA).frequencies()[0]


def test_frequencies_fall_to_the_exact_one():
    line = meshes.line(1.0, divisions=10, comm=MPI.COMM_SELF)
    model = ContinuumModel(line, forms.beam_timoshenko, SECTION, degree=2, interfaces=[Interface("start")])
    rest, turning = exact(0.0), exact(OMEGA)
    numbers = (2, 4, 6, 10, 20, 40)
    share = np.array([first_frequency(model, modes) ** 2 - rest**2 for modes in numbers]) / (turning**2 - rest**2)
    # from above, and down to what ten quadratic cells leave
    assert (share > 1.0 - 1e-6).all()
    assert (np.diff(share) < 1e-6).all()
    assert share[0] < 1.01
    assert (share[2:] < 1.0 + 1e-3).all()
    assert share[-1] == pytest.approx(1.0, abs=1e-4)


def test_campbell_diagram_of_the_blade():
    """Its first flap over the speed, and where the third and fourth engine orders meet it."""
    line = meshes.line(1.0, divisions=10, comm=MPI.COMM_SELF)
    model = ContinuumModel(line, forms.beam_timoshenko, SECTION, degree=2, interfaces=[Interface("start")])
    record = craig_bampton(model, modes=20, frame="start")
    diagram = fm.campbell(lambda speed: spun(record, speed), [0.0, 15.0, 30.0], orders=[3, 4])
    flap = [exact(speed) / (2 * np.pi) for speed in diagram.speeds]
    np.testing.assert_allclose(diagram.frequencies[:, 0], flap, rtol=1e-5)
    meeting = [scipy.optimize.brentq(lambda w, k=order: exact(w) - k * w, 1.0, 60.0) for order in (4, 3)]
    found = [one.speed for one in diagram.critical if one.branch == 0]
    np.testing.assert_allclose(found, meeting, rtol=1e-5)
