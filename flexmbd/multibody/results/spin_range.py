"""Limits of bodies that spin: what their records lack of being stiffened by it, or have of it already.

A record has the stiffness that a spin adds in two forms. Load by load it is that of the full model's stress
(`GeometricStiffness`). A machine has that of the membrane forces of the body's own shapes (`ModalStretch`), which is
the same where shapes complete the response to the centrifugal force. Static shapes alone do not (`guyan`): a blade's
tension is uniform then, and it is stiffened a third too much.  Records of other programs have neither form, nor has one
that was reduced without.  One of a body prestressed by a spin has it in its stiffness, to which a machine adds its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows
from flexmbd.record.groups import load_stiffness
from flexmbd.record.held_modes import held_modes
from flexmbd.record.inertia_loads import CENTRIFUGAL, PRESTRESS_SPIN, centrifugal_forces, spin_products
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

# Of the square of the lowest frequency: what is told of an error of it.
_TOLD = 0.01
# Of what a spin adds to it: what records lack that complete the response to the centrifugal force, by far.
_COMPLETE = 0.05
# What a spin adds to the square of the first frequency of a uniform blade (Southwell), over the square of the spin.
_BLADE = 1.19


@dataclass(frozen=True, eq=False)
class SpinLack:
    """What a record has of the stiffness by a spin, and what that of a machine has too much.

    Attributes:
        stiffness: (n,) 1/s^2, at rest.
        added: (6, n, n) by the full model's stress, by the products xx, yy, zz, xy, xz, yz of angular velocities in the
            body's axes.
        excess: (6, n, n) of the machine's over that.
    """

    stiffness: FloatArray
    added: FloatArray
    excess: FloatArray

    def share(self, spin: FloatArray) -> float:
        """Of the square of the lowest frequency at an angular velocity (3,), rad/s in the body's axes."""
        products = spin_products(spin)
        values, modes = np.linalg.eigh(np.diag(self.stiffness) + np.tensordot(products, self.added, 1))
        change = modes[:, 0] @ np.tensordot(products, self.excess, 1) @ modes[:, 0]
        return float(change / values[0]) if values[0] > 0.0 else 0.0


def spin_lack(record: ReducedBody) -> SpinLack | None:
    """Of a record; None where nothing is lacking that could matter, or is not known."""
    if record not in _known:
        _known[record] = _spin_lack(record)
    return _known[record]


_known: WeakKeyDictionary[ReducedBody, SpinLack | None] = WeakKeyDictionary()
_known_shares: WeakKeyDictionary[ReducedBody, FloatArray] = WeakKeyDictionary()


def _spin_lack(record: ReducedBody) -> SpinLack | None:
    geometric, stretch = record.geometric, record.stretch
    if geometric is None or not len(geometric.K) or not record.n_modes:
        return None
    added, machine = np.zeros((2, 6, record.n_modes, record.n_modes))
    forces = centrifugal_forces(record.gram[1:4, 4:].reshape(3, record.n_modes, 3))
    for k, name in enumerate(CENTRIFUGAL):
        known = load_stiffness(geometric, name)
        if known is not None:
            added[k] = known
            if stretch is not None:
                machine[k] = np.tensordot(stretch.strain @ (forces[k] / record.stiffness), stretch.P, 1)
    first, excess = int(np.argmin(record.stiffness)), machine - added
    lacks = abs(excess[:3, first, first]).max() > _COMPLETE * abs(added[:3, first, first]).max()
    return SpinLack(record.stiffness, added, excess) if lacks else None


@dataclass(frozen=True, eq=False)
class _Incomplete:
    """A body whose shapes lack a known part of the stiffening."""

    body: Body
    lack: SpinLack
    has_some: bool

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        spin = rows.spins(self.body)
        row = int(np.argmax(np.einsum("kb,kb->k", spin, spin)))
        share = self.lack.share(spin[row])
        if abs(share) <= _TOLD:
            return False
        if self.has_some:
            missing = "no shape of it completes the tension of the centrifugal force"
            remedy = "reduce it with a mode or more (craig_bampton, modes=1), with which shapes that complete it come"
        else:
            missing = "its record has no membrane strains by which a machine stiffens it"
            remedy = "reduce it with geometric_stiffness=True from its mesh"
        _tell(self.body, rows.t[rows.some][row], spin[row], share, missing=missing, remedy=remedy)
        return True


