"""The contract's conditions on a form on a mesh, each as a function from a trial to figures.

A figure is relative, so that it means the same in all units: forces, for one, are compared with
those of displacements of the same size that are no rigid motion.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import ufl

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.expansion import free_expansion
from flexmbd.continuum.contract_suite.fields import SMALL_STRAIN, free_constants, has_uniform_mass, sees_small_strain
from flexmbd.continuum.contract_suite.measures import (
    difference,
    elastic_force,
    largest,
    ratio,
)
from flexmbd.continuum.contract_suite.order import observed_order
from flexmbd.continuum.contract_suite.outcome import Check, Figure, Outcome, Remark, Verdict
from flexmbd.continuum.contract_suite.patch import patch_test, stress_work
from flexmbd.continuum.contract_suite.trial import FloatArray, Trial, equilibration


def rest(trial: Trial) -> Outcome:
    """Value and derivatives at u = 0 are finite, and there is no force."""
    zero, u = trial.rest(), trial.some(1)
    values = {
        "force": trial.force(zero),
        "tangent": trial.stiffness(zero),
        "derivative of the tangent": trial.geometric_force(zero, u, trial.some(2)),
        "mass": trial.mass,
    }
    if trial.has_energy:
        values["energy"] = trial.energies(zero)
    broken = [name for name, value in values.items() if not np.isfinite(value).all()]
    if broken:
        return Remark(Verdict.FAIL, f"not finite at u = 0: {', '.join(broken)}")
    force = ratio(largest(trial.scale * values["force"]), elastic_force(trial, u))
    return [Figure("force at u = 0", force, EXACT)]


def rigid_motions(trial: Trial) -> Outcome:
    """The six rigid motions, and nothing else, cost no energy."""
    d = trial.scale
    scaled = d[:, None] * trial.stiffness(trial.rest()) * d
    columns = trial.rigid / d[:, None]
    force = scaled @ (columns / abs(columns).max(axis=0))
    values = abs(np.linalg.eigvalsh((scaled + scaled.T) / 2))
    free = int(np.count_nonzero(values < EXACT * values.max()))
    constants = free_constants(trial, scaled)
    remark = f"{free} in all"
    if constants:
        remark += f", {constants} of them a constant of a further unknown, which something else must hold"
    return [
        Figure("force of a rigid motion", ratio(largest(force), largest(scaled)), EXACT),
        Figure("motions without energy besides six:", float(abs(free - constants - 6)), 0.0, remark),
    ]


def translational_mass(trial: Trial) -> Outcome:
    """A translation carries the integral of the density, in every direction."""
    translations = trial.rigid[:, :3]
    found = translations.T @ trial.mass @ translations
    # a finer rule tells the integral from what the form's own rule makes of it
    exact = 2 * np.mean([trial.kinetic_energies(v, finer=True).sum() for v in translations.T])
    off = ratio(largest(found - exact * np.eye(3)), exact)
    figures = [Figure("off the integral by", off, EXACT)]
    rho = getattr(trial.form.reference().parameters, "rho", None)
    if trial.dim == 3 and isinstance(rho, float) and has_uniform_mass(trial):
        figures.append(Figure("off rho V by", abs(exact / (rho * trial.volume) - 1), EXACT))
    if optional_entries(trial.form).section_inertia is not None:
        figures.append(Figure("rigid body's off that of the sections by", _off_sections(trial), 1e-8))
    return figures


def _off_sections(trial: Trial) -> float:
    """How far the mass matrix of rigid motions is from the one of `motion` and `section_inertia`."""
    form, p, u = trial.form, trial.parameters, trial.u
    inertia = ufl.as_matrix(form.section_inertia(p))  # type: ignore[attr-defined]
    m = inertia.ufl_shape[0]
    at = [form.motion(u, ufl.as_vector(xi.tolist()), p) for xi in np.vstack([np.zeros(m - 1), np.eye(m - 1)])]  # type: ignore[attr-defined]
    parts = [at[0], *(moved - at[0] for moved in at[1:])]
    density = sum(
        inertia[i, j] / 2 * ufl.inner(parts[i], parts[j]) for i in range(m) for j in range(m)
    )
    energy = trial.scalar_of(density, degree=2 * trial.degree + 4)
    r = trial.rigid
    # the matrix of a quadratic form, from its values
    pairs = [(i, j) for i in range(6) for j in range(i + 1)]
    exact = np.array([energy(r[:, i] + r[:, j]) - energy(r[:, i] - r[:, j]) for i, j in pairs]) / 2
    found = np.array([r[:, i] @ trial.mass @ r[:, j] for i, j in pairs])
    return ratio(largest(found - exact), largest(exact))


def positive_mass(trial: Trial) -> Outcome:
    """Every displacement has kinetic energy, and no velocity a negative one."""
    dofs = trial.displacement.reshape(-1)
    own = np.linalg.eigvalsh(trial.mass[np.ix_(dofs, dofs)])
    d = equilibration(trial.mass)
    whole = np.linalg.eigvalsh(d[:, None] * trial.mass * d)
    return [
        Figure("displacements without mass:", float(np.count_nonzero(own < 1e-9 * own[-1])), 0.0),
        Figure("lowest eigenvalue below zero by", max(ratio(-whole[0], whole[-1]), 0.0), EXACT),
    ]


def symmetry(trial: Trial) -> Outcome:
    """Tangents at rest and at a displacement, and the mass, are symmetric.

    Of a law in rates, which refers to the updated configuration, at rest alone: even where elastic it has no potential.
    """
    d, rates = trial.scale, trial.form.REFERENCE == "UPDATED" and not trial.has_energy
    figures = []
    for name, at in (("at rest", trial.rest()), ("displaced", trial.some(1))):
        tangent = d[:, None] * trial.stiffness(at) * d
        off = ratio(largest(tangent - tangent.T), largest(tangent))
        free = rates and name == "displaced"
        remark = " (a law in rates has no potential)" if free and off > EXACT else ""
        figures.append(Figure(f"{name}, off by", off, np.inf if free else EXACT, remark))
    mass = trial.mass
    return [*figures, Figure("mass, off by", ratio(largest(mass - mass.T), largest(mass)), EXACT)]


def tangent(trial: Trial) -> Outcome:
    """Forces are differences of the energy, tangents of the force, each term by itself."""
    at, step, d = trial.some(1), trial.some(2), trial.scale
    forces = trial.forces(at)
    figures = []
    if trial.has_energy:
        slopes = difference(trial.energies, at, step)
        # against what the force could do at most: its work on one step may vanish
        sizes = [np.linalg.norm(d * force) * np.linalg.norm(step / d) for force in forces]
        off = [
            ratio(abs(force @ step - slope), size)
            for force, slope, size in zip(forces, slopes, sizes, strict=True)
        ]
        figures.append(Figure("force off the energy's difference by", max(off), 1e-8))
    changes = difference(lambda u: np.array(trial.forces(u)), at, step)
    off = [
        ratio(largest(d * (matrix @ step - change)), largest(d * change))
        for matrix, change in zip(trial.stiffnesses(at), changes, strict=True)
    ]
    return [*figures, Figure("tangent off the force's difference by", max(off), 1e-7)]


def residual(trial: Trial) -> Outcome:
    """A(u) u summed along a path is the force at its end, each term by itself; so the energy.

    Eight Gauss points are exact to degree fifteen. A rule that differs between the matrix and the
    vector of a term, as with two rules in one form, shows here.
    """
    end, zero, d = trial.some(1), trial.rest(), trial.scale
    start = trial.forces(zero)
    sums = [np.zeros(trial.size) for _ in start]
    work = np.zeros(len(start))
    points, weights = np.polynomial.legendre.leggauss(8)
    for s, w in zip((points + 1) / 2, weights / 2, strict=True):
        for total, matrix in zip(sums, trial.stiffnesses(s * end), strict=True):
            total += w * (matrix @ end)
        work += w * np.array([force @ end for force in trial.forces(s * end)])
    off = [
        ratio(largest(d * (total - force + first)), largest(d * force))
        for total, force, first in zip(sums, trial.forces(end), start, strict=True)
    ]
    figures = [Figure("a term's force off by", max(off), 1e-8)]
    if trial.has_energy:
        energies = trial.energies(end) - trial.energies(zero)
        figures += [
            Figure("a term's energy off by", ratio(largest(work - energies), largest(energies)), 1e-8),
            Figure("their sum by", ratio(abs(work.sum() - energies.sum()), largest(energies)), 1e-8),
        ]
    halves = np.array([end @ (mass @ end) / 2 for mass in trial.masses()])
    kinetic = largest(trial.kinetic_energies(end) - halves)
    return [*figures, Figure("kinetic energy off v M v / 2 by", ratio(kinetic, largest(halves)), 1e-8)]


def viscous_forces(trial: Trial) -> Outcome:
    """Viscous forces are differences of Rayleigh's function, none of a rigid motion, and take power in any motion."""
    if not trial.has_dissipation:
        return Remark(Verdict.SKIP, "the form has no dissipation")
    d, rates, step = trial.scale, trial.some(1), trial.some(2)
    slopes = difference(trial.dissipations, rates, step)
    forces = trial.viscous_forces(rates)
    off = [
        ratio(abs(force @ step - slope), np.linalg.norm(d * force) * np.linalg.norm(step / d))
        for force, slope in zip(forces, slopes, strict=True)
    ]
    matrix = d[:, None] * trial.damping(trial.rest()) * d
    columns = trial.rigid / d[:, None]
    rigid = matrix @ (columns / abs(columns).max(axis=0))
    changes = difference(lambda v: np.sum(trial.viscous_forces(v), axis=0), rates, step)
    tangent_off = ratio(largest(d * (trial.damping(rates) @ step - changes)), largest(d * changes))
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    return [
        Figure("force of a rigid motion", ratio(largest(rigid), largest(matrix)), EXACT),
        Figure("lowest eigenvalue below zero by", max(ratio(-values[0], values[-1]), 0.0), EXACT),
        Figure("force off the function's difference by", max(off), 1e-8),
        Figure("damping off the force's difference by", tangent_off, 1e-7),
    ]


