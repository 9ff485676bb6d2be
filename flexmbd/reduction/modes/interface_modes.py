"""Interface reduction: characteristic constraint modes in the place of the six static shapes of every interface.

The static shapes of many interfaces are as many coordinates, of which a machine feels the softest. Their condensed
stiffness and mass, K_r x = lam M_r x with the frames that keep their six components fixed, have characteristic
constraint modes (Castanier, Tan & Pierre 2001), of which the lowest are kept; those of each interface alone, with all
others fixed, are less effective (local-level characteristic constraint modes, Hong, Epureanu & Castanier 2013). The
frames that are kept move the others as statics says, -K_rr^-1 K_rk, so the response to loads on them stays exact; so
does every rigid motion.

What the reduction adds to the error of the body's eigenvalues is computed rather than estimated, from small matrices of
all static shapes and the modes that were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.reduction.modes.truncation import LOWEST, Truncation, chosen_truncation
from flexmbd.reduction.static_shapes.statics import Statics


@checked("joints", "local", error=ReductionError)
@dataclass(frozen=True)
class InterfaceModes:
    """Which interfaces keep their six static shapes, and how many characteristic modes stand for those of the others.

    Attributes:
        modes: how many of all of them: a number, or `Truncation(below_hz=...)`, below a frequency of their own, or
            `Truncation(tol=...)`: as few as add no more than that to the relative errors of the body's eigenvalues, of
            those that `Truncation` names.
        joints: names of the interfaces that keep their six, for joints, bonds and reactions; that of the body frame, or
            the first of a floating body, is one of them in any case. The others are no frames of the record: they carry
            flexibility and mass alone.
        local: whether each interface has modes of its own, with all others fixed; the lowest of all are kept.
    """

    modes: int | Truncation
    joints: Sequence[str] = ()
    local: bool = False


@dataclass(frozen=True, eq=False)
class InterfaceShapes:
    """Coordinates of the static shapes of all interfaces but the first.

    Attributes:
        interfaces: the frames that keep their six, the body frame's or the first one at first.
        change: (6 (b - 1), s) static shapes per unit of each coordinate: the motions of each of these, then modes.
        names: (s,) of the coordinates.
        notes: for the provenance.
    """

    interfaces: tuple[FoundInterface, ...]
    change: FloatArray
    names: tuple[str, ...]
    notes: dict[str, str]

    def frame_rows(self, statics: Statics, n: int) -> FloatArray:
        """(6 frames, n) motions of the frames per unit of n coordinates, of which these are the first."""
        names = [one.name for one in statics.interfaces[1:]]
        rows = np.zeros((6 * len(self.interfaces), n))
        for i, one in enumerate(self.interfaces[1:], start=1):
            place = 6 * names.index(one.name)
            rows[6 * i : 6 * i + 6, : self.change.shape[1]] = self.change[place : place + 6]
        return rows


def all_interface_shapes(statics: Statics) -> InterfaceShapes:
    """Each interface with its six."""
    every = np.ones(len(statics.interfaces[1:]), dtype=bool)
    return InterfaceShapes(statics.interfaces, statics.frame_motions.motions, _names(statics, every), {})


def kept_interfaces(statics: Statics, choice: InterfaceModes | None) -> tuple[FoundInterface, ...]:
    """The interfaces that keep their six, that of the body frame or the first one at first; None: all."""
    if choice is None:
        return statics.interfaces
    return (*statics.interfaces[:1], *(one for one in statics.interfaces[1:] if one.name in choice.joints))


def check_interface_modes(choice: InterfaceModes, interfaces: Sequence[FoundInterface], *, frame: str | None) -> None:
    """Refuse what is not well formed; not collective.

    Raises:
        ReductionError: another object, unknown or repeated joints, or nothing that is reduced.
    """
    if not isinstance(choice, InterfaceModes):
        raise ReductionError(f"interface_modes must be InterfaceModes(...), got {choice!r:.100}")
    chosen = chosen_truncation(choice.modes)
    if chosen.free:
        raise ReductionError("free=True is for the body's own modes; leave it out of InterfaceModes")
    names = [one.name for one in interfaces]
    for name in choice.joints:
        if name not in names:
            raise ReductionError(f"joints names {name!r}, and the interfaces are {', '.join(names) or 'none'}")
    first = names[:1] if frame is None else [frame]
    if len(set(choice.joints)) < len(list(choice.joints)):
        raise ReductionError(f"joints names an interface twice: {list(choice.joints)}")
    if not set(names) - set(choice.joints) - set(first):
        raise ReductionError("every interface keeps its six static shapes, and none is left to reduce")


def interface_shapes(statics: Statics, fixed: Modes, choice: InterfaceModes) -> InterfaceShapes:
    """The kept frames and the characteristic constraint modes of the others. Collective.

    Args:
        statics: of the body.
        fixed: its fixed-interface modes, on all owned dofs.
        choice: checked.

    Raises:
        ReductionError: on all ranks: more modes than there are, or none below the frequency.
    """
    model, comm = statics.model, statics.model.comm
    psi, forces = statics.moving
    frames = statics.frame_motions
    shapes = np.asfortranarray(np.hstack([model.rigid_motions(statics.p, statics.R), psi]))
    images = multiply(model.M, shapes)
    mass = symmetric(inner(comm, shapes, images))
    coupling = inner(comm, images, fixed.shapes)
    stiffness = symmetric(inner(comm, psi, forces))
    kept = kept_interfaces(statics, choice)
    joint = np.array([one.name in choice.joints for one in statics.interfaces[1:]])
    blocks = [np.flatnonzero(frames.owner == i) for i in np.flatnonzero(~joint)]
    own_motions = np.flatnonzero(joint[frames.owner])

    def choose() -> tuple[FloatArray, FloatArray, dict[str, str]]:
        following, eigenvalues, modes = _candidates(stiffness, mass[6:, 6:], blocks, own_motions, local=choice.local)
        body = _SmallBody(stiffness, mass, coupling, fixed.eigenvalues, statics.floating)
        truncation = chosen_truncation(choice.modes)
        count, added = _count(body, following, modes, eigenvalues, truncation)
        notes = {
            "interface modes": f"{count} of {len(eigenvalues)}{', interface by interface' if choice.local else ''}",
            "error of eigenvalues added by them": f"{added:.2e} of {truncation.range}",
            "interfaces without frames": ", ".join(_others(statics.interfaces, kept)),
        }
        return np.hstack([following, modes[:, :count]]), eigenvalues[:count], notes

    change, eigenvalues, notes = parallel.on_root(comm, choose)
    change = frames.motions @ change
    names = (*_names(statics, joint), *(f"interface mode {i + 1}" for i in range(len(eigenvalues))))
    return InterfaceShapes(kept, change, names, notes)


def _names(statics: Statics, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
    """Names of the motions of chosen interfaces but the first."""
    frames = statics.frame_motions
    names = [name for name, owner in zip(frames.names, frames.owner, strict=True) if chosen[owner]]
    return tuple(f"{name} from {statics.interfaces[0].name}" if statics.floating else name for name in names)


def _others(interfaces: Sequence[FoundInterface], kept: Sequence[FoundInterface]) -> list[str]:
    names = {one.name for one in kept}
    return [one.name for one in interfaces if one.name not in names]


def _candidates(
    stiffness: FloatArray,
    mass: FloatArray,
    blocks: Sequence[NDArray[np.intp]],
    kept: NDArray[np.intp],
    *,
    local: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What follows the kept frames (s, k), and eigenvalues (r,) and modes (s, r) of the rest, ascending.

    ``blocks``: the coordinates of each interface of the rest; ``kept``: all others.
    """
    s, rest = len(stiffness), np.concatenate(blocks)
    following = np.zeros((s, len(kept)))
    following[kept] = np.eye(len(kept))
    following[rest] = -scipy.linalg.solve(stiffness[np.ix_(rest, rest)], stiffness[np.ix_(rest, kept)], assume_a="pos")
    eigenvalues, modes = [], []
    for block in blocks if local else [rest]:
        # mass by stiffness, so that the lowest are right to the last digits
        inverse, x = scipy.linalg.eigh(mass[np.ix_(block, block)], stiffness[np.ix_(block, block)])
        part = np.zeros((s, len(block)))
        part[block] = x[:, ::-1] / np.sqrt(inverse[::-1])
        eigenvalues.append(1.0 / inverse[::-1])
        modes.append(part * np.where(part[abs(part).argmax(axis=0), np.arange(len(block))] < 0.0, -1.0, 1.0))
    values = np.concatenate(eigenvalues)
    order = np.argsort(values, kind="stable")
    return following, values[order], np.hstack(modes)[:, order]