@dataclass(frozen=True, eq=False)
class _NoStiffening:
    """A body whose record knows of no stiffening.

    How much it would be is guessed as of a blade, by how wide the body is across the spin: one about the axis of a
    slender shaft stretches nothing.

    Attributes:
        body: it.
        share: (3, 3) s^2 A, the square of the lowest frequency rises by w A w of itself.
    """

    body: Body
    share: FloatArray

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        spin = rows.spins(self.body)
        shares = np.einsum("ka,ab,kb->k", spin, self.share, spin)
        row = int(np.argmax(shares))
        if shares[row] <= _TOLD:
            return False
        missing = "its record has no stiffening by the tension of the centrifugal force, without which it is too soft"
        remedy = (
            "reduce it from its mesh with geometric_stiffness=True and a finite-strain energy, as solid_linear and "
            "beam_timoshenko have, or cut it in several pieces"
        )
        found = -shares[row] / (1.0 + shares[row])
        _tell(self.body, rows.t[rows.some][row], spin[row], found, missing=missing, remedy=remedy)
        return True


@dataclass(frozen=True, eq=False)
class _Prestressed:
    """A body reduced about the state of a spin (3,), rad/s in its axes, in a machine that turns so."""

    body: Body
    prestress: FloatArray
    share: FloatArray

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        spin = rows.spins(self.body)
        along = spin @ self.prestress / (self.prestress @ self.prestress)
        row = int(np.argmax(abs(along)))
        twice = min(along[row] ** 2, 1.0) * float(self.prestress @ self.share @ self.prestress)
        if twice <= _TOLD:
            return False
        size = np.linalg.norm(self.prestress)
        missing = f"its record is of the body prestressed by a spin of {size:.4g} rad/s, which then counts twice"
        remedy = "reduce the body at rest, without prestressed(...), for a machine that turns it"
        _tell(self.body, rows.t[rows.some][row], spin[row], twice, missing=missing, remedy=remedy)
        return True


def spin_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_Incomplete | _NoStiffening | _Prestressed]:
    """Of bodies with linear stiffness, as far as their records say."""
    for body in bodies:
        record = scene.index.now(body).reduced()
        if not isinstance(body, FlexibleBody) or record is None or not record.n_modes or record.nonlinear is not None:
            continue
        spin, lack = _prestress(record), spin_lack(record)
        if spin is not None:
            yield _Prestressed(body, spin, _blade_share(record))
        elif lack is not None:
            yield _Incomplete(body, lack, record.stretch is not None)
        elif record.geometric is None and record.stretch is None:
            yield _NoStiffening(body, _blade_share(record))


def _blade_share(record: ReducedBody) -> FloatArray:
    """(3, 3) s^2, of the square of the lowest frequency per square of the spin, as of a blade on a hub.

    Whatever carries the frame: the hub is at the interface at which the body is slowest.
    """
    if record not in _known_shares:
        # of a prestressed body it is at the frame, by which it was held
        hubs = [one for one in record.interfaces if _prestress(record) is None or one.name == record.frame]
        states = [[one] for one in hubs] or [[]]
        periods = [float(held_modes(record.gram, record.stiffness, held).period.max()) for held in states]
        hub = hubs[int(np.argmax(periods))].p_BI_B if hubs else record.com
        lever = record.com - hub
        about = record.inertia / record.mass + lever @ lever * np.eye(3) - np.outer(lever, lever)
        largest = float(np.linalg.eigvalsh(about)[-1])
        share: FloatArray = np.zeros((3, 3)) if largest <= 0.0 else _BLADE * max(periods) ** 2 / largest * about
        _known_shares[record] = share
    return _known_shares[record]


def _prestress(record: ReducedBody) -> FloatArray | None:
    """(3,) rad/s, the spin by which a body was prestressed, along its axes."""
    words = record.provenance.get(PRESTRESS_SPIN, "").split()
    try:
        spin = np.array([float(word) for word in words])
    except ValueError:
        return None
    return spin if spin.shape == (3,) and np.isfinite(spin).all() and spin.any() else None


def _tell(body: Body, t: float, spin: FloatArray, share: float, *, missing: str, remedy: str) -> None:
    warn(
        f"flexible body {body.name!r} turns with {np.linalg.norm(spin):.4g} rad/s at t = {t:.6g} s: {missing}, so that "
        f"the square of its lowest frequency is off by about {100.0 * share:+.2g} % there, and by more where it turns "
        f"faster; {remedy}",
        RangeWarning,
        subject=f"spin of {body.name}",
    )