def gyroscopic_forces(trial: Trial) -> Outcome:
    """The kinetic energy linear in the rates is linear in both of its fields, and does not know translations."""
    if not trial.has_gyroscopic:
        return Remark(Verdict.SKIP, "the form has no kinetic energy linear in the rates")
    energy, u, v, w = trial.gyroscopic_energy, trial.some(1), trial.some(2), trial.some(3)
    size = abs(energy(u, w)) + abs(energy(v, w))
    sums = [
        energy(u + 2.0 * v, w) - energy(u, w) - 2.0 * energy(v, w),
        energy(w, u + 2.0 * v) - energy(w, u) - 2.0 * energy(w, v),
    ]
    moved = [t * largest(u) for t in trial.rigid[:, :3].T]
    pushed = [energy(u, t) - energy(t, u) for t in moved]
    return [
        Figure("a sum of fields off by", ratio(largest(np.array(sums)), size), EXACT),
        Figure("force of a translation", ratio(largest(np.array(pushed)), size), EXACT),
    ]


def terms_on_facets(trial: Trial) -> Outcome:
    """Forces of springs are differences of their energy and hold the body to its place; mass is that of an area.

    Over the whole surface of the mesh, whatever facets a user will name.
    """
    figures: list[Figure] = []
    d, at, step = trial.scale, trial.some(1), trial.some(2)
    if trial.has_surface_energy:
        slope = difference(lambda u: trial.surface_energies(u).sum(), at, step)
        force, matrix = trial.surface_forces(at), trial.surface_stiffness(at)
        off = ratio(abs(force @ step - slope), np.linalg.norm(d * force) * np.linalg.norm(step / d))
        change = difference(trial.surface_forces, at, step)
        tangent_off = ratio(largest(d * (matrix @ step - change)), largest(d * change))
        moved = np.flatnonzero(trial.layout.kinematic)
        rest = (d[:, None] * trial.surface_stiffness(trial.rest()) * d)[np.ix_(moved, moved)]
        values = np.linalg.eigvalsh((rest + rest.T) / 2)
        at_rest = ratio(largest(d * trial.surface_forces(trial.rest())), largest(d * force))
        figures += [
            Figure("springs' force at rest", at_rest, EXACT),
            Figure("force off the energy's difference by", float(off), 1e-8),
            Figure("stiffness off the force's difference by", tangent_off, 1e-7),
            Figure("lowest eigenvalue below zero by", max(ratio(-values[0], values[-1]), 0.0), EXACT),
        ]
    if trial.has_surface_mass:
        translations = trial.rigid[:, :3]
        found = translations.T @ trial.surface_mass @ translations
        energies = [trial.surface_kinetic_energies(v).sum() for v in translations.T]
        off = ratio(largest(found - 2 * np.mean(energies) * np.eye(3)), 2 * float(np.mean(energies)))
        figures.append(Figure("mass off the same along all axes by", off, EXACT))
    return figures or Remark(Verdict.SKIP, "the form has no terms on facets")


