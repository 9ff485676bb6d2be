"""The start that a user gives: initial coordinates and velocities of joints and bodies."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.scene_index import IdentityMap

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def given_start(
    scene: CompiledScene, connections: Sequence[Connection], bodies: Sequence[Body]
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """x (nx,) and v (nv,) as given for joints and bodies, and which of them (nv,) are to be kept."""
    x, v = scene.start.copy(), np.zeros(scene.nv)
    held_x, held_v = np.zeros((2, scene.nv), bool)
    for connection in connections:
        slots = scene.index.joints.get(connection)
        if slots is None:
            continue
        joint = scene.index.now(connection)
        if joint.position is not None:
            x[slots.x] = joint.position
            held_x[slots.v] = True
        if joint.velocity is not None:
            v[slots.v] = joint.velocity
            held_v[slots.v] = True
    for body in bodies:
        if isinstance(body, PseudoRigidBody) and not body.rigid:
            slots = scene.index.modes[body]
            x[slots.x], v[slots.v] = body.start()
            held_x[slots.v] = held_v[slots.v] = True
        if isinstance(body, FlexibleBody):
            slots, now = scene.index.modes[body], scene.index.now(body)
            if now.q is not None:
                x[slots.x], held_x[slots.v] = now.q, True
            if now.q_rate is not None:
                v[slots.v], held_v[slots.v] = now.q_rate, True
    for places in scene.index.states.values():
        v[places.v], held_v[places.v] = places.initial / places.scale, True
    return x, v, held_x, held_v


def with_given_start(scene: CompiledScene, connections: Sequence[Connection], bodies: Sequence[Body]) -> CompiledScene:
    """The scene with what joints and flexible bodies are given now, whatever is assigned to them later."""
    kept = IdentityMap[object, Any]((joint, joint.copied()) for joint in connections)
    kept.update((body, copy.copy(body)) for body in bodies if isinstance(body, FlexibleBody))
    return replace(scene, index=replace(scene.index, substitutes=kept))
