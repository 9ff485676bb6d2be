"""How an interface is tied to its frame; numpy-only leaf, as it is named in scripts of both sides."""

from __future__ import annotations

import enum


class Coupling(enum.Enum):
    """How the nodes of an interface and its six-dof frame move together.

    Attributes:
        RIGID: the nodes move as the frame does (RBE2): stiffer than the free part.
        AVERAGED: the frame moves as the L2 average of the nodes (RBE3): a load on the frame is spread as
            tractions over the interface, which stays free to deform; softer than RIGID.
    """

    RIGID = enum.auto()
    AVERAGED = enum.auto()
