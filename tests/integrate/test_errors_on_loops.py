"""Error control of generalized-alpha on closed loops: errors along the loops count, what the rows hold does not.

Accelerations and reactions of a step err across the rows, with a sign that changes from step to step, while rows hold
positions and velocities there.
"""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.scene_matrices import mass_factor, scaled_jacobian
from flexmbd.multibody.team import Alone
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepping import Integration

END = 0.2
EXACT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def crank_and_rod(*, state=None):
    """A slider-crank and its joints; ``state``: angles (3,) and rates (3,) of the tree's joints."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    turn = fm.joint.Revolute("z")
    crank = scene.add(fm.RigidBody(0.9, (4e-4, 6e-4, 8e-4), (0.02, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(1.0, (1e-4, 8e-3, 8e-3), (0.15, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.5, (2e-4, 2e-4, 2e-4)), name="piston")
    joints = [
        scene.connect(turn, scene.ground.frame(), crank.frame()),
        scene.connect(turn, crank.frame(p=(0.08, 0.0, 0.0)), rod.frame()),
        scene.connect(turn, rod.frame(p=(0.3, 0.0, 0.0)), piston.frame()),
    ]
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())
    scene.add_force(fm.force.JointTorque(joints[0], 2.0))
    lean = -np.arcsin(0.08 * np.sin(0.5) / 0.3)
    angles, rates = ((0.5, lean - 0.5, -lean), (30.0, None, None)) if state is None else state
    for joint, angle, rate in zip(joints, angles, rates, strict=True):
        joint.position = float(angle)
        if rate is not None:
            joint.velocity = float(rate)
    return scene, joints


def angles_and_rates(run, joints, t):
    """(2, 3) at t."""
    return np.array([[float(ask(j, t=t)[0]) for j in joints] for ask in (run.beta, run.beta_rate)])


def test_what_accelerations_swing_by_across_the_rows_rejects_no_step():
    """A tenth of them, along M^-1 C^T: no shorter step takes it away, and none is a vibration."""
    scene, _ = crank_and_rod()
    start, method = scene.start(), fm.GeneralizedAlpha()
    at = new_snapshot(start, method, t_start=0.0, t_end=END, rtol=1e-6, h=None)
    run = Integration(start, method, Alone(), at, one_by_one=True)
    for _ in range(500):
        run.advance(END)
        run.keep_rows()
    state, work = run.state, new_work(start.scene.plan)
    lower, rows = mass_factor(start.scene, work, state.x), scaled_jacobian(start.scene, work, state.x)
    across = np.linalg.solve(lower.T, rows[0])
    state.a[:] += 0.1 * np.abs(state.a).max() / np.abs(across).max() * across
    length, rejected = state.numbers[st.STEP], state.counts[st.REJECTED]
    lengths, rejections = [], []
    for _ in range(100):
        run.advance(END)
        run.keep_rows()
        lengths.append(state.numbers[st.STEP_BEFORE])
        rejections.append(state.counts[st.REJECTED] - rejected)
    # in twenty steps the swing falls to a hundredth; the rows' slopes are those of the last factors
    assert rejections[20] <= 1
    assert min(lengths) > 0.1 * length
    assert 0.5 * length < lengths[-1] < 2.0 * length


def allowed_at_the_end():
    """What rtol allows the crank's angle to be off by at the end, over rtol.

    The sum, over the machine's radians, of what an error of 1 rad, and of the largest speed met, makes of the end.
    """
    scene, joints = crank_and_rod()
    run = scene.simulate(END, rtol=1e-12, integrator=EXACT)
    times = (np.arange(24) + 0.5) * END / 24
    total = 0.0
    for t in times:
        angles, rates = angles_and_rates(run, joints, [t])
        met = run.t <= t
        speed = np.abs(run.v[met]).max()
        rate = max(speed, np.sqrt(np.abs(run.a[met]).max()))
        ends = []
        for turn, faster in ((1e-5, 0.0), (-1e-5, 0.0), (0.0, 1e-4), (0.0, -1e-4)):
            twin, hinges = crank_and_rod(state=((angles[0] + turn, *angles[1:]), (rates[0] + faster, None, None)))
            ends.append(twin.simulate(END, t_start=t, rtol=1e-11, integrator=EXACT).beta(hinges[0])[-1])
        by_angle, by_rate = abs(ends[0] - ends[1]) / 2e-5, abs(ends[2] - ends[3]) / 2e-4
        total += rate * (by_angle + by_rate * speed) * END / 24
    return total, run.beta(joints[0])[-1]


def test_error_on_loops_is_bounded_by_what_rtol_says():
    most, exact = allowed_at_the_end()
    found = []
    for rtol in np.geomspace(1e-4, 1e-7, 7):
        scene, joints = crank_and_rod()
        run = scene.simulate(END, rtol=rtol, integrator=fm.GeneralizedAlpha())
        found.append(abs(run.beta(joints[0])[-1] - exact) / rtol)
    assert max(found) < 0.5 * most, (found, most)  # errors of one sense all along would add up to it
    assert max(found) < 2.0 * min(found)


def four_bar(enforce):
    """Three bars of 0.3, 0.5 and 0.3 m, the loop closed between the last two."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bars = [scene.add(fm.RigidBody(1.0, (1e-3, 8e-3, 8e-3), (0.15, 0.0, 0.0)), name=f"bar {i}") for i in range(3)]
    turn = fm.joint.Revolute("z")
    first = scene.connect(turn, scene.ground.frame(), bars[0].frame())
    second = scene.connect(turn, bars[0].frame(p=(0.3, 0.0, 0.0)), bars[1].frame())
    scene.connect(turn, scene.ground.frame(p=(0.5, 0.0, 0.0)), bars[2].frame())
    scene.connect(turn, bars[1].frame(p=(0.5, 0.0, 0.0)), bars[2].frame(p=(0.3, 0.0, 0.0)), enforce=enforce)
    first.position, second.position, first.velocity = 1.0, -0.9, 5.0
    return scene, first


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6])
def test_velocities_that_swing_across_augmented_rows_are_no_vibration(rtol):
    """An augmented Lagrangian closes positions alone: the error is about that of rows that hold velocities too."""
    scene, hinge = four_bar(None)
    exact = scene.simulate(0.3, rtol=1e-11, integrator=EXACT).beta(hinge)[-1]
    errors = []
    for enforce in (None, fm.AugmentedLagrangian(1e6, 1e2)):
        scene, hinge = four_bar(enforce)
        run = scene.simulate(0.3, rtol=rtol, integrator=fm.GeneralizedAlpha())
        errors.append(run.beta(hinge)[-1] - exact)
    assert abs(errors[1]) < 2.0 * abs(errors[0])
