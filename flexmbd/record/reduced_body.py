"""ReducedBody: the record that crosses from the continuum side to the machine.

A reduced body is what is left of a finite element body after Guyan or Craig-Bampton reduction:
plain float64 arrays, immutable, SI units.  Nothing here knows DOLFINx or PETSc, and nothing
under ``multibody`` knows more of a flexible body than this.

The displacement of a material point is ``u(x) = sum_i phi_i(x) q_i`` in body axes; the modes
are in normal form, ``M_qq = I`` and ``K_qq`` diagonal, so ``q`` carries the unit kg^(1/2) m.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from flexmbd.errors import InterfaceError, RecordError
from flexmbd.files.tree_file import Tree, read_tree, write_tree
from flexmbd.given import checked
from flexmbd.record.file_kind import RECORD
from flexmbd.record.groups import FRAME_DOFS as FRAME_DOFS
from flexmbd.record.groups import GROUPS, FloatArray, freeze, frozen, frozen_frame, frozen_group
from flexmbd.record.groups import ContactPatches as ContactPatches
from flexmbd.record.groups import DistributedLoads as DistributedLoads
from flexmbd.record.groups import FurtherUnknowns as FurtherUnknowns
from flexmbd.record.groups import GeometricStiffness as GeometricStiffness
from flexmbd.record.groups import Gyroscopic as Gyroscopic
from flexmbd.record.groups import Heat as Heat
from flexmbd.record.groups import InterfaceFrame as InterfaceFrame
from flexmbd.record.groups import ModalStretch as ModalStretch
from flexmbd.record.groups import NodalInterfaces as NodalInterfaces
from flexmbd.record.groups import NodalModes as NodalModes
from flexmbd.record.groups import NonlinearStiffness as NonlinearStiffness
from flexmbd.record.groups import Ports as Ports
from flexmbd.record.groups import StressModes as StressModes
from flexmbd.record.groups import Surface as Surface
from flexmbd.record.held_modes import held_frequencies, interface_motion, mass_matrix, modal_mass
from flexmbd.record.pictured import PicturedRecord
from flexmbd.record.record_faults import record_faults
from flexmbd.record.summary import summary


@dataclass(frozen=True, eq=False)
class ReducedBody(PicturedRecord):
    """A linear elastic body reduced to ``n`` modal coordinates.

    The Gram matrix holds the mass integrals of the ``4 + 3 n`` scalar fields
    ``{1, x, y, z, phi_1x, phi_1y, phi_1z, phi_2x, ...}``: ``gram[a, b]`` is the integral of
    density times field a times field b.  Every inertia shape integral of the floating frame
    formulation follows from it (Ambrosio & Nikravesh 1992, eq. 33-34).

    Attributes:
        gram: (4 + 3 n, 4 + 3 n) mass integrals, positions in B (kg, kg m, kg m^2, ...).
        stiffness: (n,) diagonal of K_qq, ascending (1/s^2): squared angular frequencies.
        damping: (n, n) modal damping matrix D_qq (1/s), symmetric.
        interfaces: the named frames.
        frame: the interface that carries the body frame B (its modes vanish), or None where B floats
            on the mean axis.
        partition: (n, n) with q_cb = partition @ q: the exact change of basis back to the
            Craig-Bampton coordinates (interface dofs in m and rad, in B's axes, then
            fixed-interface modes).
        partition_names: (n,) names of the Craig-Bampton coordinates.
        provenance: form, mesh hash, reduction, tolerances, ... as text.
        p_MB_M: (3,) m, origin of B in the mesh's axes, from the mesh's origin.
        R_MB: (3, 3) rotation from B's axes to the mesh's.
        modes: optional full nodal modes.
        nodal: optional interfaces whose nodes keep their own displacements.
        unknowns: optional further unknowns of the modes, of forms that have such.
        surface: optional boundary triangles.
        geometric: optional geometric stiffness, load by load.
        stretch: optional membrane strains, by which its modes' rotations stretch the body.
        nonlinear: optional strain energy of large displacements, in the place of `geometric` and `stretch`.
        gyroscopic: optional forces of rotors inside the body, which take no power.
        loads: optional distributed loads.
        ports: optional pairs of effort and flow, as electrodes' voltage and charge.
        stress: optional stress modes.
        heat: optional rises of temperature, of those of the loads that are such.
        contact: optional contact patches, with the flexibility there that the modes leave out.
    """

    gram: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    interfaces: tuple[InterfaceFrame, ...]
    frame: str | None
    partition: FloatArray
    partition_names: tuple[str, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)
    p_MB_M: FloatArray = field(default_factory=lambda: np.zeros(3))
    R_MB: FloatArray = field(default_factory=lambda: np.eye(3))
    modes: NodalModes | None = None
    nodal: NodalInterfaces | None = None
    unknowns: FurtherUnknowns | None = None
    surface: Surface | None = None
    geometric: GeometricStiffness | None = None
    stretch: ModalStretch | None = None
    nonlinear: NonlinearStiffness | None = None
    gyroscopic: Gyroscopic | None = None
    loads: DistributedLoads | None = None
    ports: Ports | None = None
    stress: StressModes | None = None
    contact: ContactPatches | None = None
    heat: Heat | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and refuse a record whose parts do not fit together."""
        for item in ("gram", "stiffness", "damping", "partition", "p_MB_M", "R_MB"):
            object.__setattr__(self, item, frozen(getattr(self, item)))
        object.__setattr__(self, "interfaces", tuple(map(frozen_frame, self.interfaces)))
        object.__setattr__(self, "partition_names", tuple(self.partition_names))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        for group in GROUPS:
            value = getattr(self, group)
            if value is not None:
                object.__setattr__(self, group, frozen_group(value))
        faults = list(record_faults(self))
        if faults:
            raise RecordError("this reduced body is not consistent: " + "; ".join(faults))

    def __repr__(self) -> str:
        """Its size, its interfaces and its optional groups; arrays are asked for by name."""
        held = [group for group in GROUPS if getattr(self, group) is not None]
        names = ", ".join(face.name for face in self.interfaces)
        besides = f"; with {', '.join(held)}" if held else ""
        return f"<ReducedBody: {self.n_modes} modes, {self.mass:.6g} kg, interfaces {names}{besides}>"

    def __reduce__(self) -> tuple[type[ReducedBody], tuple[Any, ...]]:
        """Pickle and copy by the constructor, since a read-only mapping cannot be pickled."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["provenance"] = dict(self.provenance)
        return type(self), tuple(values.values())

    @property
    def n_modes(self) -> int:
        """Number of modal coordinates n."""
        return len(self.stiffness)

    @property
    def mass(self) -> float:
        """Total mass (kg)."""
        return float(self.gram[0, 0])

    @cached_property
    def com(self) -> FloatArray:
        """(3,) m, centre of mass of the undeformed body from B, in B."""
        return self.gram[0, 1:4] / self.gram[0, 0]

    @cached_property
    def inertia(self) -> FloatArray:
        """(3, 3) kg m^2, inertia about the undeformed centre of mass, in B."""
        second = self.gram[1:4, 1:4] - self.mass * np.outer(self.com, self.com)
        return np.trace(second) * np.eye(3) - second

    def interface(self, name: str) -> InterfaceFrame:
        """Return the interface frame ``name``.

        Raises:
            InterfaceError: no interface has that name; the message lists those there are.
        """
        if not isinstance(name, str):
            raise InterfaceError(f"the name of an interface must be a text, got {name!r:.100}")
        for frame in self.interfaces:
            if frame.name == name:
                return frame
        if self.nodal is not None and name in self.nodal.names:
            raise InterfaceError(
                f"interface {name!r} is nodal: its nodes move by themselves and carry no frame for joints and forces; "
                f"reduce the part with Interface({name!r}), or couple its nodes in a program of finite elements "
                "(fm.export.dmig, fm.export.calculix)"
            )
        known = ", ".join(repr(frame.name) for frame in self.interfaces) or "none"
        raise InterfaceError(f"the reduced body has no interface {name!r}; it has: {known}")

    def mass_matrix(self) -> FloatArray:
        """Mass matrix of the undeformed body, (6 + n, 6 + n).

        Rows: translation (m) and rotation (rad) of B, both in B's axes, then q.
        """
        return mass_matrix(self.gram)

    def modal_mass(self) -> FloatArray:
        """M_qq (n, n) as the Gram matrix gives it; the identity up to round-off."""
        return modal_mass(self.gram)

    @checked(error=RecordError)
    def strained(self, q: FloatArray) -> FloatArray:
        """Modal coordinates of the strain, with the second-order part of `ModalStretch`; without it q itself.

        Args:
            q: (nt, n).

        Returns:
            (nt, n): stress is that of these coordinates, displacement that of q.

        Raises:
            RecordError: q is not of that shape, or not finite.
        """
        if np.ndim(q) != 2 or np.shape(q)[1] != self.n_modes:
            raise RecordError(f"q must have shape (nt, {self.n_modes}), got {np.shape(q)}")
        if self.stretch is None:
            return q
        strained = np.array(q)
        for strain, P in zip(self.stretch.strain, self.stretch.P, strict=True):
            strained += np.outer(np.einsum("ti,ti->t", q @ P, q) / 2.0, strain / self.stiffness)
        return strained

    @checked("clamped", error=InterfaceError)
    def frequencies(self, clamped: Iterable[str] | Mapping[str, Iterable[str]] = ()) -> FloatArray:
        """Natural frequencies (Hz) of the free body, or with named interfaces clamped.

        Of stiffness and mass alone: what damping and gyroscopic forces make of them, `System.linearize` says.

        Args:
            clamped: names of clamped interfaces; or a mapping from name to the clamped
                components among ``x y z rx ry rz`` (in the interface's own axes), as in
                ``{"root": ("x", "y", "z", "rx", "rz")}`` for a hinge about y.

        Returns:
            Ascending elastic frequencies; rigid-body modes that the supports leave are not
            listed, nor deformations without mass.

        Raises:
            InterfaceError: an interface or a component is not known.
        """
        n = self.n_modes
        rows = np.zeros((0, 6 + n))
        choice = clamped if isinstance(clamped, Mapping) else dict.fromkeys(clamped, FRAME_DOFS)
        for name, components in choice.items():
            motion = interface_motion(self.interface(name))
            for component in components:
                if component not in FRAME_DOFS:
                    raise InterfaceError(
                        f"interface {name!r} has no component {component!r}; "
                        f"choose from {', '.join(FRAME_DOFS)}"
                    )
                rows = np.vstack([rows, motion[FRAME_DOFS.index(component)]])
        return held_frequencies(self.mass_matrix(), self.stiffness, rows)

    def inspect(self) -> str:
        """A readable sheet of the body; the same text for the same record.

        Returns:
            Lines with: body frame, mass, centre of mass and principal inertia; each interface's place,
            axes and static stiffness; the modes' frequencies, damping ratios and effective masses; the
            partition; the optional groups that are there or not, and what each is for; the provenance.
        """
        return summary(self)

    def fingerprint(self) -> str:
        """Hexadecimal digest of the mechanical content; the same after save and load."""
        digest = hashlib.sha256(repr(self.frame).encode())
        for array in (self.gram, self.stiffness, self.damping, self.partition):
            digest.update(array.tobytes())
        for frame in self.interfaces:
            digest.update(frame.name.encode())
            for array in (frame.p_BI_B, frame.R_BI, frame.modes):
                digest.update(array.tobytes())
        groups = self.nodal, self.geometric, self.stretch, self.nonlinear, self.gyroscopic, self.loads, self.contact
        for group in (*groups, self.ports):
            if group is not None:
                for item in fields(group):
                    value = getattr(group, item.name)
                    digest.update(repr(value).encode() if isinstance(value, tuple) else value.tobytes())
        return digest.hexdigest()

    def tree(self) -> Tree:
        """The record as nested dictionaries of arrays and texts: the items of docs/record.md."""
        frames = self.interfaces
        tree: Tree = {
            "gram": self.gram,
            "stiffness": self.stiffness,
            "damping": self.damping,
            "partition": self.partition,
            "partition_names": self.partition_names,
            "frame": self.frame or "",
            "provenance": dict(self.provenance),
            "p_MB_M": self.p_MB_M,
            "R_MB": self.R_MB,
            "interface_names": tuple(frame.name for frame in frames),
            "interface_p": np.reshape([f.p_BI_B for f in frames], (len(frames), 3)),
            "interface_R": np.reshape([f.R_BI for f in frames], (len(frames), 3, 3)),
            "interface_modes": np.reshape(
                [f.modes for f in frames], (len(frames), 6, self.n_modes)
            ),
        }
        for group in GROUPS:
            value = getattr(self, group)
            if value is not None:
                tree[group] = {f.name: getattr(value, f.name) for f in fields(value)}
        return tree

    @checked(error=RecordError)
    def save(self, path: str | Path) -> None:
        """Write the record to an HDF5 file; an existing file survives a failed write.

        Not collective; if all ranks call it, each writes the same file whole.

        Raises:
            RecordError: the destination cannot be written.
        """
        write_tree(Path(path), self.tree(), kind=RECORD)

    @classmethod
    @checked("path", error=RecordError)
    def load(cls, path: str | Path) -> ReducedBody:
        """Read a record written by ``save``, bit for bit. Not collective.

        Raises:
            RecordError: the file is missing, truncated, foreign, or of another version.
        """
        freeze(tree := read_tree(Path(path), kind=RECORD))
        try:
            return cls.from_tree(tree)
        except (KeyError, TypeError, ValueError, RecordError) as error:
            raise RecordError(f"{path} is a record, but not of a reduced body: {error}") from error

    @classmethod
    def from_tree(cls, tree: Tree) -> ReducedBody:
        """The body of a `tree`.

        Raises:
            RecordError: an item is not known, or the parts do not fit together.
            KeyError, TypeError, ValueError: an item is missing or of another kind.
        """
        frames = zip(
            tree["interface_names"],
            tree["interface_p"],
            tree["interface_R"],
            tree["interface_modes"],
            strict=True,
        )
        unknown = sorted(tree.keys() - _ITEMS - GROUPS.keys())
        if unknown:
            # left out, it could make a wrong body of a right file
            raise RecordError(f"it holds {', '.join(unknown)}, which this flexmbd does not know")
        groups: dict[str, Any] = {name: kind(**tree[name]) for name, kind in GROUPS.items() if name in tree}
        return cls(
            gram=tree["gram"],
            stiffness=tree["stiffness"],
            damping=tree["damping"],
            interfaces=tuple(InterfaceFrame(*parts) for parts in frames),
            frame=tree["frame"] or None,
            partition=tree["partition"],
            partition_names=tree["partition_names"],
            provenance=tree["provenance"],
            p_MB_M=tree["p_MB_M"],
            R_MB=tree["R_MB"],
            **groups,
        )


#: What every file holds, beside the optional groups.
_ITEMS = frozenset(
    {
        "gram", "stiffness", "damping", "partition", "partition_names", "frame", "provenance",
        "p_MB_M", "R_MB", "interface_names", "interface_p", "interface_R", "interface_modes",
    }
)  # fmt: skip