def frame_indifference(trial: Trial) -> Outcome:
    """A finite rotation on top of any displacement turns the forces and changes no energy."""
    if trial.dim < 3:
        return Remark(Verdict.SKIP, "for solids: how the rotations of a beam or shell add up is its own affair")
    if sees_small_strain(trial):
        return Remark(Verdict.SKIP, SMALL_STRAIN)
    rotation = scipy.linalg.expm(np.cross(np.eye(3), [0.9, -0.5, 0.7]))
    dofs, x, d = trial.displacement, trial.layout.node_x, trial.scale

    def turned(u: FloatArray) -> FloatArray:
        result = u.copy()
        result[dofs] = (x + u[dofs]) @ rotation.T - x
        return result

    u = trial.some(1)
    if any(field.space.value_shape for field in trial.layout.fields[1:]):
        # of other vectors and tensors only the form knows how they turn
        u[np.setdiff1d(np.arange(trial.size), dofs)] = 0.0
    force = trial.force(u)
    expected = force.copy()
    expected[dofs] = force[dofs] @ rotation.T
    off, alone = trial.force(turned(u)) - expected, trial.force(turned(trial.rest()))
    figures = [
        Figure("turned forces off by", ratio(largest(d * off), largest(d * force)), 1e-9),
        Figure("force of a rotation alone", ratio(largest(d * alone), largest(d * force)), 1e-9),
    ]
    if trial.has_energy:
        energy, after = trial.energies(u).sum(), trial.energies(turned(u)).sum()
        figures.append(Figure("energy changed by", ratio(abs(after - energy), abs(energy)), 1e-9))
    return figures


