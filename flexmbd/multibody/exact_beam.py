"""Geometrically exact beams that move: rigid sections joined by elements that measure strains of any size exactly.

A section hangs on its neighbour by six joint coordinates, so that a beam is a branch of the machine's tree: every
integrator and every joint takes it, and forward dynamics, Radau IIA and generalized-alpha cost O(elements).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.beams.castigliano import Section, check_section
from flexmbd.beams.exact_elements import ElementAtRest, elements_at_rest, node_weights, section_spread, strained
from flexmbd.beams.frame_mesh import Beam, FrameMesh, Point, mesh_frame
from flexmbd.beams.pose_logarithm import pose_logarithm
from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number
from flexmbd.multibody.bodies.body import Frame, RigidBody, refuse_change
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.beam_strain import BeamStrain, StrainTable, strain_table
from flexmbd.multibody.force.frame_force import Axes, FrameForce
from flexmbd.multibody.force.protocol import Force, vector
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.overflow import looked_at

FloatArray = NDArray[np.float64]


@checked("points", "beams", "sections", "rotary_inertia", "name")
@dataclass(eq=False, repr=False)
class ExactBeam:
    """Beams that bend, twist, shear and stretch by any amount: Simo's and Reissner's, one or a frame of many.

    ``scene.add(beam)`` puts a rigid body for each section into the scene, called "name.node", with its joints and
    elements.  Before anything moves it lies along the axes of the frame that it hangs on: ``beam.frame("a")`` has the
    axes that the points are given in.

    An element's strains are constant, the elastic energy is that of the logarithm of one section's pose in the other
    (Sonneville, Cardona & Bruels 2014), with the stiffness of the exact solution of the element, straight or curved,
    under loads at its ends (Castigliano; Anthonis & Ramon 2003, eq. 16-21): it does not lock, however thin the beam.
    Errors fall with the square of an element's length, in a plane with its fourth power.  Turns between
    neighbouring sections stay below half a revolution.

    Attributes:
        points: by name, (3,) m.
        beams: by group, the beams between points, straight or arcs (`flexmbd.beams.frame_mesh`).
        sections: by group; `flexmbd.forms.beam_timoshenko.Parameters` or an object with the same attributes.  With
            infinite shear factors ky and kz sections stay normal to the axis (Kirchhoff's beam).
        divisions: elements a beam; one number, or one by group.
        viscosity: s, Kelvin and Voigt's: stresses E eps + E viscosity eps', one number or one by group.
        rotary_inertia: (rho Iy, rho Iz), kg m, by group, instead of rho times the sections' Iy and Iz.
        strain: by group, that at which beams are slack, beside their shape: (6,) or one for each element (n, 6);
            stretch and shears along y and z (1), twist and curvatures about y and z (rad/m), in the section's axes.
            Each is a number or a function of time with its rate, as a prescribed motion of a joint.
        name: given by ``System.add``.

    Raises:
        MeshError: the points and beams are no frame.
        SceneError: sections that are none or do not fit the groups; viscosities or inertias that are negative; strains
            that are no numbers, or turn an element by half a revolution.
    """

    points: Mapping[str, Point]
    beams: Mapping[str, Sequence[Beam]]
    sections: Mapping[str, Section]
    divisions: int | Mapping[str, int]
    viscosity: float | Mapping[str, float] = field(default=0.0, kw_only=True)
    rotary_inertia: Mapping[str, tuple[float, float]] = field(default_factory=dict, kw_only=True)
    strain: Mapping[str, ArrayLike | Sequence[TimeFunction] | Sequence[Sequence[TimeFunction]]] = field(
        default_factory=dict, kw_only=True
    )
    name: str = field(default="", kw_only=True)

    def __setattr__(self, name: str, value: object) -> None:
        refuse_change(self, name, ("points", "beams", "sections", "divisions", "viscosity", "rotary_inertia", "strain"))
        super().__setattr__(name, value)

    def __post_init__(self) -> None:
        groups = self.mesh.groups
        if set(self.sections) != set(groups):
            raise SceneError(
                f"sections are given for {', '.join(map(repr, self.sections)) or 'no group'}; give one for each group "
                f"of beams: {', '.join(map(repr, groups))}"
            )
        for name, section in self.sections.items():
            check_section(section, name)
        for name in groups:
            value = self._viscosity(name)
            if not (is_number(value) and value >= 0.0):
                raise SceneError(f"viscosity of {name!r} must be a number of seconds, not negative, got {value!r}")
        if isinstance(self.viscosity, Mapping) and (unknown := sorted(set(self.viscosity) - set(groups))):
            raise SceneError(f"viscosity of {unknown[0]!r}: the groups are {', '.join(map(repr, groups))}")
        for name, pair in self.rotary_inertia.items():
            if name not in groups:
                raise SceneError(f"rotary_inertia of {name!r}: the groups are {', '.join(map(repr, groups))}")
            if np.shape(pair) != (2,) or not all(is_number(one) and one > 0.0 for one in pair):
                raise SceneError(f"rotary_inertia of {name!r} must be two positive numbers, kg m, got {pair!r}")
        for name in self.strain:
            if name not in groups:
                raise SceneError(f"strain of {name!r}: the groups are {', '.join(map(repr, groups))}")
        _ = self.elements  # refuses orientations along beams, and strains

    def __repr__(self) -> str:
        """Its name and how much of it there is."""
        return f"<ExactBeam {self.name!r}: {len(self.elements)} elements, {self.mass:.4g} kg>"

    @cached_property
    def mesh(self) -> FrameMesh:
        """Nodes and elements."""
        return mesh_frame(self.points, self.beams, divisions=self.divisions)

    @cached_property
    def elements(self) -> tuple[ElementAtRest, ...]:
        """The elements between the sections, in the order of ``mesh.elements``."""
        plain = elements_at_rest(self.mesh, self.sections)
        names = [self.mesh.groups[one.group] for one in plain]
        each = zip(plain, self._given.fixed, names, strict=True)
        return tuple(strained(one, own, name) if own.any() else one for one, own, name in each)

    @cached_property
    def _given(self) -> StrainTable:
        return strain_table(self.strain, [self.mesh.groups[group] for group in self.mesh.group])

    @cached_property
    def parts(self) -> tuple[RigidBody, ...]:
        """The sections, one a node."""
        return tuple(self._part(carried) for carried in self._carried)

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return sum(part.mass for part in self.parts)

    def frame(self, place: str | ArrayLike) -> Frame:
        """The frame on the section at a node, along the axes of ``points`` at rest.

        Args:
            place: the node's name ("tip", or "arms 1.2" of the second node inside the first beam of a group), or where
                it is at rest, (3,) m.

        Raises:
            SceneError: there is no node there; the message names the nearest one.
        """
        row = self.mesh.node(place)
        return Frame(self.parts[row], np.zeros(3), np.eye(3), None, f"{self.name or 'beam'}.{self.mesh.names[row]}")

    def neighbours(self) -> list[tuple[Frame, Frame, tuple[float, ...]]]:
        """By which neighbour each section but the first is carried: both frames, place (m) and quaternion at rest.

        Along the elements from the first point on; rings are cut where both ways meet, and need no joint there.
        """
        beside: dict[int, list[int]] = {}
        for one in self.elements:
            beside.setdefault(one.start, []).append(one.end)
            beside.setdefault(one.end, []).append(one.start)
        found, reached, waiting = [], {0}, deque([0])
        while waiting:
            here = waiting.popleft()
            for there in beside[here]:
                if there not in reached:
                    reached.add(there)
                    waiting.append(there)
                    away = tuple(map(float, self.mesh.x[there] - self.mesh.x[here]))
                    found.append((self._at(here), self._at(there), (*away, 1.0, 0.0, 0.0, 0.0)))
        return found

    @cached_property
    def bonds(self) -> tuple[BeamElement, ...]:
        """The elements between the sections, in the order of ``mesh.elements``."""
        extent = float(np.linalg.norm(self.mesh.x - self.mesh.x[0], axis=1).max())
        return tuple(
            BeamElement(
                self._at(one.start, one.R_start),
                self._at(one.end, one.R_end),
                one.stiffness,
                one.rest,
                self._viscosity(self.mesh.groups[one.group]) * one.stiffness,
                extent=extent,
            )
            for one in self.elements
        )

    def forces(self) -> list[Force]:
        """The elements, and their forces by strains that are functions of time."""
        strains = [
            BeamStrain(
                [self.bonds[row] for row in one.rows],
                [self.elements[row].length for row in one.rows],
                one.component,
                one.function,
                f"strain {one.component} of {one.group!r} of beam {self.name!r}",
            )
            for one in self._given.moving
        ]
        return [*self.bonds, *strains]

    @checked("group", "axes")
    def line_load(self, group: str, force: ArrayLike, *, axes: Axes = Axes.WORLD) -> list[FrameForce]:
        """Forces on the sections of a group that stand for a load along its beams, for ``scene.add_force`` each.

        Args:
            group: of beams.
            force: (3,) N/m, numbers, of initial length.
            axes: inertial ones, or those of the sections, which the load then follows.

        Raises:
            SceneError: no such group, or components that are not numbers.
        """
        if group not in self.mesh.groups:
            raise SceneError(f"no group {group!r}; the groups are: {', '.join(map(repr, self.mesh.groups))}")
        per_length = vector(force, (3,), f"line load on {group!r}, N/m,")
        number = self.mesh.groups.index(group)
        loads = []
        for row, carried in enumerate(self._carried):
            length = sum(weight for one, weight in carried if one.group == number)
            if length > 0.0:
                loads.append(FrameForce(self._at(row), tuple(map(float, length * per_length)), axes=axes))
        return loads

    def resultants(self, p: FloatArray, R: FloatArray, given: FloatArray) -> FloatArray:
        """(k, elements, 6) N, N m: normal and shear forces, twisting and bending moments in each element's middle.

        Of the elastic strains, along and about the section's tangent, y and z there; for ``Trajectory.resultants``.

        Args:
            p: (k, nodes, 3) m, places of the sections in inertial axes.
            R: (k, nodes, 3, 3) their axes.
            given: (k, elements, 6) m and rad, where elements are slack beside their rest.
        """
        found = []
        for k, one in enumerate(self.elements):
            first = R[:, one.start] @ one.R_start
            d = np.einsum("kji,kj->ki", first, p[:, one.end] - p[:, one.start])
            turn = first.swapaxes(1, 2) @ (R[:, one.end] @ one.R_end)
            found.append((pose_logarithm(d, turn) - one.rest - given[:, k]) @ one.stiffness)
        return np.stack(found, axis=1)

    def _at(self, row: int, R: FloatArray | None = None) -> Frame:
        label = f"{self.name or 'beam'}.{self.mesh.names[row]}"
        return Frame(self.parts[row], np.zeros(3), np.eye(3) if R is None else R, None, label)

    def _viscosity(self, group: str) -> float:
        return self.viscosity.get(group, 0.0) if isinstance(self.viscosity, Mapping) else self.viscosity

    @cached_property
    def _carried(self) -> list[list[tuple[ElementAtRest, float]]]:
        return node_weights(self.elements, self.mesh.points, len(self.mesh.x))

    @looked_at()
    def _part(self, carried: Sequence[tuple[ElementAtRest, float]]) -> RigidBody:
        mass, second = 0.0, np.zeros((3, 3))
        for one, length in carried:
            group = self.mesh.groups[one.group]
            section = self.sections[group]
            mass += length * section.rho * section.A
            spread = section.rho * section_spread(section)
            if group in self.rotary_inertia:
                spread = np.diag(np.asarray(self.rotary_inertia[group], dtype=np.float64)[::-1])
            across = one.R_end[:, 1:]
            second += length * across @ spread @ across.T
        return RigidBody(mass, np.trace(second) * np.eye(3) - second)
