"""A beam that bends far, as a chain of reduced pieces, with a heavy tip: against a geometrically exact beam."""

import numpy as np
from exact_beam import PlanarBeam, clamped_tip

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import craig_bampton

# The beam and the tip of Zienkiewicz & Taylor's section 8.6.2, with the centre of the tip mass on the beam's end.
LENGTH, SIDE, MASS, INERTIA = 60.0, 12.0**0.5, 64.0, 64.0 * 16.0 / 6.0
PEAK, END = 1500.0, 6.0
SECTION = forms.beam_timoshenko.Parameters.rectangle(
    1e5, 0.3, 0.02, width=SIDE, height=SIDE, orientation=(0.0, 1.0, 0.0)
)
EXACT = PlanarBeam(
    EA=1.2e6,
    GA=1e5 / 2.6 * 12.0 * SECTION.ky,
    EI=1.2e6,
    rho_A=0.24,
    rho_I=0.24,
    length=LENGTH,
)


def pulse(t):
    return PEAK * max(0.0, 1.0 - abs(t - 1.0))


def chain(pieces):
    """The tip's place (2,) m at the end of the run."""
    mesh = meshes.line(LENGTH / pieces, divisions=4)
    ends = [Interface("start"), Interface("end")]
    model = ContinuumModel(mesh, forms.beam_timoshenko, SECTION, degree=2, interfaces=ends)
    record = craig_bampton(model, modes=2, frame="start")
    scene = fm.System()
    below = scene.ground.frame()
    for k in range(pieces):
        body = scene.add(fm.FlexibleBody(record), name=f"piece {k}")
        scene.connect(fm.joint.Fixed(), below, body.frame("start"))
        below = body.frame("end")
    tip = scene.add(fm.RigidBody(MASS, INERTIA * np.ones(3)), name="tip")
    scene.connect(fm.joint.Fixed(), below, tip.frame())
    scene.add_force(fm.force.FrameForce(tip.frame(), force=(0.0, pulse, 0.0)))
    return scene.simulate(END, rtol=1e-6).position(tip.frame())[-1, :2]


def test_a_chain_of_pieces_comes_to_the_exact_beam_faster_than_with_the_square_of_their_length():
    exact = clamped_tip(EXACT, pulse, tip=(MASS, INERTIA), elements=40, h=0.01, end=END)
    assert np.linalg.norm(exact - [LENGTH, 0.0]) > 0.4 * LENGTH
    coarse, fine = chain(4), chain(8)
    assert np.linalg.norm(coarse - exact) / np.linalg.norm(fine - exact) > 5.0
    # of which the exact beam of so many elements has a tenth
    assert np.linalg.norm(fine - exact) < 1.3e-3 * LENGTH
