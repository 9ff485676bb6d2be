"""What a user sees on printing an object: its sizes in one line, however large its arrays are."""

import numpy as np
from beam_records import Beam
from machines import slider_crank


def test_objects_with_large_arrays_print_their_sizes():
    scene, _, _ = slider_crank()
    assert repr(scene) == "<System: 3 bodies, 4 joints, 0 forces, 0 couplings>"
    assert repr(scene.linearize()) == "<LinearizedMachine: 1 coordinates, 1 velocities, 0 controls, 0 disturbances>"
    start = scene.start()
    assert repr(start).startswith("<Start: 3 velocities, 2 rows closed to")
    assert repr(start.scene) == "<CompiledScene: 3 velocities, 2 rows>"
    run = scene.simulate(0.1, h=0.01)
    assert repr(run) == "<Trajectory of 3 bodies, 3 velocities: 0 to 0.1 s in 10 steps>"


def test_a_reduced_body_prints_what_it_holds():
    body = Beam(length=1.0, width=0.1, height=0.1, E=1e9, rho=1000.0, modes=2, damping=0.0, frame="a").record()
    mass = 1000.0 * 0.1 * 0.1 * (0.75 + np.hypot(0.25, np.hypot(0.125, 0.25)))
    assert repr(body).startswith(f"<ReducedBody: 8 modes, {mass:.6g} kg, interfaces a, b")
    assert len(repr(body)) < 120
