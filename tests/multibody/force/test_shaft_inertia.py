"""One-dimensional inertias on joint coordinates, against rotors of their own behind gears and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.scene_matrices import mass_matrix

TILT = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
METHODS = {
    "explicit": fm.ExplicitRungeKutta(), "radau": fm.RadauIIA(), "alpha": fm.GeneralizedAlpha(),
    "energy": fm.EnergyMomentum(),
}  # fmt: skip


def machine(way, *, aligned=False, flexible=False, loop=False):
    """A column that turns, an arm on it and a slide on the arm; rotors on all joints, by ``way``.

    way: "shaft" by ShaftInertia, "gear" by bodies of their own on the ground, None without.
    """
    scene = fm.System(gravity=(0.4, -9.81, -1.1))
    column = scene.add(fm.RigidBody(1.3, np.diag([0.05, 0.06, 0.07]), (0.2, 0.05, -0.1)), name="column")
    turn = np.eye(3) if aligned else TILT
    arm: fm.FlexibleBody | fm.RigidBody
    if flexible:
        arm = scene.add(fm.FlexibleBody(particle_body(3, modes=3).record))
        root, tip = arm.frame("root"), arm.frame("tip")
    else:
        arm = scene.add(fm.RigidBody(0.9, (0.02, 0.03, 0.04), (0.1, 0.05, -0.02)))
        root, tip = arm.frame(), arm.frame(p=(0.3, 0.0, 0.1), R=turn)
    load = scene.add(fm.RigidBody(0.4, np.diag([0.01, 0.012, 0.015]), (0.0, 0.1, 0.1)), name="load")
    joints = [scene.connect(fm.joint.Revolute("z" if aligned else "y"), scene.ground.frame(), column.frame())]
    joints.append(scene.connect(fm.joint.Revolute("z"), column.frame(p=(0.4, 0.1, 0.0), R=turn), root))
    kind = fm.joint.Revolute("z") if aligned else fm.joint.Cylindrical("x")
    joints.append(scene.connect(kind, tip, load.frame()))
    joints[0].velocity, joints[1].velocity = 1.2, -0.7
    on = [(joints[0], 0.003, 4.0, 0), (joints[1], 0.001, -6.0, 0), (joints[2], 0.002, 5.0, 0)]
    on += [] if aligned else [(joints[2], 0.0005, 3.0, 1)]
    for k, (joint, inertia, ratio, coordinate) in enumerate(on):
        if way == "shaft":
            scene.add_force(fm.force.ShaftInertia(joint, inertia, ratio, coordinate))
        elif way == "gear":
            rotor = scene.add(fm.RigidBody(1e-9, (inertia, inertia, inertia)), name=f"rotor {k}")
            shaft = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rotor.frame())
            if joint.joint.angular[coordinate]:
                scene.couple(fm.joint.Gear(joint, shaft, ratio))
            else:
                scene.couple(fm.joint.RackAndPinion(shaft, joint, 1.0 / ratio))
    if loop:
        far = np.array([0.5, 0.9, 0.2])
        length = float(np.linalg.norm(scene.at_start().position(load.frame())[0] - far))
        joints[0].velocity = joints[1].velocity = joints[2].velocity = None
        scene.connect(fm.joint.Distance(length), scene.ground.frame(p=far), load.frame(), name="rod")
    return scene, joints, (column, arm, load)


def accelerations(scene, bodies):
    run = scene.simulate(1e-6, h=1e-6, integrator=fm.ExplicitRungeKutta())
    return np.concatenate([run.acceleration(body.frame())[0] for body in bodies])


@pytest.mark.parametrize("kind", [{}, {"aligned": True}, {"flexible": True}, {"loop": True}])
def test_as_rotors_behind_gears(kind):
    """Accelerations at the start, for hinges along their parents' axes, others, on bodies that deform, in loops."""
    found = {way: accelerations(*machine(way, **kind)[::2]) for way in ("shaft", "gear", None)}
    np.testing.assert_allclose(found["shaft"], found["gear"], atol=1e-8 * np.abs(found["gear"]).max())
    assert np.abs(found["shaft"] - found[None]).max() > 1e-2 * np.abs(found[None]).max()


@pytest.mark.parametrize("name", METHODS)
def test_motion_and_energy(name):
    """All integrators move it as the rotors behind gears do, and energy is kept with theirs."""
    scene, joints, _ = machine("shaft")
    geared, theirs, _ = machine("gear")
    expected = geared.simulate(0.2, rtol=1e-10, integrator=fm.ExplicitRungeKutta())
    rtol = 1e-10 if name == "explicit" else 1e-7
    run = scene.simulate(0.2, rtol=rtol, integrator=METHODS[name])
    for joint, other in zip(joints, theirs, strict=True):
        close = 1e-8 if name == "explicit" else 1e-5
        np.testing.assert_allclose(run.beta(joint)[-1], expected.beta(other)[-1], atol=close)
    energy, of_gears = run.energy(), expected.energy()
    assert energy.kinetic[0] == pytest.approx(of_gears.kinetic[0], rel=1e-9)
    assert np.ptp(energy.total) < 1e-4 * np.ptp(energy.kinetic)
    assert len(scene.compile().scene.plan.rows) == 0