@dataclass(frozen=True, eq=False)
class _SmallBody:
    """The body in rigid motions, static shapes and fixed-interface modes.

    Attributes:
        stiffness: (s, s) of the static shapes.
        mass: (6 + s, 6 + s) of rigid motions and static shapes.
        coupling: (6 + s, m) with the modes.
        eigenvalues: (m,) of the modes.
        floating: whether it is held nowhere.
    """

    stiffness: FloatArray
    mass: FloatArray
    coupling: FloatArray
    eigenvalues: FloatArray
    floating: bool

    def frequencies(self, change: FloatArray | None) -> list[FloatArray]:
        """Elastic eigenvalues, 1/s^2, of the free body, and of that held at its frame unless it floats.

        Args:
            change: (s, r) the static shapes that are kept; None: all.
        """
        x = np.eye(len(self.stiffness)) if change is None else change
        whole = scipy.linalg.block_diag(np.eye(6), x)
        coupling = whole.T @ self.coupling
        m = np.block([[whole.T @ self.mass @ whole, coupling], [coupling.T, np.eye(len(self.eigenvalues))]])
        k = scipy.linalg.block_diag(x.T @ self.stiffness @ x, np.diag(self.eigenvalues))
        scale = 1.0 / np.sqrt(np.diag(k))
        k = k * np.outer(scale, scale)
        held = m[6:, 6:] * np.outer(scale, scale)
        momenta = m[6:, :6] * scale[:, None]
        free = held - momenta @ np.linalg.solve(m[:6, :6], momenta.T)
        # mass by stiffness, as in the normal form
        return [
            1.0 / scipy.linalg.eigh(symmetric(one), k, eigvals_only=True)[::-1]
            for one in ((free,) if self.floating else (free, held))
        ]

    def added(self, change: FloatArray, truncation: Truncation) -> float:
        """The largest relative error by which static shapes that are left out raise the eigenvalues in a range."""
        worst = 0.0
        for exact, found in zip(self.frequencies(None), self.frequencies(change), strict=True):
            count = LOWEST if truncation.below_hz is None else int(np.sum(exact < truncation.eigenvalue))
            count = min(count, len(exact))
            if count > len(found):
                return np.inf
            worst = max(worst, float((found[:count] / exact[:count] - 1.0).max(initial=0.0)))
        return worst


def _count(
    body: _SmallBody, following: FloatArray, modes: FloatArray, eigenvalues: FloatArray, truncation: Truncation
) -> tuple[int, float]:
    """How many modes are kept, and the error that they add."""

    def added(count: int) -> float:
        return body.added(np.hstack([following, modes[:, :count]]), truncation)

    most = len(eigenvalues)
    if truncation.tol is None:
        wanted = truncation.modes
        count = int(np.sum(eigenvalues < truncation.eigenvalue)) if wanted is None else wanted
        if count > most:
            raise ReductionError(f"{count} interface modes were asked for, and there are {most}; ask for fewer")
        return count, added(count)
    few, count = -1, most
    # by bisection: more modes are never worse
    while count - few > 1:
        middle = (few + count) // 2
        if added(middle) <= truncation.tol:
            count = middle
        else:
            few = middle
    return count, added(count)
