"""A body with history between rigid frames, stepped by central differences: an `ExplicitInterior` of the machine.

The nodes of an interface are bonded to its frame and move with it; the frame's constant mass matrix is that of its
rigid part and of these nodes (Ambrosio & Nikravesh 1992, eq. 47-51, 56), which the machine knows as a rigid body with
the gyroscopic terms s_omega.  What is left of the reaction (eq. 52-53) is the sum of the internal forces on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.body_observer import BodyObserver
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.bulk_viscosity import BulkViscosity
from flexmbd.continuum.interior.contact_plane import RigidPlane
from flexmbd.continuum.interior.machine_frames import path_of_frames
from flexmbd.continuum.interior.nodal_contacts import Poses
from flexmbd.continuum.interior.nodal_inertia import Support
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.continuum.interior.shape_contacts import check_surface
from flexmbd.continuum.interior.surface_pair import FACETS, NODES, SurfacePair
from flexmbd.continuum.interior.thickness_mass import thickness_mass
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Memory, Push
from flexmbd.multibody.interiors.observed import InteriorFields, InteriorMesh
from flexmbd.multibody.interiors.time_factor import TimeFactor
from flexmbd.multibody.interiors.touching_interior import FacingSurface, Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Steps after which the stable one is found anew.
_RENEWAL = 5

# A step that is the stable one but for the accuracy of the estimate is taken whole.
_ESTIMATE = 1e-4


@checked(agree=parallel.told_to_all)
class ExplicitContinuum:
    """The interior of a body with history, stepped explicitly between its frames. Constructing one is collective.

    Attributes:
        motion: of the nodes.
        frames: of the body's interfaces, with their rigid parts and bonded nodes.
        mass: kg, of the nodes that are not bonded.
    """

    def __init__(
        self,
        body: NonlinearModel,
        *,
        rigid_parts: Mapping[str, RigidBody] | None = None,
        planes: Sequence[RigidPlane] = (),
        supports: Sequence[Support] = (),
        damping: float = 0.0,
        bulk_viscosity: BulkViscosity | None = None,
        loads: Sequence[BodyLoad] = (),
        scaled_thickness: float = 0.0,
    ) -> None:
        """Collect the frames and find the stable step.

        Args:
            body: at rest, with at least one interface; all of them rigid. What has deformed it before, as `follow`, it
                begins with: its stress and history, and the frames where its interfaces are.
            rigid_parts: by interface, the rigid part bonded there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            planes: rigid planes that the nodes that are not bonded may touch.
            supports: components of nodes that are not bonded held at zero.
            damping: 1/s, of those nodes: force per mass and velocity, against inertial axes.
            bulk_viscosity: pressure by the rate of volume change, for shocks; a shorter stable step.
            loads: on all nodes; those on bonded nodes act on their frames.
            scaled_thickness: 1: walls of one layer of layered cells vibrate through their thickness as slowly as in
                the wall, by further mass that no translation feels, so that stable steps go by the cells' size in the
                wall; a part of 1: as slowly as cells of that part of the size would, with the square of that part of
                further rotary inertia; 0: as they are.

        Raises:
            InterfaceError: no interface, an averaged one, or none of the name of a rigid part; an interface of a
                deformed body has not moved as a rigid body.
            FormulationError: the mass cannot be lumped; as `ThicknessMass`.
            SceneError, MeshError: as `NodalMotion`, of planes, supports and loads.
        """
        thickness = thickness_mass(body, scaled_thickness)
        self._body, self._bonds = body, BondedNodes(body, rigid_parts=rigid_parts, thickness=thickness)
        self._nodes: NDArray[np.int32] = self._bonds.nodes[self._bonds.own]
        self.motion = NodalMotion(
            body, supports=supports, planes=planes, damping=damping, loads=loads, bonded=self._nodes,
            bulk_viscosity=bulk_viscosity, turns=self._bonds.turns, thickness=thickness,
        )
        self.frames, self.mass = self._bonds.frames, self._bonds.free_mass
        self._wrenches: FloatArray = np.zeros((len(self.frames), 6))
        self._calls = 0
        self._observer = BodyObserver(body, self.motion.memory)

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `ExplicitInterior`. The nodes move as the first frame, rigidly. Collective."""
        nodes = self.motion
        k = len(self.frames)
        nodes.begin(*self._bonds.pose(motion), gravity, t=t, shapes=self._shapes(motion), frames=motion.R[:k])
        nodes.inertia.plane.begin(self._bonds.pose(motion)[1], motion)
        nodes.v[:] = motion.v[0] + np.cross(motion.w[0], nodes.x - motion.p[0])
        nodes.contacts.shapes.approach(nodes.x, nodes.v, motion.v[k:], motion.w[k:], h=nodes.limit)
        nodes.v[self._nodes] = 0.0
        self._wrenches = self._on_frames(motion, nodes.force + nodes.loads_at(t))
        self._calls = 0
        return self._wrenches.copy()

    def stable_step(self) -> float:
        """See `ExplicitInterior`. The frames, which bind nodes and add mass, only make it longer. Collective."""
        return self.motion.renew_limit()

    def advance(self, h: float, start: FrameMotion, end: FrameMotion) -> Push:
        """See `ExplicitInterior`. Collective."""
        # a body that is crushed may need shorter steps before the machine asks again
        self.motion.inertia.plane.check(end)
        limit = self.motion.renew_limit() if self._calls % _RENEWAL == 0 else self.motion.limit
        self._calls += 1
        steps = max(1, int(np.ceil(h / limit * (1.0 - _ESTIMATE))))
        if steps > 1 and self.motion.contacts.pairs:
            raise ConvergenceError(
                f"a body that touches another one steps with it, and h = {h:.4g} s is above its stable step by now, "
                f"{limit:.4g} s; take a smaller h"
            )
        mean = np.zeros_like(self._wrenches)
        for frames in path_of_frames(start, end, h=h, steps=steps):
            before = self._wrenches
            bonded = self._bonds.positions(frames)[self._bonds.own]
            self.motion.advance(h / steps, bonded, frames.R, shapes=self._shapes(frames))
            self._wrenches = self._on_frames(frames, self.motion.pushing)
            mean += (before + self._wrenches) / (2 * steps)
        return Push(self._wrenches.copy(), mean)

    def _on_frames(self, frames: FrameMotion, nodal: FloatArray) -> FloatArray:
        """(k + m, 6) wrenches: of what acts on the bonded among the owned nodes (n, 3) N, and on shapes. Collective."""
        forces = np.zeros((len(self._bonds.own), 3))
        forces[self._bonds.own] = nodal[self._nodes]
        wrenches, couples = self._bonds.wrenches(forces, self._bonds.arms(frames)), self.motion.mesh.couples
        wrenches[: len(couples)] += couples
        return np.vstack([wrenches, self.motion.contacts.shapes.wrenches()])

    def _shapes(self, frames: FrameMotion) -> Poses | None:
        """Where the frames of shapes are; None where there are none."""
        k = len(self.frames)
        return (frames.p[k:], frames.R[k:]) if len(frames.p) > k else None

    def plan(self, h: float, start: FrameMotion, end: FrameMotion) -> None:
        """See `PairedInterior`. Collective."""
        if self.motion.contacts.pairs:
            self.motion.plan(h, self._bonds.positions(end)[self._bonds.own])

    def check_surface(self, surface: str, *, what: str) -> None:
        """See `TouchingInterior`. Collective."""
        check_surface(self._body, surface, what=what)

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """See `TouchingInterior`. Collective."""
        self.motion.meet(obstacles)
        self._wrenches = np.zeros((len(self.frames) + len(obstacles), 6))

    def meet_reduced(self, surfaces: Sequence[ReducedFacets]) -> None:
        """See `ReducedTouchingInterior`. Collective."""
        self.motion.meet_reduced(surfaces)
        more = sum(len(one.frames) for one in surfaces)
        self._wrenches = np.zeros((len(self._wrenches) + more, 6))

    def face(self, facing: FacingSurface) -> None:
        """See `TouchingInterior`. Collective."""
        other = facing.other
        if not isinstance(other, ExplicitContinuum):
            raise SceneError(
                f"contact {facing.name!r}: surfaces of two bodies with history touch in explicit steps alone, both of "
                f"them ExplicitContinuum; the other's interior is {type(other).__name__}"
            )
        pair = SurfacePair(facing, self.motion, other.motion, (facing.surface, facing.facets))
        self.motion.contacts.pairs.append((pair, NODES))
        other.motion.contacts.pairs.append((pair, FACETS))

    @property
    def load_factors(self) -> tuple[TimeFactor, ...]:
        """See `LoadedInterior`."""
        return self.motion.loads.factors

    def outline(self) -> InteriorMesh:
        """See `ObservedInterior`. Collective."""
        return self._observer.outline()

    def observe(self, motion: FrameMotion) -> InteriorFields:
        """See `ObservedInterior`. Collective."""
        nodes, v, a = self.motion, self.motion.v.copy(), self.motion.a.copy()
        own = self._bonds.own
        v[self._nodes], a[self._nodes] = self._bonds.velocities(motion)[own], self._bonds.accelerations(motion)[own]
        for rates in (v, a):
            self._body.complete_nodes(rates)
        pose, nodal = self._bonds.pose(motion), (nodes.x, v, a)
        return self._observer.fields(pose, nodes.mesh.R, nodal=nodal, pushed=nodes.contacts.pushed())

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """See `ObservedInterior`. Collective."""
        return self._observer.locate(point)

    def port_states(self) -> Mapping[str, FloatArray]:
        """See `PortedInterior`."""
        return self._body.port_states()

    def outer_forces(self) -> Mapping[str, FloatArray]:
        """See `ObservedInterior`. Collective."""
        return self.motion.outer_forces()

    def snapshot(self) -> Memory:
        """See `Interior`. Of the whole body, whatever the ranks. Collective."""
        return {**self.motion.snapshot(), "wrenches": self._wrenches.copy(), "calls": np.array(self._calls)}

    def restore(self, memory: Memory) -> None:
        """See `Interior`; on any number of ranks. Collective."""
        self.motion.restore({name: np.asarray(part, dtype=float) for name, part in memory.items()})
        self._wrenches = np.array(memory["wrenches"], dtype=float)
        self._calls = int(memory["calls"])

    def energies(self) -> Mapping[str, float]:
        """Energies, J, of the nodes that are not bonded and of the deformation (`NodalMotion.energies`). Collective."""
        return self.motion.energies()
