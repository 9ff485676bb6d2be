"""Interface reduction: characteristic constraint modes in the place of the static shapes of every interface.

The static shapes of many interfaces, or of one whose nodes all move by themselves, are as many coordinates, of which a
machine feels the softest. Their condensed stiffness and mass, K_r x = lam M_r x with what is kept fixed, have
characteristic constraint modes (Castanier, Tan & Pierre 2001), of which the lowest are kept; those of each interface
alone, with all others fixed, are less effective (local-level characteristic constraint modes, Hong, Epureanu &
Castanier 2013). What is kept moves the others as statics says, -K_rr^-1 K_rk, so the response to loads on it stays
exact; so does every rigid motion. Where nothing that is kept holds the body, the modes are the free body's.

What the reduction adds to the error of the body's eigenvalues is computed rather than estimated, from small matrices of
all static shapes and the modes that were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.reduction.modes.interface_candidates import Candidates, interface_candidates
from flexmbd.reduction.modes.truncation import LOWEST, Truncation, chosen_truncation
from flexmbd.reduction.static_shapes.statics import Statics


@checked("joints", "local", error=ReductionError)
@dataclass(frozen=True)
class InterfaceModes:
    """Which interfaces keep their static shapes, and how many characteristic modes stand for those of the others.

    Attributes:
        modes: how many of all of them: a number, or `Truncation(below_hz=...)`, below a frequency of their own, or
            `Truncation(tol=...)`: as few as add no more than that to the relative errors of the body's eigenvalues, of
            those that `Truncation` names.
        joints: names of the interfaces that keep theirs, for joints, bonds and reactions, or, of a nodal one, for its
            nodes to be coupled; that of the body frame, or the first frame of a floating body, is one of them in any
            case. The others are no frames and no nodes of the record: they carry flexibility and mass alone.
        local: whether each interface has modes of its own, with all others fixed; the lowest of all are kept.
    """

    modes: int | Truncation
    joints: Sequence[str] = ()
    local: bool = False


@dataclass(frozen=True, eq=False)
class InterfaceShapes:
    """Coordinates of the static shapes of all interfaces.

    Attributes:
        interfaces: the frames that keep their six, the body frame's or the first one at first.
        nodal: names of the nodal interfaces that keep their nodes.
        change: (s, r) the motions of `Statics.moving` per unit of each coordinate: those that are kept, then modes.
        names: (r,) of the coordinates.
        notes: for the provenance.
    """

    interfaces: tuple[FoundInterface, ...]
    nodal: tuple[str, ...]
    change: FloatArray
    names: tuple[str, ...]
    notes: dict[str, str]

    def frame_rows(self, statics: Statics, n: int) -> FloatArray:
        """(6 frames, n) motions of the frames per unit of n coordinates, of which these are the first."""
        names = [one.name for one in statics.interfaces[1:]]
        motions = statics.frame_motions.motions
        moved = motions @ self.change[: motions.shape[1]]
        rows = np.zeros((6 * len(self.interfaces), n))
        for i, one in enumerate(self.interfaces[1:], start=1):
            place = 6 * names.index(one.name)
            rows[6 * i : 6 * i + 6, : self.change.shape[1]] = moved[place : place + 6]
        return rows


def all_interface_shapes(statics: Statics) -> InterfaceShapes:
    """Each interface with its own. Collective."""
    names = _names(statics)
    nodal = tuple(group.name for group in statics.model.nodal)
    return InterfaceShapes(statics.interfaces, nodal, np.eye(len(names)), names, _nodal_notes(nodal, ()))


def joints(choice: InterfaceModes | None) -> Sequence[str]:
    """Names of the interfaces that are asked to keep their static shapes."""
    return () if choice is None else choice.joints


def _nodal_notes(kept: Sequence[str], reduced: Sequence[str]) -> dict[str, str]:
    """What the provenance says of nodal interfaces."""
    said = {"nodal interfaces": ", ".join(kept), "nodal interfaces without nodes": ", ".join(reduced)}
    return {what: names for what, names in said.items() if names}


def kept_interfaces(statics: Statics, choice: InterfaceModes | None) -> tuple[FoundInterface, ...]:
    """The interfaces that keep their six, that of the body frame or the first one at first; None: all."""
    if choice is None:
        return statics.interfaces
    return (*statics.interfaces[:1], *(one for one in statics.interfaces[1:] if one.name in choice.joints))


def check_interface_modes(choice: InterfaceModes, model: LinearModel, *, frame: str | None) -> None:
    """Refuse wrong choices of interface modes; not collective.

    Raises:
        ReductionError: another object, unknown or repeated joints, or nothing that is reduced.
    """
    if not isinstance(choice, InterfaceModes):
        raise ReductionError(f"interface_modes must be InterfaceModes(...), got {choice!r:.100}")
    chosen = chosen_truncation(choice.modes)
    if chosen.free:
        raise ReductionError("free=True is for the body's own modes; leave it out of InterfaceModes")
    frames = [one.name for one in model.interfaces]
    names = [*frames, *(group.name for group in model.nodal)]
    for name in choice.joints:
        if name not in names:
            raise ReductionError(f"joints names {name!r}, and the interfaces are {', '.join(names) or 'none'}")
    first = frames[:1] if frame is None else [frame]
    if len(set(choice.joints)) < len(list(choice.joints)):
        raise ReductionError(f"joints names an interface twice: {list(choice.joints)}")
    if not set(names) - set(choice.joints) - set(first):
        raise ReductionError("every interface keeps its static shapes, and none is left to reduce")


def interface_shapes(statics: Statics, fixed: Modes, choice: InterfaceModes) -> InterfaceShapes:
    """The kept static shapes and the characteristic constraint modes of the rest. Collective.

    Args:
        statics: of the body.
        fixed: its fixed-interface modes, on all owned dofs.
        choice: checked.

    Raises:
        ReductionError: on all ranks: more modes than there are, none below the frequency, or modes of a nodal interface
            alone where the others do not hold the body.
    """
    model, comm = statics.model, statics.model.comm
    psi, forces = statics.moving
    shapes = np.asfortranarray(np.hstack([model.rigid_motions(statics.p, statics.R), psi]))
    images = multiply(model.M, shapes)
    mass = symmetric(inner(comm, shapes, images))
    coupling = inner(comm, images, fixed.shapes)
    stiffness = symmetric(inner(comm, psi, forces))
    names, owner = _movable(statics)
    joint = np.array([name in choice.joints for name in names])
    kept = np.flatnonzero(joint[owner])
    nodal = tuple(group.name for group in model.nodal if group.name in choice.joints)
    reduced = [group.name for group in model.nodal if group.name not in nodal]

    def choose() -> tuple[FloatArray, FloatArray, dict[str, str]]:
        found = interface_candidates(statics, stiffness, mass, owner=owner, joint=joint, local=choice.local)
        body = _SmallBody(stiffness, mass, coupling, fixed.eigenvalues, statics.floating)
        truncation = chosen_truncation(choice.modes)
        count, added = _count(body, found, truncation)
        total = len(found.eigenvalues)
        without = _others(statics.interfaces, kept_interfaces(statics, choice))
        notes = {
            "interface modes": f"{count} of {total}{', interface by interface' if choice.local else ''}",
            "error of eigenvalues added by them": f"{added:.2e} of {truncation.range}",
            **({"interfaces without frames": ", ".join(without)} if without else {}),
            **_nodal_notes(nodal, reduced),
        }
        return found.change(count), found.eigenvalues[:count], notes

    change, eigenvalues, notes = parallel.on_root(comm, choose)
    every = _names(statics)
    coordinates = (*(every[i] for i in kept), *(f"interface mode {i + 1}" for i in range(len(eigenvalues))))
    return InterfaceShapes(kept_interfaces(statics, choice), nodal, change, coordinates, notes)


def _movable(statics: Statics) -> tuple[list[str], NDArray[np.int64]]:
    """Names of all interfaces but the first frame, and which of them each motion of `Statics.moving` is of."""
    names, owner = [one.name for one in statics.interfaces[1:]], statics.frame_motions.owner
    if statics.nodal is not None:
        owner = np.concatenate([owner, len(names) + statics.nodal.owner])
    return [*names, *(group.name for group in statics.model.nodal)], owner


def _names(statics: Statics) -> tuple[str, ...]:
    """Names of the motions of `Statics.moving`."""
    names = statics.frame_motions.names
    if statics.floating:
        names = tuple(f"{name} from {statics.interfaces[0].name}" for name in names)
    return names if statics.nodal is None else (*names, *statics.nodal.names)


def _others(interfaces: Sequence[FoundInterface], kept: Sequence[FoundInterface]) -> list[str]:
    names = {one.name for one in kept}
    return [one.name for one in interfaces if one.name not in names]


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

    @cached_property
    def _all(self) -> list[FloatArray]:
        return self.frequencies(None)

    def added(self, change: FloatArray, truncation: Truncation) -> float:
        """The largest relative error by which static shapes that are left out raise the eigenvalues in a range."""
        worst = 0.0
        for exact, found in zip(self._all, self.frequencies(change), strict=True):
            count = LOWEST if truncation.below_hz is None else int(np.sum(exact < truncation.eigenvalue))
            count = min(count, len(exact))
            if count > len(found):
                return np.inf
            worst = max(worst, float((found[:count] / exact[:count] - 1.0).max(initial=0.0)))
        return worst


def _count(body: _SmallBody, found: Candidates, truncation: Truncation) -> tuple[int, float]:
    """How many modes are kept, and the error that they add."""

    def added(count: int) -> float:
        return body.added(found.change(count), truncation)

    eigenvalues, most = found.eigenvalues, len(found.eigenvalues)
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
