"""The watch on rotations that a formulation takes for small, or writes as vectors that end."""

from __future__ import annotations

from flexmbd.continuum import parallel
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.turn_law import TurnLaw
from flexmbd.errors import RangeWarning, warn

# rad: of small rotations, as of bodies of small displacements (`bend_range`); of finite ones, whose vectors end at pi
_SMALL, _FINITE = 0.25, 2.6


class TurnWatch:
    """Of one body; of one whose rotations have no limit it costs nothing."""

    def __init__(self, body: NonlinearModel, law: TurnLaw | None) -> None:
        """Nothing is told yet. Not collective.

        Args:
            body: the body.
            law: of its rotations; None: it has none.
        """
        self._body, self._law = body, law
        self._limited = law is not None and not (law.is_finite and law.by_steps)
        self._open = self._limited

    def begin(self) -> None:
        """Tell again where it passes the limit."""
        self._open = self._limited

    def look(self, t: float) -> None:
        """At the last accepted step, at t (s). Collective.

        Warns:
            RangeWarning: a node has turned by more than the formulation means, once until `begin`.
        """
        if not self._open or self._law is None:
            return
        layout = self._body.layout
        turns = self._body.displacement[layout.further_dofs[layout.kinematic[layout.further_dofs]]].reshape(-1, 3)
        angle = float(max(self._body.comm.allgather(self._law.vector.angles(turns).max(initial=0.0))))
        limit = _FINITE if self._law.is_finite else _SMALL
        if angle <= limit:
            return
        self._open = False
        name = self._body.groups[0].form_name
        first = f"its first interface, {self._body.interfaces[0].name!r}"
        if self._law.is_finite:
            text = (
                f"{name}: a node has turned by {angle:.2g} rad against {first}, at t = {t:.6g} s, and its rotation "
                "vector ends at half a revolution; put an interface that turns less first, or take the form "
                "beam_exact, whose sections turn as far as they like"
            )
        else:
            text = (
                f"{name}: a node has turned by {angle:.2g} rad against {first}, at t = {t:.6g} s, and its rotations "
                f"are to be small there: what moves across is off by about {50.0 * angle**2:.1g} %, and by more where "
                "it turns more; put an interface that turns less first, cut the body in several, or take solids "
                "(solid_shell for plates), or beam_exact"
            )
        parallel.on_root(self._body.comm, lambda: warn(text, RangeWarning, subject=f"turn of {name}"))
