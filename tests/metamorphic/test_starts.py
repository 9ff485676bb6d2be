"""Random machines whose joints are given coordinates of two digits: put together, and told again exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drawing import machines
from hypothesis import assume, note
from many import few_and_a_thousand, many
from random_machine import Pose, build

#: m, over the machine's extent.
ROUND_OFF = 1e-12


@few_and_a_thousand
def test_a_rough_start_told_exactly(part):
    """What a rough start is put together to is a start that nothing moves any more, with the loops closed."""

    def agree(data):
        machine = data.draw(machines(bodies=("rigid",), closed=True))
        rough = build(machine, rough=2)
        # joints held by constraints stay as they are given, so that two digits of them would contradict each other
        carried = rough.scene.compile().scene.index.joints
        given = [joint for name, joint in rough.joints.items() if not name.startswith("loop") and joint.joint.steps]
        assume(all(joint in carried for joint in given if joint.joint.velocity_names))
        run = rough.scene.simulate(machine.start + 1e-6, t_start=machine.start)
        parts = []
        for one in machine.parts:
            frame = rough.bodies[one.name].frame()
            asked = (run.position, run.rotation, run.velocity, run.angular_velocity)
            parts.append(replace(one, pose=Pose(*(ask(frame)[0] for ask in asked))))
        found = replace(machine, parts=tuple(parts))
        note(f"put together: {found}")
        assert run.stats.start_residual <= ROUND_OFF * machine.extent
        shift = max(np.linalg.norm(a.pose.p - b.pose.p) for a, b in zip(machine.parts, found.parts, strict=True))
        assert shift <= 0.5 * machine.extent
        exact = build(found).scene.start(t=machine.start)
        assert exact.moved == ()

    many(agree, 40, part)
