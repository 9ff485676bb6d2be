"""What a user asks of a path of equilibria."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import is_number, is_truth


@dataclass(frozen=True, kw_only=True)
class Continuation:
    """How a path of equilibria is followed; for ``System.equilibrium(path=...)`` and ``continuum.equilibrium_path``.

    Functions of time scale the loads: the time is the load factor.  ``FrameForce(frame, (0, lambda t: -t, 0))`` grows
    with it, or falls as a path turns; constant forces and gravity stay.  Prescribed motions lead a machine or a body in
    the same way, without rates.

    Attributes:
        to: the factor at which the path ends.
        back_to: a factor on the other side of the start at which it ends as well; by default as far behind the start
            as ``to`` is before it.
        side: 1 or -1: which way the path leaves a bifurcation, along its mode or against it, or a limit point, on or
            back again; elsewhere whether the factor first goes towards ``to`` or away from it, as beyond a limit point.
        longest_step: rad of a joint, of the extent of the machine or of the body, and of the range of factors.
        most_points: after which the path is broken off.

    Raises:
        SceneError: numbers that are none or have no sense.
    """

    to: float
    back_to: float | None = None
    side: int = 1
    longest_step: float = 0.1
    most_points: int = 500

    def __post_init__(self) -> None:
        for name in ("to", "back_to"):
            value = getattr(self, name)
            if not is_number(value) and (name == "to" or value is not None):
                raise SceneError(f"Continuation: {name} must be a load factor, a number, got {value!r}")
            if value is not None:  # integers as well: kernels know doubles
                object.__setattr__(self, name, float(value))
        if is_truth(self.side) or self.side not in (1, -1):
            raise SceneError(f"Continuation: side must be 1 or -1, got {self.side!r}")
        if not is_number(self.longest_step) or not 0.0 < self.longest_step <= 1.0:
            raise SceneError(f"Continuation: longest_step must be above 0 and at most 1, got {self.longest_step!r}")
        if is_truth(self.most_points) or not isinstance(self.most_points, int) or self.most_points < 2:
            raise SceneError(f"Continuation: most_points must be 2 or more, got {self.most_points!r}")


@dataclass(frozen=True)
class Bounds:
    """Where a path ends, and how long its steps may be.

    Attributes:
        to: factor to be reached.
        back_to: factor on the other side of the start at which it is given up.
        longest: step: rad, of the extent, and of the range of factors.
        points: at most.
    """

    to: float
    back_to: float
    longest: float
    points: int

    @property
    def width(self) -> float:
        """Of the range of factors."""
        return abs(self.to - self.back_to)

    def passed(self, before: float, after: float) -> float | None:
        """The bound that lies between two factors, if one does."""
        for bound in (self.to, self.back_to):
            if (before - bound) * (after - bound) <= 0.0 and before != bound:
                return bound
        return None


def bounds_of(path: Continuation, *, begin: float) -> Bounds:
    """The bounds of a path that begins at a factor.

    Raises:
        SceneError: it ends where it begins, or both bounds lie on one side.
    """
    if path.to == begin:
        raise SceneError(f"the path ends at the load factor {path.to:g} at which it begins; give another one to go to")
    back_to = 2.0 * begin - path.to if path.back_to is None else path.back_to
    if (back_to - begin) * (path.to - begin) >= 0.0:
        raise SceneError(
            f"back_to = {back_to:g} does not lie on the other side of the start, {begin:g}, than to = {path.to:g}"
        )
    return Bounds(path.to, back_to, path.longest_step, path.most_points)


def looked_at(begin: float, to: float) -> list[float]:
    """Factors at which loads are looked at that do nothing where a path begins; they may come back to it at its end."""
    return [begin + share * (to - begin) for share in (1.0, 0.3819660)]
