"""Buckling factors of columns, cantilevers and heavy rods: closed forms, and the limit load of `prestressed`."""

import numpy as np
import pytest
from scipy.optimize import brentq

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.coupling import Coupling
from flexmbd.errors import ConvergenceError, InterfaceError, PictureError, ReductionError
from flexmbd.forms import solid_linear, solid_mixed
from flexmbd.reduction import guyan, linear_buckling, prestressed
from flexmbd.visual import plot_shape

# no lateral contraction: what the rigid ends would hinder
STEEL = solid_linear.Parameters(E=2.0e11, nu=0.0, rho=7800.0)
LENGTH, WIDTH, HEIGHT = 1.0, 0.03, 0.02
BENDING = STEEL.E * WIDTH * HEIGHT**3 / 12
SHEAR = 5 / 6 * STEEL.E / 2 * WIDTH * HEIGHT
PUSHED = {"x_max": (-1.0, 0, 0, 0, 0, 0)}


END = Interface("x_max")


def column(*, width=WIDTH, height=HEIGHT, cells=32, last=END, across=1, form=solid_linear, material=STEEL):
    mesh = meshes.block(LENGTH, width, height, divisions=(cells, across, 1))
    return ContinuumModel(mesh, form, material, degree=2, interfaces=[Interface("x_min"), last])


@pytest.fixture(scope="module")
def steel_column():
    return column()


ALL = ("x", "y", "z", "rx", "ry", "rz")
ENDS = {
    "fixed and free": ({"x_min": ALL}, 0.25),
    "pinned": ({"x_min": ("x", "y", "z", "rx"), "x_max": ("y", "z")}, 1.0),
    "fixed and pinned": ({"x_min": ALL, "x_max": ("y", "z")}, (4.493409457909064 / np.pi) ** 2),
    "fixed": ({"x_min": ALL, "x_max": ("y", "z", "rx", "ry", "rz")}, 4.0),
}


@pytest.mark.mpi
@pytest.mark.parametrize("ends", ENDS)
def test_columns_of_four_ends(steel_column, ends):
    """Euler's loads, with the shear of Engesser: k^2 EI (1 - P / kGA) = P, and tan(k L) = k L (1 - P / kGA)."""
    clamped, factor = ENDS[ends]
    euler = factor * np.pi**2 * BENDING / LENGTH**2
    load = euler / (1 + euler / SHEAR)
    if ends == "fixed and pinned":

        def excess(p):
            rest = 1.0 - p / SHEAR
            kl = LENGTH * np.sqrt(p / BENDING / rest)
            return np.tan(kl) - kl * rest

        load = brentq(excess, 0.98 * euler, 1.01 * euler)
    found = linear_buckling(steel_column, clamped=clamped, forces=PUSHED)
    assert found.factors == pytest.approx([load], rel=5e-4)
    assert found.factors == pytest.approx([euler], rel=5e-3)
    assert found.note.startswith("counted, ")
    shape = found.shape.phi[:, :, 0]
    # sideways along the softer axis
    assert abs(shape[:, 2]).max() == pytest.approx(1.0, rel=0.05)
    assert abs(shape[:, 1]).max() < 1e-6


@pytest.mark.mpi
def test_equal_factors_are_found_with_their_copies():
    found = linear_buckling(column(width=0.02, cells=16), clamped=["x_min"], forces=PUSHED, count=4)
    euler = (2 * np.array([1, 1, 2, 2]) - 1) ** 2 * np.pi**2 * STEEL.E * 0.02**4 / 12 / 4
    assert found.factors == pytest.approx(euler, rel=1e-2)
    assert found.factors[::2] == pytest.approx(found.factors[1::2], rel=1e-7)
    both = np.einsum("kai,kaj->ij", found.shape.phi, found.shape.phi)
    assert abs(both[0, 1]) < 0.9 * both[0, 0]


def test_rod_under_its_own_weight(steel_column):
    """q L^3 / EI = 7.8373 (Greenhill)."""
    found = linear_buckling(steel_column, clamped=["x_min"], acceleration=(-9.81, 0.0, 0.0))
    weight = STEEL.rho * 9.81 * WIDTH * HEIGHT
    assert found.factors * weight * LENGTH**3 / BENDING == pytest.approx([7.8373], rel=1e-3)


def test_load_on_a_rigid_lever():
    """A dead load on a rigid piece of length a at the free end: k L tan(k L) = L / a, k^2 = P / EI."""
    lever = 0.4
    model = column(last=Interface("x_max", origin=(LENGTH + lever, 0.0, 0.0)))
    found = linear_buckling(model, clamped=["x_min"], forces=PUSHED)
    root = brentq(lambda x: x * np.tan(x) - LENGTH / lever, 1e-3, np.pi / 2 - 1e-3)
    assert found.factors == pytest.approx([root**2 * BENDING / LENGTH**2], rel=1e-3)


