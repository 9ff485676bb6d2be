"""Laws of impact: what restitution is a share of."""

from __future__ import annotations

import enum


class ImpactLaw(enum.Enum):
    """What the coefficient of restitution of a hard contact is a share of.

    Attributes:
        NEWTON: of the normal speed at which its surfaces meet, at each contact by itself.
        POISSON: of the normal impulse that brings the surfaces to rest against each other, all contacts together; it
            acts once more, times e, where they come apart.  Both are the same at one contact without friction, and
            wherever all contacts have one coefficient, no friction, and press.

    Sources: Glocker & Pfeiffer 1995; Brogliato 1999, section 5.
    """

    NEWTON = "Newton"
    POISSON = "Poisson"
