"""A frame of beams by the discrete element method: rigid lumps on nodes, tied by massless beam springs.

Anthonis & Ramon 2003, section 4.2. Between nodes a beam is exact in statics; its mass lies on the nodes,
and so do all loads.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.beams.arc import Arc
from flexmbd.beams.castigliano import Section, check_section, stiffness
from flexmbd.beams.frame_mesh import Beam, FrameMesh, Point, mesh_frame
from flexmbd.beams.lumps import Lumping, half, nodal_mass, point
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.record.reduced_body import FRAME_DOFS

FloatArray = NDArray[np.float64]

#: Coordinates of a node of a frame in the plane of x and y.
PLANE = ("x", "y", "rz")


@checked("points", "beams", "sections", "coordinates")
@dataclass(frozen=True, eq=False)
class DiscreteFrame:
    """Discrete elements between named points.

    Attributes:
        points: by name, (3,) m.
        beams: by group, the beams between points (`flexmbd.beams.frame_mesh`), straight or arcs.
        sections: by group; `flexmbd.forms.beam_timoshenko.Parameters` or an object with the same attributes.
        divisions: elements a beam; one number, or one by group.
        lumping: how mass is lumped at the nodes.
        coordinates: of each node, among `FRAME_DOFS`, along and about the frame's axes; the others are held.

    Raises:
        MeshError: the points and beams are no frame.
        SceneError: sections that are none or do not fit the groups, or unknown coordinates.
    """

    points: Mapping[str, Point]
    beams: Mapping[str, Sequence[Beam]]
    sections: Mapping[str, Section]
    divisions: int | Mapping[str, int]
    lumping: Lumping = Lumping.PIECES
    coordinates: tuple[str, ...] = FRAME_DOFS

    def __post_init__(self) -> None:
        if not isinstance(self.lumping, Lumping):
            raise SceneError(f"lumping must be Lumping.PIECES or Lumping.POINTS, got {self.lumping!r}")
        unknown = [one for one in self.coordinates if one not in FRAME_DOFS]
        if unknown or not self.coordinates:
            raise SceneError(f"coordinates must be some of {', '.join(FRAME_DOFS)}, got {self.coordinates!r}")
        mesh = self.mesh
        if set(self.sections) != set(mesh.groups):
            raise SceneError(
                f"sections are given for {', '.join(map(repr, self.sections)) or 'no group'}; give one for each group "
                f"of beams: {', '.join(map(repr, mesh.groups))}"
            )
        for name, section in self.sections.items():
            check_section(section, name)
        for arc, group in zip(self._arcs, self._groups, strict=True):
            arc.axes(np.array([0.0, 0.5, 1.0]), self.sections[group], group)  # refuses orientations along beams

    @cached_property
    def mesh(self) -> FrameMesh:
        """Nodes and elements."""
        return mesh_frame(self.points, self.beams, divisions=self.divisions)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.mesh.x)

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """(6 nodes,) which coordinates the nodes have."""
        return np.tile([dof in self.coordinates for dof in FRAME_DOFS], self.n_nodes)

    @cached_property
    def K(self) -> FloatArray:
        """(6 nodes, 6 nodes) stiffness of all nodal coordinates, N/m, N, N m."""
        size = 6 * self.n_nodes
        whole = np.zeros((size, size))
        for (a, b), arc, group in zip(self.mesh.elements, self._arcs, self._groups, strict=True):
            rows = np.concatenate([6 * a + np.arange(6), 6 * b + np.arange(6)])
            section = self.sections[group]
            axes = arc.axes(np.zeros(1), section, group)[0]
            turn = np.kron(np.eye(4), axes)
            along = axes @ (self.mesh.x[b] - self.mesh.x[a])
            whole[np.ix_(rows, rows)] += turn.T @ stiffness(arc.flexibility(section, group), along) @ turn
        return whole

    @cached_property
    def moments(self) -> FloatArray:
        """(nodes, 4, 4) integrals of rho {1, r} {1, r} of the lumps, r from their nodes, kg, kg m, kg m^2."""
        total: FloatArray = np.zeros((self.n_nodes, 4, 4))
        for (a, b), arc, group in zip(self.mesh.elements, self._arcs, self._groups, strict=True):
            total[a] += half(arc, self.sections[group], group, near_start=True)
            total[b] += half(arc, self.sections[group], group, near_start=False)
        if self.lumping is Lumping.POINTS:
            total = np.array([point(one) for one in total])
        return total

    @cached_property
    def M(self) -> FloatArray:
        """(6 nodes, 6 nodes) lumped mass of all nodal coordinates, kg, kg m, kg m^2."""
        import scipy.linalg  # on need: few scenes have beams

        return scipy.linalg.block_diag(*nodal_mass(self.moments))

    def node(self, place: str | ArrayLike) -> int:
        """The number of a node by its name, or by where it is.

        Args:
            place: a name, or (3,) m.

        Raises:
            SceneError: there is no node there; the message names the nearest one.
        """
        return self.mesh.node(place)

    @checked("force", "moment")
    def load(
        self, place: str | ArrayLike, *, force: ArrayLike = (0.0, 0.0, 0.0), moment: ArrayLike = (0.0, 0.0, 0.0)
    ) -> FloatArray:
        """(6 nodes,) the load vector of a force (N) and a moment (N m) on a node, along the frame's axes.

        Raises:
            SceneError: the place is not a node, or the force or the moment is not three numbers.
        """
        loads = np.zeros(6 * self.n_nodes)
        row = 6 * self.node(place)
        if np.shape(force) != (3,) or np.shape(moment) != (3,):
            raise SceneError(f"force and moment must be three numbers each, got {force!r:.60} and {moment!r:.60}")
        loads[row : row + 3], loads[row + 3 : row + 6] = force, moment
        return loads

    @checked("loads", "clamped")
    def displaced(self, loads: ArrayLike, *, clamped: Iterable[str | ArrayLike]) -> FloatArray:
        """(nodes, 6) displacement (m) and small rotation (rad) of the nodes at rest under loads.

        Args:
            loads: (6 nodes,) as `load` gives them, which add.
            clamped: nodes that are held, by name or place.

        Raises:
            SceneError: the clamped nodes leave the frame free to move, a place is not a node, or the loads do not fit.
        """
        import scipy.linalg  # on need: few scenes have beams

        load = np.asarray(loads, dtype=np.float64)
        if load.shape != (6 * self.n_nodes,):
            raise SceneError(f"loads must have shape ({6 * self.n_nodes},), as load() gives them, got {load.shape}")
        free = self.active.copy()
        for place in clamped:
            node = self.node(place)
            free[6 * node : 6 * node + 6] = False
        moved = np.zeros(6 * self.n_nodes)
        try:
            factor = scipy.linalg.cho_factor(self.K[np.ix_(free, free)])
        except scipy.linalg.LinAlgError as error:
            raise SceneError("the frame can move as a whole: clamp a node") from error
        moved[free] = scipy.linalg.cho_solve(factor, load[free])
        return moved.reshape(-1, 6)

    @cached_property
    def _groups(self) -> list[str]:
        """The group of each element."""
        return [self.mesh.groups[group] for group in self.mesh.group]

    @cached_property
    def _arcs(self) -> list[Arc]:
        """The axis of each element."""
        x, ends = self.mesh.x, self.mesh.elements
        return [Arc(x[a], middle, x[b]) for (a, b), middle in zip(ends, self.mesh.middles, strict=True)]