def test_lateral_buckling_has_factors_of_both_signs():
    """A thin strip under a force across its end: 4.013 sqrt(EI GJ) / L^2 either way (Timoshenko & Gere, 6.3).

    EI and GJ are those of the mesh, by its static flexibility; the theory leaves out bending in the strip's plane.
    """
    model = column(width=0.03, height=0.002, across=4)
    across = {"x_max": (0, 1.0, 0, 0, 0, 0)}
    found = linear_buckling(model, clamped=["x_min"], forces=across, count=2, reversed_too=True)
    body = guyan(model, frame="x_min", geometric_stiffness=False)
    flexibility = body.partition @ np.diag(1 / body.stiffness) @ body.partition.T
    bending, twisting = LENGTH**3 / 3 / flexibility[2, 2], LENGTH / flexibility[3, 3]
    expected = 4.013 * np.sqrt(bending * twisting) / LENGTH**2
    assert np.sort(found.factors) == pytest.approx([-expected, expected], rel=1.5e-2)
    assert abs(found.factors.sum()) < 1e-6 * expected


def test_a_pulled_rod_does_not_buckle(steel_column):
    pulled = {"x_max": (1.0, 0, 0, 0, 0, 0)}
    assert linear_buckling(steel_column, clamped=["x_min"], forces=pulled).factors.size == 0
    both = linear_buckling(steel_column, clamped=["x_min"], forces=pulled, reversed_too=True)
    pushed = linear_buckling(steel_column, clamped=["x_min"], forces=PUSHED)
    assert both.factors == pytest.approx(-pushed.factors, rel=1e-9)


def test_prestressed_ends_there(steel_column):
    force = -linear_buckling(steel_column, clamped=["x_min"], forces=PUSHED).factors[0]
    prestressed(steel_column, frame="x_min", forces={"x_max": (0.998 * force, 0, 0, 0, 0, 0)})
    with pytest.raises(ConvergenceError, match="buckles"):
        prestressed(steel_column, frame="x_min", forces={"x_max": (1.002 * force, 0, 0, 0, 0, 0)})


def test_averaged_end(steel_column):
    """A free end that is averaged rather than rigid: the same column."""
    model = column(last=Interface("x_max", coupling=Coupling.AVERAGED))
    for clamped in (["x_min"], {"x_min": ALL, "x_max": ("y", "z")}):
        found = linear_buckling(model, clamped=clamped, forces=PUSHED)
        rigid = linear_buckling(steel_column, clamped=clamped, forces=PUSHED)
        assert found.factors == pytest.approx(rigid.factors, rel=1e-3)


@pytest.mark.mpi
def test_wrong_arguments(steel_column):
    def refused(what, error=ReductionError, model=steel_column, **changed):
        given = {"clamped": ["x_min"], "forces": PUSHED, **changed}
        with pytest.raises(error, match=what):
            linear_buckling(model, **given)

    refused("no loads", forces={})
    refused("no loads", forces={"x_max": np.zeros(6)})
    refused("free to move", clamped={"x_min": ("x", "y", "z")})
    refused("free to move", clamped={"x_min": ("x", "y", "z"), "x_max": ("x", "y", "z")})
    refused("nothing is clamped", clamped={})
    refused("clamped must be a mapping of a text to a list, each a text", clamped={"x_min": "xyz"})
    refused("must be among", clamped={"x_min": ("x", "q")})
    refused("no interface 'tip'", InterfaceError, clamped=["tip"])
    refused("no interface 'tip'", InterfaceError, forces={"tip": np.ones(6)})
    refused("six finite numbers", forces={"x_max": (1.0, 2.0)})
    refused("three finite numbers", acceleration=(1.0, np.nan, 0.0))
    refused("count must be", count=0)
    refused("reversed_too must be", reversed_too=1)
    refused("loads must be a list, each a tuple of 2", loads=["weight"])
    mixed = solid_mixed.Parameters(E=2.0e11, nu=0.3, rho=7800.0)
    refused("not positive definite", model=column(cells=2, form=solid_mixed, material=mixed))


def test_picture(steel_column, tmp_path):
    found = linear_buckling(steel_column, clamped=["x_min"], forces=PUSHED, count=2)
    path = plot_shape(found.shape, tmp_path / "buckled.png", mode=1, size=(160, 120), title="second")
    assert path.stat().st_size > 500
    with pytest.raises(PictureError, match="one of the 2"):
        plot_shape(found.shape, tmp_path / "third.png", mode=2)
