"""Cells of full bodies that are too stiff in bending are told, with about how much: against Bernoulli's beam."""

import warnings

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    Support,
    clamped_dofs,
    follow,
)
from flexmbd.forms import j2_plasticity

E, LENGTH, THICK = 2.1e11, 1.0, 0.05
STEEL = {"E": E, "nu": 0.3, "rho": 7850.0}


def steel(form, **law):
    return form.Parameters(**STEEL, **law)


def yielding(form=j2_plasticity):
    return steel(form, yield_stress=3e8, hardening=j2_plasticity.LinearHardening(1e9))


def beam(divisions, *, size=1.0, cell="hexahedron"):
    return meshes.block(size * LENGTH, size * THICK, size * THICK, divisions=divisions, cell=cell)


def told(make):
    """What is told, and what is made."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        made = make()
    return [str(one.message) for one in found if one.category is fm.LockingWarning], made


def excess(text):
    """Of the stiffness, as the frequency's tells."""
    return (1.0 + float(text.split("some ")[1].split()[0]) / 100.0) ** 2 - 1.0


def bend(body):
    """The tip's displacement over Bernoulli's, in the elastic range."""
    x = body.layout.node_x
    tip = np.flatnonzero(x[: body.layout.n_owned_nodes, 0] > x[:, 0].max() * (1 - 1e-9))
    load = np.zeros(body.n_owned)
    size = x[:, 0].max()
    load[body.layout.displacement_dofs[tip, 2]] = size**2 / len(tip)
    follow(body, times=[1.0], prescribed=clamped_dofs(body, ["x_min"]), load=lambda t: t * load)
    moved = body.displacement[body.layout.displacement_dofs[tip, 2]].mean()
    return moved / (size**5 / 3.0 / (E * (0.05 * size) ** 4 / 12.0))


BEAMS = [((10, 1, 1), 1.0), ((5, 1, 1), 1e-3), ((8, 2, 2), 1.0), ((10, 3, 3), 1e3)]


@pytest.mark.parametrize(("divisions", "size"), BEAMS)
def test_about_how_much_too_stiff_bricks_of_mean_volume_are(divisions, size):
    body = NonlinearModel(beam(divisions, size=size), j2_plasticity, yielding(), degree=1)
    (text,), softness = told(lambda: bend(body))
    assert excess(text) == pytest.approx(1.0 / softness - 1.0, rel=0.25)


def test_bricks_without_mean_volume_are_told_as_those_of_reductions():
    body = NonlinearModel(beam((20, 1, 1)), forms.st_venant_kirchhoff, steel(forms.st_venant_kirchhoff), degree=1)
    (text,), softness = told(lambda: bend(body))
    assert excess(text) == pytest.approx(1.0 / softness - 1.0, rel=0.25)


def test_what_bends_is_not_told():
    """Cubes of mean volume, four cells, two on a plane of symmetry, quadratic cells, cells with fields."""
    for divisions in ((20, 1, 1), (20, 4, 4)):
        assert not told(lambda d=divisions: bend(NonlinearModel(beam(d), j2_plasticity, yielding(), degree=1)))[0]
    half = meshes.block(1.0, 0.2, 0.05, divisions=(8, 4, 2))
    for held, count in (([Support("z_min", z=True)], 0), ([Support("z_min", x=True)], 1), ([], 1)):
        body = NonlinearModel(half, j2_plasticity, yielding(), degree=1)
        assert len(told(lambda b=body, s=held: ExplicitRun(b, velocity=(0, 0, 0), supports=s))[0]) == count
    svk = forms.st_venant_kirchhoff
    assert not told(lambda: bend(NonlinearModel(beam((5, 1, 1)), svk, steel(svk), degree=2)))[0]
    enhanced = forms.solid_enhanced
    texts, softness = told(lambda: bend(NonlinearModel(beam((5, 1, 1)), enhanced, steel(enhanced), degree=1)))
    assert not texts
    assert softness == pytest.approx(1.0, abs=0.03)


def test_walls_are_not_told():
    wall = meshes.wall(meshes.sheet(LENGTH, THICK, divisions=(8, 1)), THICK)
    body = NonlinearModel(wall, forms.solid_shell, steel(forms.solid_shell), degree=1)
    texts, softness = told(lambda: bend(body))
    assert not texts
    assert softness == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("motion", [ExplicitContinuum, ImplicitContinuum])
def test_bodies_in_machines_are_told_once_and_unchanged(motion):
    body = NonlinearModel(beam((8, 1, 1)), j2_plasticity, yielding(), degree=1, interfaces=[Interface("x_min")])
    assert len(told(lambda: motion(body))[0]) == 1
    assert not body.displacement.any()
    assert not any(history.any() for history in body.history())


@pytest.mark.mpi
def test_ranks_tell_of_their_cells_together():
    """On rank 0 alone."""
    comm = MPI.COMM_WORLD
    block = meshes.block(1.0, 0.4, 0.05, divisions=(8, 4, 2), comm=comm)
    for supports, count in (([], 1), ([Support("z_max", z=True)], 0)):
        body = NonlinearModel(block, j2_plasticity, yielding(), degree=1)
        texts, _ = told(lambda b=body, s=supports: ExplicitRun(b, velocity=(0, 0, 0), supports=s))
        assert len(texts) == (count if comm.rank == 0 else 0)
        if texts:
            assert "2 cells lie through 100 %" in texts[0]
