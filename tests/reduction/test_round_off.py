"""Thin, slender and nearly incompressible parts: as exact as double precision lets them be, and refused only beyond."""

import dataclasses
import types

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
import ufl
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ReductionError
from flexmbd.forms import solid_linear, solid_nearly_incompressible
from flexmbd.reduction import Solver, craig_bampton, guyan

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7800.0)


def plate(thickness, names, *, unit=1.0, shift=0.0):
    """A square of 1 m, lengths by a unit of length (m); of steel in the units that belong to it."""
    mesh = meshes.block(unit, unit, unit * thickness, divisions=(6, 6, 1), degree=1, comm=MPI.COMM_SELF)
    mesh.mesh.geometry.x[:] += shift
    steel = dataclasses.replace(STEEL, E=STEEL.E / unit, rho=STEEL.rho / unit**3)
    return ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[Interface(name) for name in names])


def by_scipy(model, count, *, held=None):
    """The lowest frequencies, Hz, of a body with a facet group held or of a free one."""
    k, m = (scipy.sparse.csc_array(gather(one)) for one in (model.K, model.M))
    free = np.ones(k.shape[0], dtype=bool)
    if held is not None:
        free[model.interface(held).dofs] = False
    size = k.diagonal().max() / m.diagonal().max()
    values = scipy.sparse.linalg.eigsh(
        k[free][:, free], count + (6 if held is None else 0), m[free][:, free], sigma=-1e-10 * size
    )[0]
    return np.sqrt(np.sort(values)[-count:]) / (2.0 * np.pi)


@pytest.mark.parametrize("names", [(), ("x_min",), ("x_min", "x_max")], ids=["free", "held", "two ends"])
@pytest.mark.parametrize("thickness", [0.01, 0.005, 0.002])
def test_thin_plates(thickness, names):
    """As thick ones, by Kirchhoff's law of the thickness; refused in part until bounds went with the conditioning."""
    thick, thin = (
        craig_bampton(plate(t, names), modes=8, frame=names[0] if names else None).frequencies()[:3]
        for t in (0.02, thickness)
    )
    # what is left is shear, which falls with the square of the thickness
    assert thin / thickness == pytest.approx(thick / 0.02, rel=0.015)


def test_free_plates_against_scipy():
    for thickness, within in ((0.01, 1e-6), (0.005, 1e-5)):
        model = plate(thickness, ())
        body = craig_bampton(model, modes=8, frame=None)
        assert body.frequencies()[:6] == pytest.approx(by_scipy(model, 6), rel=within)
        assert float(body.provenance["orthonormality error"]) < 10 * within


@pytest.mark.parametrize("how", [{"unit": 1e3}, {"shift": 1e3}], ids=["mm", "far from zero"])
def test_whatever_the_units_and_the_origin(how):
    exact = craig_bampton(plate(0.005, ("x_min",)), modes=4, frame="x_min").frequencies()[:4]
    found = craig_bampton(plate(0.005, ("x_min",), **how), modes=4, frame="x_min").frequencies()[:4]
    # 1 km away a coordinate is known to 1e-13 m, 2e-11 of the thickness
    assert found == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("slenderness", [200, 500])
def test_slender_bars(slenderness):
    """Euler's free-free beam: 22.3733 and 61.6728 sqrt(E I / rho A) / l^2."""
    side = 1.0 / slenderness
    mesh = meshes.block(1.0, side, side, divisions=(60, 1, 1), degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ends)
    found = craig_bampton(model, modes=8, frame="x_min").frequencies()[:4]
    wave = side * np.sqrt(STEEL.E / (12.0 * STEEL.rho)) / (2.0 * np.pi)
    assert found == pytest.approx(wave * np.repeat([22.3733, 61.6728], 2), rel=2e-3)


@pytest.mark.parametrize("nu", [0.4999, 0.499999, 0.4999999])
def test_nearly_incompressible_bodies(nu):
    parameters = dataclasses.replace(solid_nearly_incompressible.reference().parameters, nu=nu)
    mesh = meshes.block(1.0, 0.2, 0.1, divisions=(4, 2, 1), degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_nearly_incompressible, parameters, degree=2, interfaces=ends)
    body = craig_bampton(model, modes=6, frame="x_min", geometric_stiffness=False)
    k, m = (gather(one).toarray() for one in (model.K, model.M))
    free = np.ones(len(k), dtype=bool)
    for one in model.interfaces:
        free[one.dofs] = False
    # by the mass, in which small eigenvalues of the flexibility are lost rather than those of the stiffness
    values = scipy.linalg.eigh(m[np.ix_(free, free)], k[np.ix_(free, free)], eigvals_only=True)[::-1]
    exact = 1.0 / np.sqrt(values[:4]) / (2.0 * np.pi)
    assert body.frequencies(("x_min", "x_max"))[:4] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("slenderness", [50, 100])
def test_slender_bars_by_iteration(slenderness):
    """3 E I / l^3, and as by a factor."""
    side = 1.0 / slenderness
    mesh = meshes.block(1.0, side, side, divisions=(20, 1, 1), degree=1, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    parameters = dataclasses.replace(STEEL, nu=0.0)
    model = ContinuumModel(mesh, solid_linear, parameters, degree=2, interfaces=ends)
    stiffness = []
    for solver in Solver:
        body = guyan(model, frame="x_min", geometric_stiffness=False, solver=solver)
        rows = body.interface("x_max").modes[1]
        stiffness.append(1.0 / (rows**2 @ (1.0 / body.stiffness)))
    assert stiffness == pytest.approx([3.0 * STEEL.E * side**4 / 12.0] * 3, rel=2e-3)
    assert stiffness[1:] == pytest.approx(stiffness[:1] * 2, rel=1e-4)


def test_what_double_precision_does_not_tell_is_refused():
    with pytest.raises(ReductionError, match=r"double precision cannot resolve"):
        craig_bampton(plate(1e-5, ("x_min",)), modes=4, frame="x_min")


@pytest.mark.parametrize("names", [(), ("x_min",)], ids=["free", "held"])
def test_deformations_without_energy_are_refused(names):
    """A solid that resists a change of its volume alone has a singular stiffness, however it is factorised."""
    form = types.ModuleType("without_shear")
    content = dict(vars(solid_linear))
    content["strain_energy"] = lambda u, p: [(0.5 * p.E * ufl.div(u) ** 2, solid_linear.Quadrature(4))]
    form.__dict__.update({**content, "__name__": "without_shear"})
    mesh = meshes.block(1.0, 0.5, 0.4, divisions=(3, 2, 2), degree=1, comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, form, STEEL, degree=2, interfaces=[Interface(name) for name in names])
    with pytest.raises(ReductionError):
        craig_bampton(model, modes=4, frame=names[0] if names else None, geometric_stiffness=False)
