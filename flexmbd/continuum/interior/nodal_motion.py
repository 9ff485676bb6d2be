"""Nodes of a body with history, stepped by central differences (velocity Verlet), with nothing solved.

    x_n+1 = x_n + h v_n + h^2/2 a_n,   m a_n+1 = f(x_n+1) + m g + contact,   v_n+1 = v_n + h/2 (a_n + a_n+1)

(Ambrosio & Nikravesh 1992, eq. 46.)  Damping by - m c v takes part in the sum of the forces with the velocity v_n+1 of
their instant, and so does not shorten the stable step:

    a_n+1 = (f / m + g + contact / m - c (v_n + h/2 a_n)) / (1 + c h / 2)

The account of energies takes m/2 (v^2 - (h a / 2)^2) for the kinetic energy,
which is m/2 times the velocities half a step before and after: with it and the works of forces by the trapezoidal
rule the balance of these formulas is exact, and what is left of it tells of the material alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.history.applied_loads import AppliedLoads
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.loads import BodyLoad, CentrifugalLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_turns import BondedTurns, refuse_turning_unknowns
from flexmbd.continuum.interior.bulk_viscosity import BulkForces, BulkViscosity
from flexmbd.continuum.interior.carried_mesh import CarriedMesh
from flexmbd.continuum.interior.contact_field import PushedNodes
from flexmbd.continuum.interior.contact_plane import RigidPlane
from flexmbd.continuum.interior.further_unknowns import refuse_inertia_of_further_unknowns
from flexmbd.continuum.interior.plane_motion import PlaneMotion
from flexmbd.continuum.interior.reduced_contact import reduced_contacts
from flexmbd.continuum.interior.shape_contacts import shape_contacts
from flexmbd.continuum.interior.stable_step import StableStep
from flexmbd.continuum.interior.surface_pair import NODES, SurfacePair
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.continuum.interior.touched_frames import FrameContacts
from flexmbd.errors import FormulationError, SceneError
from flexmbd.given import checked
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
Poses: TypeAlias = tuple[FloatArray, FloatArray]

# What is remembered of each node.
_NODAL = ("x", "v", "a", "force", "load", "_met", "_rubbed", "_damped", "_viscous", "_went")

# Forces whose works are summed up: of the deformation, of loads, of contact and friction, of damping, and of bulk
# viscosity, which is a part of the first.
_WORKING = ("force", "load", "_met", "_rubbed", "_damped", "_viscous")

# Energies of the formulation that have a place of their own in the account.
_NAMED = ("elastic", "plastic", "viscous")

# Part of a step by which loads are asked for beside its end: they may jump there.
_BESIDE = 1e-6


@checked()
@dataclass(frozen=True)
class Support:
    """Nodes of a facet group whose velocity components are held at zero, as on a plane of symmetry.

    Attributes:
        group: of facets.
        x, y, z: which components, in inertial axes, are held.

    Raises:
        SceneError: none is held.
    """

    group: str
    x: bool = False
    y: bool = False
    z: bool = False

    def __post_init__(self) -> None:
        if not (self.x or self.y or self.z):
            raise SceneError(f"support on {self.group!r} holds no component: say x=True, y=True or z=True")


class NodalMotion:
    """Places and velocities of a body's nodes. Constructing one is collective.

    Attributes:
        body: with its history.
        memory: how nodal values are gathered.
        mesh: the body under the nodes.
        surroundings: supports and planes, by name, as they were given.
        masses: (owned nodes,) kg.
        x, v, a: (owned nodes, 3) m, m/s, m/s^2, inertial.
        force: (owned nodes, 3) N, what the deformed body exerts on its nodes.
        load: (owned nodes, 3) N, of the applied loads, those on bonded nodes among them.
        loads: the applied loads.
        shapes: of the machine, which surfaces touch.
        pairs: contacts with other bodies, and on which side of each this one is.
        thickness: further mass of edges through a wall, or None.
        plane: of a plane body, in which its nodes are held.
        t: s.
    """

    def __init__(
        self,
        body: NonlinearModel,
        *,
        supports: Sequence[Support] = (),
        planes: Sequence[RigidPlane] = (),
        damping: float = 0.0,
        bulk_viscosity: BulkViscosity | None = None,
        loads: Sequence[BodyLoad] = (),
        bonded: NDArray[np.int32] | None = None,
        turns: BondedTurns | None = None,
        thickness: ThicknessMass | None = None,
    ) -> None:
        """Find masses and the stable step.

        Args:
            body: at rest; deformed, it begins so.
            supports: components held at zero.
            planes: what nodes may meet.
            damping: 1/s, force per mass and velocity, against inertial axes.
            bulk_viscosity: coefficients, if there is to be any.
            loads: on all nodes.
            bonded: owned nodes that somebody else moves.
            turns: unknowns that turn with these, if any.
            thickness: further mass of edges through a wall, if any.

        Raises:
            MeshError: a support or a load is on facets or nodes that the mesh has not.
            FormulationError: the mass cannot be lumped, or there are unknowns besides the displacement that have mass
                or turn with the body; springs on facets are not linear.
            SceneError: the ranks were given different supports, planes, loads or damping; damping is negative, or no
                number; a plane and a load have one name; a load is for slow loading alone.
        """
        refuse_turning_unknowns(body)
        plane_values = [(p.point.tolist(), p.normal.tolist(), p.friction, p.penalty) for p in planes]  # type: ignore[union-attr]
        if not 0.0 <= damping < float("inf"):
            raise SceneError(f"damping must be finite and at least 0 (1/s), got {damping!r}")
        self.surroundings: dict[str, object] = {
            "supports": list(supports), "planes": plane_values, "damping": float(damping),
            "bulk viscosity": None if bulk_viscosity is None else (bulk_viscosity.linear, bulk_viscosity.quadratic),
        }  # fmt: skip
        parallel.check_same(body.comm, SceneError, **self.surroundings)
        self._damping = float(damping)
        self.body, self.planes = body, tuple(planes)
        lumped = lumped_mass(body)
        refuse_inertia_of_further_unknowns(body, lumped)
        self.masses: FloatArray = body.layout.displacements(lumped)[:, 0].copy()
        if bulk_viscosity is not None and body.layout.has_further:
            raise FormulationError(
                f"{body.form_name} has unknowns besides the displacement, with which there is no bulk viscosity; leave "
                "it out, or give the form a dissipation"
            )
        bulk = None if bulk_viscosity is None else BulkForces(body, bulk_viscosity)
        self.mesh = CarriedMesh(body, self.masses, bulk=bulk, turns=turns)
        n = len(self.masses)
        self.bonded: NDArray[np.int32] = np.zeros(0, dtype=np.int32) if bonded is None else bonded
        self._moves: FloatArray = np.ones((n, 3))
        for support in supports:
            nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(support.group))
            held = np.array([support.x, support.y, support.z])
            self._moves[np.ix_(nodes[nodes < n], np.flatnonzero(held))] = 0.0
        self._moves[self.bonded] = 0.0
        self.plane, self.thickness = PlaneMotion(body), thickness
        if thickness is not None:
            thickness.hold(self._moves)
            self.surroundings["scaled_thickness"] = thickness.scale
        self._weights: FloatArray = self.masses.copy()
        self._weights[self.bonded] = 0.0
        self.loads = AppliedLoads(body, loads, mass=self.masses)
        for load in self.loads.loads:
            if isinstance(load, CentrifugalLoad):
                raise SceneError(
                    f"load {load.name!r}: moving nodes have inertia, so that a centrifugal load would count twice; let "
                    "the body rotate"
                )
        if self.loads.names:
            self.surroundings["loads"] = list(self.loads.names)
        both = {plane.name for plane in planes} & set(self.loads.names)
        if both:
            raise SceneError(f"a plane and a load are both called {sorted(both)[0]!r}; give each its own name")
        self.memory = BodyMemory(body)
        self._stable = StableStep(
            body, self.masses, self.memory, bulk=bulk, fields=self.mesh.fields, thickness=thickness
        )
        self._pushes = [plane.stiffness(self._stable.at_rest) for plane in planes]
        self._fresh = self._stable.memory
        self.meet(())
        self._limit = self._with_contact(self._stable.at_rest)
        self.x, self.v, self.a, self.force, self.load, self._met, self._rubbed, self._damped = np.zeros((8, n, 3))
        self._viscous, self._went = np.zeros((2, n, 3))  # N; m/s, the mean velocities of the last step
        self.plane_forces: FloatArray = np.zeros((len(planes), 3))
        self._R_begun: FloatArray = np.eye(3)
        self._g: FloatArray = np.zeros(3)
        self.t, self._h, self._lost = 0.0, 0.0, 0.0
        self._works: FloatArray = np.zeros(len(_WORKING))

    @property
    def mass(self) -> float:
        """Mass, kg, of the nodes that are not bonded. Collective."""
        return float(self.mesh.sum(self._weights.sum()))

    @property
    def limit(self) -> float:
        """The longest stable step, s, as last found."""
        return self._limit

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """Let surfaces touch these shapes, and no others, from the next `begin` or `restore` on. Collective.

        Raises:
            SceneError: on all ranks: as `shape_contacts`; a contact has a plane's or a load's name.
        """
        self._refuse_taken(obstacles)
        found = shape_contacts(self.body, self.masses, obstacles, h=self._stable.at_rest, bonded=self.bonded)
        self.shapes = FrameContacts(self.body, self.memory, self.masses, found)
        self.pairs: list[tuple[SurfacePair, int]] = []
        self._planned: FloatArray | None = None

    def meet_reduced(self, surfaces: Sequence[ReducedFacets]) -> None:
        """Let surfaces touch those of reduced bodies as well, after `meet`. Collective.

        Raises:
            SceneError: on all ranks: a contact has a plane's or a load's name.
        """
        self._refuse_taken(surfaces)
        found = reduced_contacts(self.body, self.masses, surfaces, h=self._stable.at_rest, size=self.size)
        self.shapes = FrameContacts(self.body, self.memory, self.masses, (*self.shapes.contacts, *found))

    def _refuse_taken(self, contacts: Sequence[Obstacle | ReducedFacets]) -> None:
        taken = {plane.name for plane in self.planes} | set(self.loads.names)
        both = sorted(taken & {one.name for one in contacts})
        if both:
            raise SceneError(f"a contact, and a plane or load, are both called {both[0]!r}; give each its own name")

    def renew_limit(self) -> float:
        """Find the longest stable step, s, of the present shape. Collective."""
        if self.mesh.bulk is not None:
            self.mesh.bulk.set_rates(self._went @ self.mesh.R)
        self._limit = self._with_contact(self._stable.present(), self._touching_bound())
        return self._limit

    def _touching_bound(self) -> float:
        """1/s^2, of contacts with shapes and other bodies. Collective."""
        for pair, _ in self.pairs if self._h == 0.0 else ():
            pair.approach()
            pair.check_start()
        return self.shapes.stiffness_bound(self.x) + sum(pair.stiffness_bound() for pair, _ in self.pairs)

    @property
    def step_at_rest(self) -> float:
        """The longest stable step, s, of the undeformed body without contact."""
        return self._stable.at_rest

    @property
    def ahead(self) -> FloatArray:
        """(owned nodes, 3) m, where nodes are at the end of the step that is planned, or else now."""
        return self.x if self._planned is None else self.x + self._planned

    def _with_contact(self, h: float, shapes: float = 0.0) -> float:
        """The longest stable step, s, where it is h without contact; shapes: 1/s^2, what they add."""
        by_itself = max(1.0, self.shapes.own_rate * h**2 / 4)  # of this body and those that it touches
        return float(h / np.sqrt(by_itself + (max(self._pushes, default=0.0) + shapes) * h**2 / 4))

    def begin(
        self, p: FloatArray, R: FloatArray, gravity: FloatArray, *, t: float = 0.0, shapes: Poses | None = None,
        frames: FloatArray | None = None,
    ) -> None:
        """As the body was given, at rest; velocities are to be set, `start` called. Collective.

        Args:
            p: (3,) m, of the body's axes.
            R: (3, 3) from them to inertial ones.
            gravity: (3,) m/s^2.
            t: s.
            shapes: places (m, 3) m and rotations (m, 3, 3) of the frames of shapes; needed where there are some.
            frames: as of `advance`.

        Raises:
            SceneError: the body begins behind a plane or in a shape.
        """
        self.x = self.mesh.begin(p, R)
        self.plane.begin(np.asarray(R, dtype=float))
        self.v, self.a, self.force, self.load, self._met, self._rubbed, self._damped = np.zeros((7, *self.x.shape))
        self._viscous, self._went = np.zeros((2, *self.x.shape))
        self.plane_forces[:] = 0.0
        self.t, self._R_begun = t, np.array(R, dtype=float)
        self._g = np.array(gravity, dtype=float)
        self._works[:] = 0.0
        self._h = self._lost = 0.0
        self._stable.memory = self._fresh
        alone = self._stable.at_rest
        if not self.mesh.begins_fresh:
            self.force = self._pull(0.0, frames)
            alone = self._stable.present()
        self._limit = self._with_contact(alone)
        for plane in self.planes:
            body_energies = self.body.comm.allgather(float(plane.depth(self.x).max(initial=-np.inf)))
            plane.check_start(max(body_energies), self.size)
        self._planned = None
        for pair, _ in self.pairs:
            pair.begin()
        if shapes is not None:
            self.shapes.begin(self.x, *shapes, size=self.size)
            self._limit = self._with_contact(alone, self.shapes.stiffness_bound(self.x))

    @property
    def size(self) -> float:
        """m, the largest coordinate of the undeformed body. Collective."""
        return float(max(self.body.comm.allgather(float(abs(self.mesh.X).max(initial=0.0)))))

    def start(self, h: float) -> None:
        """Forces at the start, before a first step h (s). Collective where there are loads."""
        self.v = self._held(self.v)
        self._h = h
        if self.loads.any_heat:
            self.loads.heat(self.loads.values(self.t + _BESIDE * h))
            self.force = self._pull(0.0, None)
        self.load = self.loads_at(self.t + _BESIDE * h)
        free = self._accelerate(self.v, h, h**2 / 2, answer=1.0)
        self._damped = self._drag()
        self._lost = (float(self._weights @ (self.a**2 - free**2).sum(axis=1)) + self._further(self.a, free)) * h**2 / 8

    def plan(self, h: float, bonded: FloatArray | None = None) -> FloatArray:
        """Find how far (owned nodes, 3) m nodes go in a step h (s); arguments as of `advance`. Collective."""
        if self._h == 0.0:
            self.start(h)
        if self.loads.any:  # which may have jumped since the last step's end
            after = self.loads_at(self.t + _BESIDE * h)
            jump = self._answered(self._held((after - self.load) / self.masses[:, None]))
            self.a = self.a + jump / (1.0 + self._damping * self._h / 2)
            self.load = after
        move = h * self.v + h**2 / 2 * self.a
        if bonded is not None:
            move[self.bonded] = bonded - self.x[self.bonded]
        for pair, side in self.pairs:
            pair.plan(side)
        self._planned = move
        return move

    def advance(
        self,
        h: float,
        bonded: FloatArray | None = None,
        frames: FloatArray | None = None,
        *,
        shapes: Poses | None = None,
    ) -> None:
        """Step by h (s). Collective.

        Args:
            h: s.
            bonded: (bonded nodes, 3) m, where they are at the end.
            frames: (k, 3, 3) axes of the frames at the end, of bodies with unknowns that turn with them.
            shapes: where the frames of shapes are at the end, as of `begin`.

        Raises:
            ConvergenceError: on all ranks: a cell is turned inside out.
        """
        move = self.plan(h, bonded) if self._planned is None else self._planned
        self._planned = None
        before = [getattr(self, name) for name in _WORKING]
        touched = None if shapes is None else self.shapes.remembered()
        self.x += move
        self._went = np.asarray(move / h)
        if self.loads.any_heat:
            self.loads.heat(self.loads.values(self.t + h - _BESIDE * h))
        self.force = self._pull(h, frames)
        self.t += h
        if self.loads.any:
            self.load = self.loads_at(self.t - _BESIDE * h)
        middle = self.v + h / 2 * self.a
        self._h = h
        if shapes is not None:
            self.shapes.place(*shapes)
        self._accelerate(middle, h, h**2, answer=1.0 / (1.0 + self._damping * h / 2))
        self.v = middle + h / 2 * self.a
        self._damped = self._drag()
        for i, (first, name) in enumerate(zip(before, _WORKING, strict=True)):
            self._works[i] += np.vdot(move, first + getattr(self, name)) / 2
        if touched is not None:
            self.shapes.walk(self.x)
            self._works[2:4] += self.shapes.worked(touched)

    def _pull(self, h: float, frames: FloatArray | None) -> FloatArray:
        """(owned nodes, 3) N, of the body and of springs on facets, after a step of h (s). Collective."""
        force = self.mesh.pull(self.x, dt=h, frames=frames)
        self._viscous = self.mesh.viscous
        if self.body.springs is not None and self.mesh.fields is None:
            # to the ground, on which a body by itself began
            force -= self.body.springs.of_nodes(self.x - self.mesh.X)
        return force

    def energies(self) -> dict[str, float]:
        """Energies, J, by name: stored and dissipated. Collective; the same on all ranks.

        "kinetic", "elastic", "plastic" (work of the yield stress), "contact" (stored by penalties and lost in
        impacts), "friction" and "damping" (lost), "gravitational";
        "viscous" (lost) by bulk viscosity and formulations that dissipate;
        "springs" on facets, where there are some;
        "loads" where there are some: minus the work that they have done, on bonded nodes as well;
        "splitting" (lost) where the form has unknowns besides the displacement (`staggered_fields`), and what else the
        formulation tells, as the energy of its cracks.
        """
        body_energies = self.body.energies()
        square = (self.v**2).sum(axis=1) - (self._h / 2) ** 2 * (self.a**2).sum(axis=1)
        kinetic, weight = self._weights @ square / 2, -self._weights @ (self.x @ self._g)
        kinetic += self._further(self.v, self._h / 2 * self.a) / 2
        _, loads, contact, friction, damping, viscous = self._works
        sums = self.mesh.sum(np.array([kinetic, weight, self._lost - contact, -friction, -damping, -loads, -viscous]))
        outer = {"loads": float(sums[5])} if self.loads.any else {}
        if self.mesh.bulk is not None or "viscous" in body_energies:
            outer["viscous"] = body_energies.get("viscous", 0.0) + float(sums[6])
        return {
            "kinetic": float(sums[0]),
            "elastic": body_energies.get("elastic", 0.0),
            "plastic": body_energies.get("plastic", 0.0),
            "contact": float(sums[2]),
            "friction": float(sums[3]),
            "damping": float(sums[4]),
            "gravitational": float(sums[1]),
            **{name: value for name, value in body_energies.items() if name not in _NAMED},
            **self._spring_energy(),
            **({} if self.mesh.fields is None else {"splitting": -self.mesh.fields.lost}),
            **outer,
        }

    def _spring_energy(self) -> dict[str, float]:
        springs = self.body.springs
        if springs is None or self.mesh.fields is not None:
            return {}
        return {"springs": springs.energy_of_nodes(self.x - self.mesh.X)}

    def internal_work(self) -> float:
        """Work, J, done on the deformation since the start, by the trapezoidal rule over all steps. Collective."""
        return -float(self.mesh.sum(self._works[:1])[0])

    def outer_forces(self) -> dict[str, FloatArray]:
        """(3,) N by name, of planes (of one name their sum) and loads on the body at a step's end. Collective."""
        found: dict[str, FloatArray] = {plane.name: np.zeros(3) for plane in self.planes}
        for plane, force in zip(self.planes, self.mesh.sum(self.plane_forces), strict=True):
            found[plane.name] = found[plane.name] + force
        found.update(self.shapes.resultants())
        for pair, side in self.pairs:
            found[pair.given.name] = self.mesh.sum(pair.resultant) * (1.0 if side == NODES else -1.0)
        if self.loads.any:
            values = self.loads.values(self.t)
            found.update(self.loads.resultants(values, self.x, self._R_begun))
        return found

    def momentum(self, about: FloatArray) -> FloatArray:
        """(6,) linear momentum, N s, and angular momentum about a point (m), N m s. Collective."""
        linear = self._weights[:, None] * self.v
        if self.thickness is not None:
            linear = linear + self.thickness.times(self.v)
        return self.mesh.sum(np.append(linear.sum(axis=0), np.cross(self.x - about, linear).sum(axis=0)))

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        nodal = {name: self.memory.gather_nodes(getattr(self, name)) for name in _NODAL}
        works = self.mesh.sum(np.array([*self._works, self._lost]))
        own = [self._h, self._limit, *self._stable.memory, self.t]
        axes = np.concatenate([self.mesh.p, self.mesh.R.ravel(), self._g, own, self._R_begun.ravel()])
        sums = {"works": works, "axes": axes, "plane forces": self.mesh.sum(self.plane_forces)}
        if self.mesh.fields is not None:
            sums["splitting"] = np.array(self.mesh.fields.lost)
            self.mesh.fields.forget()  # as whoever goes on from here
        touching = self.shapes.snapshot()
        for k, (pair, side) in enumerate(self.pairs):
            if side == NODES:
                touching |= {f"pair {k} {name}": part for name, part in pair.snapshot().items()}
        return {**nodal, **self.memory.gather(self.body.snapshot()), **sums, **touching}

    def restore(self, memory: dict[str, FloatArray]) -> None:
        """Go back to a snapshot of this body, on any number of ranks. Collective."""
        for name in _NODAL:
            setattr(self, name, self.memory.scatter_nodes(memory[name])[: len(self.masses)])
        self.body.restore(self.memory.scatter(memory))
        # sums over the ranks, of which the first has the whole
        *self._works[:], self._lost = memory["works"] * (self.body.comm.rank == 0)
        axes = np.array(memory["axes"], dtype=float)
        self.mesh.place(axes[:3], axes[3:12].reshape(3, 3))
        self._g = axes[12:15]
        self._h, self._limit = float(axes[15]), float(axes[16])
        self._stable.memory = float(axes[17]), float(axes[18])
        self.t, self._R_begun = float(axes[19]), axes[20:29].reshape(3, 3)
        self.plane.begin(self._R_begun)
        self.plane_forces = memory["plane forces"] * (self.body.comm.rank == 0)
        if self.mesh.fields is not None:
            self.mesh.fields.lost = float(memory["splitting"])
            self.mesh.fields.forget()
        self.shapes.restore(memory, self.x)
        self._planned = None
        for k, (pair, side) in enumerate(self.pairs):
            if side == NODES:
                pair.restore({name: memory[f"pair {k} {name}"] for name in ("memory", "sums")})

    def loads_at(self, t: float) -> FloatArray:
        """(owned nodes, 3) N, of the loads at t (s) where the nodes are. Collective where there are loads."""
        if not self.loads.any:
            return np.zeros_like(self.x)
        values, force = self.loads.values(t), np.zeros_like(self.x)
        if self.loads.any_follow:
            # tractions are given in body axes, and follow from the axes in which the body began
            turned = self.loads.following(values, self.x @ self._R_begun)
            force += turned @ self._R_begun.T
        return np.asarray(force + self.loads.dead(values, self._R_begun))

    @property
    def touched(self) -> FloatArray:
        """(owned nodes, 3) N, of contact and friction, of shapes those on bonded nodes as well."""
        return np.asarray(self._met + self._rubbed)

    def _held(self, vectors: FloatArray, nodes: Any = slice(None)) -> FloatArray:
        """Vectors (nodes, 3) of owned nodes, or of these, without the components along which they are held."""
        return self.plane.in_plane(vectors * self._moves[nodes])

    def pushed(self) -> PushedNodes | None:
        """The owned nodes, by planes, shapes and other bodies; None where nothing is touched."""
        surfaces = [*(shape.nodes for shape in self.shapes.contacts), *(pair.nodes(side) for pair, side in self.pairs)]
        if not (surfaces or self.planes):
            return None
        touches = np.full(len(self.x), float(bool(self.planes)))  # a plane is met by all nodes
        for nodes in surfaces:
            touches[nodes] = 1.0
        return PushedNodes(touches, np.linalg.norm(self._met, axis=1))

    def _answered(self, alone: FloatArray) -> FloatArray:
        """(owned nodes, 3) m/s^2, where they would be ``alone`` by the lumped masses. Collective."""
        return alone if self.thickness is None else self.thickness.accelerations(alone)

    def _further(self, one: FloatArray, other: FloatArray) -> float:
        """The difference of the squares of two vectors at nodes by the further mass: this rank's part. Collective."""
        return 0.0 if self.thickness is None else self.thickness.square(one) - self.thickness.square(other)

    def _drag(self) -> FloatArray:
        """(owned nodes, 3) N, of damping."""
        if self._damping == 0.0:
            return np.zeros_like(self.v)
        if self.thickness is not None:
            return np.asarray(-self._damping * (self._weights[:, None] * self.v + self.thickness.times(self.v)))
        return np.asarray(-self._damping * self._weights[:, None] * self.v)

    def _accelerate(self, v: FloatArray, h: float, reach: float, *, answer: float) -> FloatArray:
        """Set accelerations and contact forces; returns the accelerations without contact.

        Args:
            v: velocities with which the step is made before the accelerations act.
            h: the step.
            reach: what an acceleration adds to the places at its end.
            answer: the accelerations that are left of forces per mass, as these add to damping.
        """
        pull = self._held((self.force + self.load) / self.masses[:, None] + self._g - self._damping * v)
        if self.thickness is not None:  # damping is by all mass
            damped = self._held(-self._damping * v)
            pull = self.thickness.accelerations(pull - damped) + damped
        free = answer * pull
        m = self._weights[:, None]
        self._met, self._rubbed = np.zeros((2, *self.x.shape))
        for k, (plane, stiffness) in enumerate(zip(self.planes, self._pushes, strict=True)):
            met, rubbed = plane.push(self.x, v, pull, h=h, reach=answer * reach, stiffness=stiffness)
            self._met += m * met
            self._rubbed += m * rubbed
            self.plane_forces[k] = (m * (met + rubbed)).sum(axis=0)
            pull = pull + self._answered(self._held(met + rubbed))
        for shape in self.shapes.contacts:
            pushed = shape.push(self.x, v, pull, h=h, reach=answer * reach)
            nodes, on = pushed.nodes, self.masses[pushed.nodes, None]
            self._met[nodes] += on * pushed.met
            self._rubbed[nodes] += on * pushed.rubbed
            shape.take(self.x[nodes], on * pushed.met, on * pushed.rubbed)
            if self.thickness is None:
                pull[nodes] += self._held(pushed.met + pushed.rubbed, nodes)
                continue
            alone = np.zeros_like(pull)
            alone[nodes] = self._held(pushed.met + pushed.rubbed, nodes)
            pull = pull + self.thickness.accelerations(alone)
        for pair, side in self.pairs:
            met, rubbed = pair.take(side)
            self._met += met
            self._rubbed += rubbed
            pull = pull + self._answered(self._held((met + rubbed) / self.masses[:, None]))
        self.a = answer * pull
        return free
