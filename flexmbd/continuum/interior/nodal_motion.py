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

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.applied_loads import beside
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.locking_bodies import tell_locking_body
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_turns import BondedTurns, refuse_turning_unknowns
from flexmbd.continuum.interior.bulk_viscosity import BulkForces, BulkViscosity
from flexmbd.continuum.interior.carried_mesh import CarriedMesh
from flexmbd.continuum.interior.contact_plane import RigidPlane
from flexmbd.continuum.interior.loads_in_motion import loads_on_moving_nodes
from flexmbd.continuum.interior.nodal_account import NodalAccount
from flexmbd.continuum.interior.nodal_contacts import NodalContacts, Poses
from flexmbd.continuum.interior.nodal_inertia import NodalInertia, Support
from flexmbd.continuum.interior.stable_step import StableStep
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]

# What is remembered of each node.
_NODAL = ("x", "v", "a", "force", "load", "_damped", "_viscous", "_went")

# Part of a step by which loads are asked for beside its end: they may jump there.
_BESIDE = 1e-6


class NodalMotion:
    """Places and velocities of a body's nodes. Constructing one is collective.

    Attributes:
        body: with its history.
        memory: how nodal values are gathered.
        mesh: the body under the nodes.
        surroundings: supports and planes, by name, as they were given.
        inertia: of its nodes, and what holds them.
        contacts: with planes, shapes and other bodies.
        x, v, a: (owned nodes, 3) m, m/s, m/s^2, inertial.
        force: (owned nodes, 3) N, what the deformed body exerts on its nodes.
        load: (owned nodes, 3) N, of the applied loads, those on bonded nodes among them.
        loads: the applied loads.
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
        self.body = body
        self.inertia = inertia = NodalInertia(
            body, supports=supports, damping=float(damping), bonded=bonded, thickness=thickness
        )
        bulk = None if bulk_viscosity is None else BulkForces(body, bulk_viscosity)
        tell_locking_body(body, inertia.is_held)
        self.mesh = CarriedMesh(body, inertia.masses, bulk=bulk, turns=turns)
        self.loads = loads_on_moving_nodes(body, loads, mass=inertia.lumped)
        if thickness is not None:
            self.surroundings["scaled_thickness"] = thickness.scale
        if self.loads.names:
            self.surroundings["loads"] = list(self.loads.names)
        self.memory = BodyMemory(body)
        self._stable = StableStep(
            body, inertia.masses, self.memory, bulk=bulk, fields=self.mesh.fields, thickness=thickness
        )
        self._fresh = self._stable.memory
        self.contacts = NodalContacts(
            body, inertia, self.memory, planes=planes, loads=self.loads.names, h=self.step_at_rest
        )
        self._planned: FloatArray | None = None
        self._limit = self.contacts.limited(self.step_at_rest)
        n = len(inertia.masses)
        self.x, self.v, self.a, self.force, self.load, self._damped = np.zeros((6, n, 3))
        self._viscous, self._went = np.zeros((2, n, 3))  # N; m/s, the mean velocities of the last step
        self._R_begun: FloatArray = np.eye(3)
        self._g: FloatArray = np.zeros(3)
        self.t, self._h = 0.0, 0.0
        self._account = NodalAccount(self.mesh, has_loads=self.loads.any)

    @property
    def mass(self) -> float:
        """Mass, kg, of the nodes that are not bonded. Collective."""
        return float(self.mesh.sum(self.inertia.weights.sum()))

    @property
    def masses(self) -> FloatArray:
        """(owned nodes,) kg."""
        return self.inertia.masses

    @property
    def limit(self) -> float:
        """The longest stable step, s, as last found."""
        return self._limit

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """Let surfaces touch these shapes, and no others, from the next `begin` or `restore` on. Collective.

        Raises:
            SceneError: on all ranks: as `shape_contacts`; a contact has a plane's or a load's name.
        """
        self.contacts.meet(obstacles)
        self._planned = None

    def meet_reduced(self, surfaces: Sequence[ReducedFacets]) -> None:
        """Let surfaces touch those of reduced bodies as well, after `meet`. Collective.

        Raises:
            SceneError: on all ranks: a contact has a plane's or a load's name.
        """
        self.contacts.meet_reduced(surfaces, size=self.size)

    def renew_limit(self) -> float:
        """Find the longest stable step, s, of the present shape. Collective."""
        if self.mesh.bulk is not None:
            self.mesh.bulk.set_rates(self._went @ self.mesh.R)
        bound = self.contacts.bound(self.x, starts=self._h == 0.0)
        self._limit = self.contacts.limited(self._stable.present(), bound)
        return self._limit

    @property
    def step_at_rest(self) -> float:
        """The longest stable step, s, of the undeformed body without contact."""
        return self._stable.at_rest

    @property
    def ahead(self) -> FloatArray:
        """(owned nodes, 3) m, where nodes are at the end of the step that is planned, or else now."""
        return self.x if self._planned is None else self.x + self._planned

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
        self.inertia.plane.begin(np.asarray(R, dtype=float))
        self.v, self.a, self.force, self.load, self._damped = np.zeros((5, *self.x.shape))
        self._viscous, self._went = np.zeros((2, *self.x.shape))
        self.t, self._R_begun = t, np.array(R, dtype=float)
        self._g = np.array(gravity, dtype=float)
        self._account.begin()
        self._h = 0.0
        self._stable.memory = self._fresh
        if self.loads.any_given_fields:
            self.loads.set_given_fields(self.loads.values(beside(t, 1)))
        if self.loads.any_given_fields or not self.mesh.begins_fresh:
            self.force = self._pull(0.0, frames)
        alone = self._stable.at_rest if self.mesh.begins_fresh else self._stable.present()
        self._planned = None
        self.contacts.begin(self.x, shapes, size=self.size)
        self._limit = self.contacts.limited(alone, self.contacts.shapes.stiffness_bound(self.x))

    @property
    def size(self) -> float:
        """m, the largest coordinate of the undeformed body. Collective."""
        return float(max(self.body.comm.allgather(float(abs(self.mesh.X).max(initial=0.0)))))

    def start(self, h: float) -> None:
        """Forces at the start, before a first step h (s). Collective where there are loads."""
        self.v = self.body.complete_nodes(self.inertia.held(self.v))
        self._h = h
        self.load = self.loads_at(self.t + _BESIDE * h)
        free = self._accelerate(self.v, h, h**2 / 2, answer=1.0)
        self._damped = self.inertia.drag(self.v)
        self._account.lost = self.inertia.square_difference(self.a, free) * h**2 / 8

    def plan(self, h: float, bonded: FloatArray | None = None) -> FloatArray:
        """Find how far (owned nodes, 3) m nodes go in a step h (s); arguments as of `advance`. Collective."""
        if self._h == 0.0:
            self.start(h)
        if self.loads.any:  # which may have jumped since the last step's end
            after = self.loads_at(self.t + _BESIDE * h)
            inertia = self.inertia
            jump = inertia.answered(inertia.held((after - self.load) / inertia.masses[:, None]))
            self.a = self.a + jump / (1.0 + inertia.damping * self._h / 2)
            self.load = after
        move = h * self.v + h**2 / 2 * self.a
        if bonded is not None:
            held = self.inertia.bonded
            move[held] = bonded - self.x[held]
            self.body.complete_nodes(move)
        for pair, side in self.contacts.pairs:
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
        before, on = self._working(), self.contacts.shapes
        touched = None if shapes is None else on.remembered()
        self.x += move
        self._went = np.asarray(move / h)
        if self.loads.any_given_fields:
            self.loads.set_given_fields(self.loads.values(self.t + h - _BESIDE * h))
        self.force = self._pull(h, frames)
        self.t += h
        if self.loads.any:
            self.load = self.loads_at(self.t - _BESIDE * h)
        middle = self.v + h / 2 * self.a
        self._h = h
        if shapes is not None:
            on.place(*shapes)
        self._accelerate(middle, h, h**2, answer=1.0 / (1.0 + self.inertia.damping * h / 2))
        self.v = middle + h / 2 * self.a
        self._damped = self.inertia.drag(self.v)
        self._account.add(move, before, self._working())
        if touched is not None:
            on.walk(self.x)
            self._account.add_touched(on.worked(touched))

    def _working(self) -> tuple[FloatArray, ...]:
        """(owned nodes, 3) N each: the forces whose works `NodalAccount` has."""
        return self.force, self.load, self.contacts.met, self.contacts.rubbed, self._damped, self._viscous

    def _pull(self, h: float, frames: FloatArray | None) -> FloatArray:
        """(owned nodes, 3) N, of the body and of springs on facets, after a step of h (s). Collective."""
        force = self.mesh.pull(self.x, dt=h, frames=frames)
        self._viscous = self.mesh.viscous
        if self.body.springs is not None and self.mesh.fields is None:
            # to the ground, on which a body by itself began
            force -= self.body.springs.of_nodes(self.x - self.mesh.X)
        return self.body.condense_nodes(force)

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
        kinetic = self.inertia.square_difference(self.v, self._h / 2 * self.a) / 2
        weight = -float(self.inertia.weights @ (self.x @ self._g))
        return self._account.energies(kinetic, weight, self.x)

    def internal_work(self) -> float:
        """Work, J, done on the deformation since the start, by the trapezoidal rule over all steps. Collective."""
        return self._account.internal_work()

    @property
    def pushing(self) -> FloatArray:
        """(owned nodes, 3) N, of the body, loads and contacts on its nodes, bonded ones among them. Collective."""
        touched = self.body.condense_nodes(self.contacts.met + self.contacts.rubbed)
        return np.asarray(self.force + self.load + touched)

    def outer_forces(self) -> dict[str, FloatArray]:
        """(3,) N by name, of planes (of one name their sum) and loads on the body at a step's end. Collective."""
        found = self.contacts.resultants()
        if self.loads.any:
            values = self.loads.values(self.t - _BESIDE * self._h)  # those that the last step ended with
            found.update(self.loads.resultants(values, self.x, self._R_begun))
        return found

    def momentum(self, about: FloatArray) -> FloatArray:
        """(6,) linear momentum, N s, and angular momentum about a point (m), N m s. Collective."""
        linear = self.inertia.momenta(self.v)
        return self.mesh.sum(np.append(linear.sum(axis=0), np.cross(self.x - about, linear).sum(axis=0)))

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        nodal = {name: self.memory.gather_nodes(getattr(self, name)) for name in _NODAL}
        own = [self._h, self._limit, *self._stable.memory, self.t]
        axes = np.concatenate([self.mesh.p, self.mesh.R.ravel(), self._g, own, self._R_begun.ravel()])
        sums = {"works": self._account.snapshot(), "axes": axes}
        if self.mesh.fields is not None:
            sums["splitting"] = np.array(self.mesh.fields.lost)
            self.mesh.fields.forget()  # as whoever goes on from here
        return {**nodal, **self.memory.gather(self.body.snapshot()), **sums, **self.contacts.snapshot()}

    def restore(self, memory: dict[str, FloatArray]) -> None:
        """Go back to a snapshot of this body, on any number of ranks. Collective."""
        for name in _NODAL:
            setattr(self, name, self.memory.scatter_nodes(memory[name])[: len(self.masses)])
        self.body.restore(self.memory.scatter(memory))
        self._account.restore(memory["works"])
        axes = np.array(memory["axes"], dtype=float)
        self.mesh.place(axes[:3], axes[3:12].reshape(3, 3))
        self._g = axes[12:15]
        self._h, self._limit = float(axes[15]), float(axes[16])
        self._stable.memory = float(axes[17]), float(axes[18])
        self.t, self._R_begun = float(axes[19]), axes[20:29].reshape(3, 3)
        self.inertia.plane.begin(self._R_begun)
        if self.mesh.fields is not None:
            self.mesh.fields.lost = float(memory["splitting"])
            self.mesh.fields.forget()
        self.contacts.restore(memory, self.x)
        self._planned = None

    def loads_at(self, t: float) -> FloatArray:
        """(owned nodes, 3) N, of the loads at t (s) where the nodes are. Collective where there are loads."""
        if not self.loads.any:
            return np.zeros_like(self.x)
        return self.loads.forces(self.loads.values(t), self.x, self._R_begun)

    def _accelerate(self, v: FloatArray, h: float, reach: float, *, answer: float) -> FloatArray:
        """Set accelerations and contact forces; returns the accelerations without contact.

        Args:
            v: velocities with which the step is made before the accelerations act.
            h: the step.
            reach: what an acceleration adds to the places at its end.
            answer: the accelerations that are left of forces per mass, as these add to damping.
        """
        pull = self.inertia.pulled(self.force + self.load, self._g, v)
        free = answer * pull
        pull = self.contacts.push(self.x, v, pull, h=h, reach=answer * reach)
        self.a = answer * pull
        return free