def stiffening(trial: Trial) -> Outcome:
    """The third derivative at rest, from which the geometric stiffness follows, is there."""
    along, other = trial.some(1), trial.some(2)
    change = trial.geometric_force(trial.rest(), along, other)
    size = ratio(largest(trial.scale * change), elastic_force(trial, other))
    if size < 1e-12:
        return Remark(
            Verdict.NOTE,
            "no geometric stiffening: the energy's third derivative is zero, so a load does not change "
            "the stiffness; a body that spins fast needs an energy of finite strain",
        )
    return [Figure("forces of a displacement, changed by others of 2 cm, by", size, float("inf"))]


CHECKS = (
    Check(
        "finite at rest",
        rest,
        "every computation begins at u = 0: use another expression where a root, a quotient or a logarithm has no "
        "value or derivative there; a body with a force at rest has no place here",
    ),
    Check(
        "rigid motions cost no energy",
        rigid_motions,
        "a force: the energy must depend on strains alone, and rigid_motion be a motion without strain; "
        "more free motions than six: a rule with more points; fewer: a rule with less, or another element",
    ),
    Check(
        "translational mass",
        translational_mass,
        "kinetic_energy is rho/2 v.v in all three directions, by a rule that is exact; section_inertia and motion "
        "must be those of the kinetic energy",
    ),
    Check(
        "positive mass",
        positive_mass,
        'a rule with more points for the mass, and not "vertex" on cells of degree 2',
    ),
    Check(
        "symmetry",
        symmetry,
        "only the second derivative of an energy is symmetric: give strain_energy in place of residual",
    ),
    Check(
        "patch test, distorted mesh",
        patch_test,
        "on cells of any shape the element must hold constant strains, the rule integrate them, and no size of a "
        "cell enter the energy",
    ),
    Check(
        "stress does the energy's work",
        stress_work,
        "stress must be the derivative of strain_energy by the strain, at small strain",
    ),
    Check(
        "tangent against differences",
        tangent,
        "the energy has jumps; forces and tangents are its derivatives only where it is smooth",
    ),
    Check(
        "A(u) u against the residual",
        residual,
        "the energy has kinks or jumps on the way from rest to a displacement of 2 cm in cells of half a metre",
    ),
    Check(
        "observed order",
        observed_order,
        "claim less in ORDER; or the element locks: integrate what locks by a lower rule in a term of its own, or "
        "make it an unknown; or body_force is not that of the displacement in reference()",
    ),
    Check(
        "viscous forces",
        viscous_forces,
        "dissipation(v, p) must be a convex function of rates of strain, smooth, and zero where nothing moves",
    ),
    Check(
        "gyroscopic forces",
        gyroscopic_forces,
        "gyroscopic(u, v, p) must be linear in u and in v, and written in rotations, of which translations have none",
    ),
    Check(
        "terms on facets",
        terms_on_facets,
        "surface_energy(u, p) must be smooth, convex at rest and without force there; surface_kinetic_energy(v, p) m/2 "
        "v.v by a rule with enough points",
    ),
    Check(
        "frame indifference",
        frame_indifference,
        "write the energy in F^T F, F = I + grad u; or keep it linear in u throughout, for small rotations",
    ),
    Check(
        "geometric stiffness",
        stiffening,
        "the third derivative of the energy at rest must be finite",
    ),
    Check(
        "free expansion",
        free_expansion,
        "energies, stress, update and equations of points must see u by its gradient alone, and thermal_strain(p, dT) "
        "belongs to forms that are linear in it below yield, thermal_stretch(p, dT) to others",
    ),
)
"""In the order in which a sheet lists them."""