def test_a_long_chain():
    """Of so many hinges that implicit methods factor by recursion along the tree."""
    ends = []
    for method in (fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.GeneralizedAlpha()):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        last = scene.ground.frame()
        for k in range(44):
            link = scene.add(fm.RigidBody(0.1, (1e-3, 2e-3, 2e-3), (0.05, 0.0, 0.0)))
            hinge = scene.connect(fm.joint.Revolute("zy"[k % 2]), last, link.frame())
            scene.add_force(fm.force.ShaftInertia(hinge, 1e-4, ratio=5.0))
            last = link.frame(p=(0.1, 0.0, 0.0))
        run = scene.simulate(0.05, rtol=1e-8, integrator=method)
        ends.append(run.position(last)[-1])
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-7)


def test_kane_and_the_explanation_know_of_it():
    """Kane's equations by definition are zero for its motion."""
    scene, *_ = machine("shaft")
    run = scene.simulate(0.02, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    kinematics = fm.force.Kinematics(scene.compile().scene).move(run.t[-1], run.x[-1], run.v[-1], run.a[-1])
    np.testing.assert_allclose(fm.force.inertia_forces(kinematics, scene.gravity), 0.0, atol=1e-10)
    assert "one-dimensional inertia of 0.048 on " in scene.explain()


def test_it_adds_to_the_mass_matrix_alone():
    """By inertia ratio^2 on its coordinate; the reaction on the child is that of the child's own motion."""
    scene, *_ = machine("shaft")
    bare, *_ = machine(None)
    matrices = []
    for one in (scene, bare):
        compiled = one.compile().scene
        matrices.append(mass_matrix(compiled, new_work(compiled.plan), compiled.start))
    added = np.diag([0.003 * 16.0, 0.001 * 36.0, 0.002 * 25.0, 0.0005 * 9.0])
    np.testing.assert_allclose(matrices[0] - matrices[1], added, atol=1e-14)


def test_a_motor_behind_a_gear():
    """A prescribed coordinate takes the rotor's torque; frequencies fall; several on one coordinate add."""
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    for inertia in (0.002, 0.001):
        scene.add_force(fm.force.ShaftInertia(hinge, inertia, ratio=10.0))
    spring = scene.add_force(fm.force.JointSpring(hinge, 40.0))
    found = np.abs(scene.linearize().eigenvalues())
    np.testing.assert_allclose(found, np.sqrt(40.0 / 0.4), rtol=1e-12)
    scene._forces.remove(spring)
    hinge.prescribe(fm.Sine(0.5, 4.0))
    run = scene.simulate(0.3, rtol=1e-6)
    np.testing.assert_allclose(run.drive(hinge), -0.4 * 0.5 * 16.0 * np.sin(4.0 * run.t), atol=1e-9)
    np.testing.assert_allclose(run.reaction(hinge)[:, 5], -0.1 * 0.5 * 16.0 * np.sin(4.0 * run.t), atol=1e-9)
    assert np.abs(run.momentum().angular[:, 2]).max() == pytest.approx(0.1 * 2.0, rel=1e-3)


def test_what_is_wrong_is_told():
    scene, joints, bodies = machine(None)
    ends, way = (bodies[0].frame(), bodies[2].frame()), fm.Way.CONSTRAINTS
    ball = scene.connect(fm.joint.Spherical(), *ends, way=way, name="ball")
    with pytest.raises(SceneError, match="no coordinate that is one number"):
        scene.add_force(fm.force.ShaftInertia(ball, 1.0))
    held = scene.connect(fm.joint.Revolute(), *ends, way=way, name="held")
    for given, text in (
        ((joints[0], 0.0), "inertia = 0.0 must be positive"),
        ((joints[0], np.nan), "not a finite number"),
        ((joints[0], 1.0, 0.0), "ratio must be finite and not 0"),
        ((joints[0], 1.0, 1.0, 1), "coordinates 0 to 0"),
    ):
        with pytest.raises(SceneError, match=text):
            scene.add_force(fm.force.ShaftInertia(*given))
    inertia = fm.force.ShaftInertia(held, 1.0)
    scene.add_force(inertia)
    with pytest.raises(SceneError, match="'held' closes a loop"):
        scene.compile()
    other, joints, _ = machine("shaft")
    with pytest.raises(SceneError, match="cannot vary"):
        other.compile(parameters={"J": fm.parameter.OfForce(other._forces[0], "inertia")})
