"""The parts a reduced body's record is made of: interface frames, and the optional groups.

Frozen dataclasses of plain arrays, numpy only; `flexmbd.record.reduced_body` offers them under its own name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.record.contact_patches import ContactPatches as ContactPatches

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Components of an interface frame, in the order of the rows of ``InterfaceFrame.modes``.
FRAME_DOFS = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class InterfaceFrame:
    """A named six-dof frame I on the body, carried by the modes.

    Attributes:
        name: the interface's name.
        p_BI_B: (3,) m, position of I in the undeformed body, from the body frame B, in B.
        R_BI: (3, 3) rotation from I's axes to B's, undeformed.
        modes: (6, n) displacement of I's origin (rows 0-2, m) and small rotation (rows 3-5,
            rad), both in B's axes, per unit of each modal coordinate.
    """

    name: str
    p_BI_B: FloatArray
    R_BI: FloatArray
    modes: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class NodalModes:
    """Optional group ``modes/``: the full modes at the mesh's nodes.

    Attributes:
        node: (k,) node numbers of the input file, counted from 0, ascending, so that no partition
            matters; nodes the file does not have (middles of the edges of straight cells) follow
            after them.
        x: (k, 3) m, node positions in B.
        phi: (k, 3, n) displacement per unit modal coordinate, in B.
    """

    node: IntArray
    x: FloatArray
    phi: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class NodalInterfaces:
    """Optional group ``nodal/``: interfaces whose nodes keep their own displacements, for coupling with other meshes.

    They carry no frame; those that interface modes stand for are not among them. The displacements of the nodes are
    independent of each other and of the interface frames: the partition's coordinates ``weld.17.x`` are those of node
    17 along B's axes; exports of superelements have them as nodes of three components.

    Attributes:
        names: (b,) of the interfaces.
        node: (k,) node numbers, as in `NodalModes`, ascending.
        x: (k, 3) m, node positions in B.
        interface: (k,) which of the names each node is of, from 0.
        phi: (k, 3, n) displacement per unit modal coordinate, in B.
    """

    names: tuple[str, ...]
    node: IntArray
    x: FloatArray
    interface: IntArray
    phi: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class FurtherUnknowns:
    """Optional group ``unknowns/``: unknowns of the modes beside displacements, as rotations of sections or pressures.

    For stress and fields from the model, whose form defines them; beside ``modes/``.

    Attributes:
        dof: (m,) numbers of the dofs, ascending (`flexmbd.continuum.finite_elements.nodes.dof_numbers`), so that no
            partition matters.
        phi: (m, n) per unit modal coordinate, in the form's units and the mesh's axes.
    """

    dof: IntArray
    phi: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Surface:
    """Optional group ``surface/``: the boundary triangles, for pictures.

    Attributes:
        x: (k, 3) m, vertex positions in B.
        triangle: (t, 3) vertex indices, oriented outwards.
        phi: (k, 3, n) displacement of the vertices per unit modal coordinate, in B.
    """

    x: FloatArray
    triangle: IntArray
    phi: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class GeometricStiffness:
    """Optional group ``geometric/``: the modal stiffness that each load adds.

    With c_l the present size of load l, the modal stiffness is K_qq + sum_l c_l K_l, where
    K_l is that of the stress of u_l, the static displacement under the unit load: for loads at rest,
    and for programs that take their stiffening load by load.  A machine here has it of the modes
    (`ModalStretch`).  The loads and their c:

    - ``acceleration x`` .. ``z``: acceleration of B's origin minus gravity, in B (m/s^2); the load
      is the inertia force -rho c.
    - ``angular acceleration x`` .. ``z``: of B, in B (rad/s^2).
    - ``angular velocity xx``, ``yy``, ``zz``, ``xy``, ``xz``, ``yz``: products w_a w_b of B's angular
      velocity, in B (rad^2/s^2); the centrifugal force -rho w x (w x r) is the sum over these six
      (`flexmbd.record.inertia_loads`).
    - ``<interface>.x`` .. ``.rz``: force (N) and moment (N m) on an interface frame, in B's axes.
    - ``load <name>``: factor of a distributed load.

    Attributes:
        loads: (l,) names; a load that is not among them stiffens nothing.
        K: (l, n, n) symmetric, 1/s^2 per unit of each load.
    """

    loads: tuple[str, ...]
    K: FloatArray

    __repr__ = brief


def load_stiffness(group: GeometricStiffness | None, load: str) -> FloatArray | None:
    """(n, n) the stiffness that a unit of the load adds, or None where the record does not have it."""
    if group is None or load not in group.loads:
        return None
    return group.K[group.loads.index(load)]


@dataclass(frozen=True, eq=False)
class ModalStretch:
    """Optional group ``stretch/``: membrane strains, and how the modes' rotations stretch the body.

    A membrane field a_m is a combination of modes of the strain energy 1/2, without energy in common with the others.
    How much of it a displacement q holds is its membrane strain c_m q, c_m = a_m^T K.  The Green-Lagrange strain of a
    displacement has a part of second order as well; projected on the field's own strain it is q^T P_m q / 2, with
    P_m,ij the integral of stress(a_m) : (grad phi_i^T grad phi_j), phi without its membrane fields.  The strain energy
    is

        (q^T K q + sum_m (c_m q + q^T P_m q / 2)^2 - (c_m q)^2) / 2.

    It keeps a spinning body stiff and a bent one as long as it was, under any load, and is never negative. Where the
    stiffness has a part of springs on facets, which is no strain, a_m and c_m are those of the rest.

    Attributes:
        strain: (s, n) c_m, 1/s: J^(1/2) per unit modal coordinate; c_m K^-1 c_l is 1 for m = l, else 0.
        P: (s, n, n) symmetric, J^(1/2) per unit modal coordinates.
    """

    strain: FloatArray
    P: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class NonlinearStiffness:
    """Optional group ``nonlinear/``: the strain energy of large displacements, a polynomial of degree four.

    With it in the place of `GeometricStiffness` and `ModalStretch` the strain energy (J) is

        q^T K q / 2 + sum_{i >= j >= k} c_ijk q_i q_j q_k + sum_{i >= j >= k >= l} d_ijkl q_i q_j q_k q_l,

    and the displacement stays linear in q. The faces of the interfaces turn by finite angles: a point X of a face, from
    the interface's origin, is displaced by d + A X, all in B's axes. Rows 0-2 of ``InterfaceFrame.modes`` times q are
    d, rows 3-5 times q the axial vector of the skew part of A, and S, its symmetric part, is here. The frame's rotation
    is the one in the polar decomposition I + A = R U.

    Attributes:
        cubic: (n (n + 1) (n + 2) / 6,) c_ijk, J per unit modal coordinates; i outermost, then j <= i, then k <= j.
        quartic: (n (n + 1) (n + 2) (n + 3) / 24,) d_ijkl, likewise, l <= k innermost.
        face_strain: (b, 6, n) S of each interface per unit modal coordinate, tensor components xx yy zz yz xz xy.
        energy: (1,) J, the largest strain energy of the states at which the body was compared with its full model; in a
            state of more energy nothing is known of its error.
        tolerance: (1,) largest relative error of the strain energy that was allowed there.
        compared: (n, r) modal forces of the loads of these states: their span is what the body was reduced for.
    """

    cubic: FloatArray
    quartic: FloatArray
    face_strain: FloatArray
    energy: FloatArray
    tolerance: FloatArray
    compared: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Gyroscopic:
    """Optional group ``gyroscopic/``: kinetic energy linear in the rates, as of rotors that spin inside the body.

    The body's parts carry the angular momentum h + H q beside that of their own motion, in B, and the kinetic energy
    has the part w . (h + H q) + qd^T A q, w being the angular velocity of B.  Its forces take no power: the
    moment -(w x (h + H q) + H qd) on B, and H^T w - G qd on the modes, G = A - A^T.

    Attributes:
        momentum: (3,) N m s, h of the undeformed body, in B.
        slope: (3, n) H, N m s per unit modal coordinate, in B.
        G: (n, n) 1/s, skew.
    """

    momentum: FloatArray
    slope: FloatArray
    G: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class DistributedLoads:
    """Optional group ``loads/``: generalised forces of named loads that turn with the body.

    Attributes:
        names: (k,) as pressures and tractions are called.
        force: (k, 3) N, resultant per unit factor, in B.
        moment: (k, 3) N m, resultant moment about B's origin on the undeformed body, in B.
        modal: (k, n) work per unit modal coordinate, N per unit of M_qq = 1.
    """

    names: tuple[str, ...]
    force: FloatArray
    moment: FloatArray
    modal: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Ports:
    """Optional group ``ports/``: pairs of effort and flow beside the frames, as electrodes' voltage and charge.

    With efforts e (voltages, V) the body has the enthalpy q^T K q / 2 - q^T load^T e - e^T capacity e / 2: the modal
    coordinates have the forces load^T e, and the flows (charges, C) are load q + capacity e. Effort times the rate of
    the flow is power, W. Efforts do their work on strain: with `ModalStretch` the strain's coordinates
    (`ReducedBody.strained`) stand in the place of q. An effort of zero is a short circuit to the ground, in which the
    modes are the record's.

    Attributes:
        names: (k,) of the ports.
        efforts, flows: (k,) what they are called, as voltage and charge.
        effort_units, flow_units: (k,) as V and C.
        load: (k, n) force on each modal coordinate per unit effort; flow per unit modal coordinate.
        capacity: (k, k) flow per effort at q = 0, with what the modes leave out; symmetric, not negative.
    """

    names: tuple[str, ...]
    efforts: tuple[str, ...]
    effort_units: tuple[str, ...]
    flows: tuple[str, ...]
    flow_units: tuple[str, ...]
    load: FloatArray
    capacity: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Heat:
    """Optional group ``heat/``: those of the loads that are rises of temperature, for stress from the model.

    Attributes:
        names: (h,) of the loads.
        node: (k,) node numbers, as in `NodalModes`.
        rise: (h, k) K per unit factor, above the temperature at which the body is free of stress.
    """

    names: tuple[str, ...]
    node: IntArray
    rise: FloatArray

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class StressModes:
    """Optional group ``stress/``: stress at the nodes per unit modal coordinate, averaged over cells.

    Attributes:
        node: (k,) node numbers, as in `NodalModes`.
        x: (k, 3) m, node positions in B.
        interface: (k,) number, in the record's order, of the interface that the node is of; -1 for none. Interfaces
            without a frame in the record (`InterfaceModes`) are counted on.
        sigma: (k, 6, n) Pa, components xx yy zz xy xz yz in B's axes.
    """

    node: IntArray
    x: FloatArray
    interface: IntArray
    sigma: FloatArray

    __repr__ = brief


RecordGroup = (
    NodalModes
    | NodalInterfaces
    | FurtherUnknowns
    | Surface
    | GeometricStiffness
    | ModalStretch
    | NonlinearStiffness
    | Gyroscopic
    | DistributedLoads
    | Ports
    | Heat
    | StressModes
    | ContactPatches
)

#: The optional groups: attribute of `ReducedBody` and name in the file, and what it holds.
GROUPS: dict[str, type[RecordGroup]] = {
    "modes": NodalModes,
    "nodal": NodalInterfaces,
    "unknowns": FurtherUnknowns,
    "surface": Surface,
    "geometric": GeometricStiffness,
    "stretch": ModalStretch,
    "nonlinear": NonlinearStiffness,
    "gyroscopic": Gyroscopic,
    "loads": DistributedLoads,
    "ports": Ports,
    "heat": Heat,
    "stress": StressModes,
    "contact": ContactPatches,
}

_WHOLE = ("node", "dof", "triangle", "interface", "surface", "facet", "patch")
NAMES = ("loads", "names")
_TEXTS = (*NAMES, "efforts", "effort_units", "flows", "flow_units")


def frozen(array: ArrayLike, *, kind: type[np.generic] = np.float64) -> NDArray[Any]:
    """Return a read-only contiguous copy; the array itself, where it is one that has its numbers to itself."""
    if type(array) is np.ndarray and array.dtype == kind and not array.flags.writeable:
        if array.base is None and array.flags.c_contiguous:
            return array
    copy = np.array(array, dtype=kind, order="C", copy=True)
    copy.flags.writeable = False
    return copy


def freeze(tree: Mapping[str, Any]) -> None:
    """Make the arrays of nested dictionaries that nobody else has read-only, so that `frozen` need not copy them."""
    for value in tree.values():
        if isinstance(value, Mapping):
            freeze(value)
        elif isinstance(value, np.ndarray):
            value.flags.writeable = False


def frozen_frame(frame: InterfaceFrame) -> InterfaceFrame:
    """The frame with read-only copies of its arrays."""
    return InterfaceFrame(frame.name, frozen(frame.p_BI_B), frozen(frame.R_BI), frozen(frame.modes))


def frozen_group(group: RecordGroup) -> RecordGroup:
    """The group with read-only copies of its arrays, whole numbers where they count something."""
    parts: dict[str, Any] = {}
    for item in fields(group):
        value = getattr(group, item.name)
        if item.name in _TEXTS:
            parts[item.name] = (value,) if isinstance(value, str) else tuple(map(str, value))
        else:
            parts[item.name] = frozen(value, kind=np.int64 if item.name in _WHOLE else np.float64)
    return type(group)(**parts)
