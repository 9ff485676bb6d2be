"""The names of the contract: required and optional functions of a form file; here and nowhere else."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

CONSTANTS = ("Parameters", "CELLS", "ORDER", "REFERENCE")
"""Names that are no functions."""

LAYERED = "LAYERED"
"""A constant that a form may have: True where cells lie in layers, with third edges that go straight across."""

REQUIRED = {"element": 3, "kinetic_energy": 2, "rigid_motion": 3, "stress": 3, "reference": 0}
"""Functions that every form file has, and how many positional arguments each takes."""

ENERGIES = ("strain_energy", "residual")
"""Exactly one of these."""

TOGETHER = (("motion", "section_inertia"), ("state", "update"), ("local_unknowns", "local_residual"))
"""Of each group all or none."""

EXPANSIONS = ("thermal_stretch", "thermal_strain")
"""At most one of these."""

OF_HISTORY = ("scaled_yield", "increment_size", "state_names")
"""Those that only forms with a history have."""

KEYWORDS = {
    "local_unknowns": ("z", ("residual", "update", "stress")),
    "point_law": ("z", ("residual", "update", "stress")),
    "cell_mean": ("mean", ("residual", "update", "stress", "local_residual", "energies")),
}
"""What a form that has the first name hands to the others, by keyword."""

STEP = "dt"
"""By this keyword the functions below take the length of the step, s, where stress depends on rates."""

STEP_TAKERS = ("residual", "update", "stress", "local_residual")
"""All of these that a form has, or none."""

Entry: TypeAlias = Callable[..., Any] | None


@dataclass(frozen=True)
class OptionalEntries:
    """Functions that not every form file has; None for those that it has not.

    Attributes:
        strain_energy: (u, p) see `formulation.Formulation`; this or `residual`.
        residual: (u, v, state, p) in place of `strain_energy`, where there is no energy: terms of the virtual work
            of the internal forces, linear in v.
        motion: (u, xi, p) with `section_inertia`, where the mass is not that of a plain displacement (beams, shells,
            solids whose micro-structure turns): displacement, m, (3,), of the material point at the section
            coordinates xi (m), (2,) of a beam, (1,) of a shell, (3,) from the centre of a solid's element of
            structure, linear in u and affine in xi.
        section_inertia: (p) the section's moments, integral of rho {1, xi} {1, xi} dA, (3, 3) or (2, 2); of a solid
            with micro-structure those per volume, (4, 4).
        dissipation: (v, p) Rayleigh's function as terms: half the power, W per unit of the body's measure, that
            viscosity takes where it is quadratic; its derivative by the rates v of the unknown is the viscous force.
            Convex, and zero for rigid motions.
        gyroscopic: (u, v, p) the part of the kinetic energy that is linear in the unknown u and in its rates v, as
            terms: that of rotors that spin inside the body. It has none where either is a translation of the whole.
        surface_energy: (u, p) energy of springs between the body's surface and its body frame, or the ground, J/m^2,
            as terms that are integrated over facets of a solid: a foundation. Zero, without slope and convex at rest.
        surface_kinetic_energy: (v, p) kinetic energy of mass on the surface, J/m^2, as terms over facets: m/2 v.v with
            one mass per area m in all directions. Which facets: `surfaces` of a model.
        gauge: (p) shifts of a field that cost no energy, by name, as {"potential": (0.0, 0.0, 0.0, 1.0)}: the numbers
            by which one unit (1 V) shifts the components of the unknown, the same everywhere. Of p the values are
            given and no symbols. See `gauge`.
        state: (p) with `update`: the history at a quadrature point at rest, (n,). Where the stress depends on rates
            residual, update, stress and local_residual take the length of the step as the keyword `dt`, s, at least
            0: at 0 no time passes, and nothing flows or relaxes.
        update: (u, state, p) the history after a step, (n,).
        local_unknowns: (p) with `local_residual`: initial values of the unknowns at a quadrature point; None:
            these parameters have none. Any number, () or (n,), dimensionless and of the size of strains. residual,
            update and stress then take the solution as `z`, which follows u: its derivative is that of the exact
            one, by the theorem on implicit functions.
        local_residual: (z, u, state, p) the equations, of the same shape.
        point_law: (p) in place of local unknowns: a compiled law (`point_law.PointLaw`), whose results at a
            quadrature point residual, update and stress take as `z`; made by `laws.law_form`.
        cell_mean: (u, state, p) a scalar whose mean over a cell residual, update, stress and energies take as
            `mean`, None for the plain form.
        energies: (u, state, p) dictionary of terms by name, for accounts: "elastic", "plastic".
        scaled_yield: (p, factor) parameters whose yield limits are `factor` times as high, and nothing else is
            different; a history that never yields gives p. Asked for where a body that has yielded is linearised.
        increment_size: (u, state, p) a scalar: the size of the step from the accepted history to u over the largest
            that the update is accurate for. Beyond 1 slow loading and implicit steps take smaller ones.
        thermal_stretch: (p, dT) the stretch (3, 3) of free expansion by a rise of temperature dT (K), the identity at
            dT = 0: F = F_e F_th. Of forms whose rotations are finite; or
        thermal_strain: (p, dT) its small strain (3, 3), zero at dT = 0, which is subtracted from the gradient of the
            displacement. Of forms that are linear in it below yield.
        state_names: (p) dictionary of the number of components of each part of the history by its name, in their
            order, as {"plastic_strain_tensor": 6, "plastic_strain": 1}: what series and pictures ask for.
        thickness: (p) m, of plane bodies alone, whose displacement has values in the plane of their flat mesh and which
            move in it; made by `laws.plane_form`.
    """

    strain_energy: Entry = field(default=None, metadata={"arguments": 2})
    residual: Entry = field(default=None, metadata={"arguments": 4})
    motion: Entry = field(default=None, metadata={"arguments": 3})
    section_inertia: Entry = field(default=None, metadata={"arguments": 1})
    dissipation: Entry = field(default=None, metadata={"arguments": 2})
    gyroscopic: Entry = field(default=None, metadata={"arguments": 3})
    surface_energy: Entry = field(default=None, metadata={"arguments": 2})
    surface_kinetic_energy: Entry = field(default=None, metadata={"arguments": 2})
    gauge: Entry = field(default=None, metadata={"arguments": 1})
    state: Entry = field(default=None, metadata={"arguments": 1})
    update: Entry = field(default=None, metadata={"arguments": 3})
    local_unknowns: Entry = field(default=None, metadata={"arguments": 1})
    local_residual: Entry = field(default=None, metadata={"arguments": 4})
    point_law: Entry = field(default=None, metadata={"arguments": 1})
    cell_mean: Entry = field(default=None, metadata={"arguments": 3})
    energies: Entry = field(default=None, metadata={"arguments": 3})
    scaled_yield: Entry = field(default=None, metadata={"arguments": 2})
    increment_size: Entry = field(default=None, metadata={"arguments": 3})
    state_names: Entry = field(default=None, metadata={"arguments": 1})
    thermal_stretch: Entry = field(default=None, metadata={"arguments": 2})
    thermal_strain: Entry = field(default=None, metadata={"arguments": 2})
    thickness: Entry = field(default=None, metadata={"arguments": 1})


ON_FACETS = ("surface_energy", "surface_kinetic_energy")
"""Those that are integrated over facets."""

OPTIONAL: dict[str, int] = {item.name: item.metadata["arguments"] for item in fields(OptionalEntries)}
"""The same by name, and how many positional arguments each takes."""


def has_facet_terms(form: Any) -> bool:
    """Whether a form has terms on facets; not collective."""
    return any(getattr(optional_entries(form), name) is not None for name in ON_FACETS)


def is_layered(form: Any) -> bool:
    """Whether the third edges of a form's hexahedra must lie across layers of cells; not collective."""
    return bool(getattr(form, LAYERED, False))


def is_rate_dependent(form: Any) -> bool:
    """Whether a form takes the length of the step; not collective."""
    return any(takes_step(getattr(form, name, None)) for name in STEP_TAKERS)


def takes_step(function: Entry) -> bool:
    """Whether a function names the length of the step among its arguments."""
    try:
        return function is not None and STEP in inspect.signature(function).parameters
    except (TypeError, ValueError):  # no function, or one of C without a signature
        return False


def optional_entries(form: Any) -> OptionalEntries:
    """The optional functions of a form file; not collective."""
    return OptionalEntries(**{name: getattr(form, name, None) for name in OPTIONAL})
