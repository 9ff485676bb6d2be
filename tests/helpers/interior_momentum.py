"""Momentum of a body with history at the end of a run, of all its nodes and its first frame."""

import numpy as np

from flexmbd.continuum import ExplicitContinuum


def linear_momentum(interior, run, frame):
    """(3,) N s; ``frame`` is the body's first.  Collective over the interior's ranks."""
    own, R, w = interior.frames[0], run.rotation(frame)[-1], run.angular_velocity(frame)[-1]
    return own.mass * (run.velocity(frame)[-1] + np.cross(w, R @ own.com)) + _of_nodes(interior)


def _of_nodes(interior):
    """Of the nodes that are not bonded, N s."""
    if isinstance(interior, ExplicitContinuum):
        return interior.motion.momentum(np.zeros(3))[:3]
    state, bonds = interior._state, interior._bonds
    whole = interior._nodes.inertia(state.v).reshape(-1, 3).sum(axis=0)
    mine = bonds.own & ~bonds.averaged
    bonded = (bonds.mass[mine, None] * state.v[bonds.nodes[mine]]).sum(axis=0)
    return np.asarray(sum(interior.body.comm.allgather(whole - bonded)))
