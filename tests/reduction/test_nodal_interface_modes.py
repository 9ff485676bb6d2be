"""Characteristic modes of nodal interfaces: error and estimate against the full part, and halves coupled in numpy."""

import dataclasses
import functools

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import scipy.linalg
from full_model import FullModel
from halved_bar import HALF, STEEL, TURNED, bar, blocks

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NodalInterface
from flexmbd.errors import ExportError, InterfaceError, ReductionError
from flexmbd.export.superelements.superelement import superelement
from flexmbd.forms import solid_linear
from flexmbd.reduction import InterfaceModes, Keep, Truncation, craig_bampton, guyan, truncation_errors

pytestmark = pytest.mark.mpi

PLAIN = {"geometric_stiffness": False}
FREE = NodalInterface("x_min"), NodalInterface("x_max")
FOOT = Interface("x_min", axes=TURNED), NodalInterface("x_max")


@functools.cache
def exact(*, held):
    """Six lowest elastic eigenvalues of the unreduced half, free or with its foot held."""
    full = FullModel(bar())
    rows = np.repeat(full.x[:, 0] > 1e-9, 3) if held else np.ones(3 * len(full.x), dtype=bool)
    k, m = (matrix.toarray()[np.ix_(rows, rows)] for matrix in (full.K, full.M))
    return scipy.linalg.eigh(k, m, eigvals_only=True)[(0 if held else 6) :][:6]


def error(found, expected):
    return float((found[:6] / expected - 1.0).max())


@pytest.mark.parametrize(("frame", "local"), [("x_min", False), (None, False), (None, True)])
def test_tolerance(frame, local):
    """What is added is told; with the estimate for the modes it is above the true error, and not far."""
    kinds, held = (FOOT, True) if frame else (FREE, False)
    whole = craig_bampton(bar(*kinds), modes=10, frame=frame, **PLAIN)
    interior = truncation_errors(bar(*kinds), [10], frame=frame, held=held).errors.max()
    sizes = []
    for tol in (0.9, 1e-1, 1e-2, 1e-3):
        choice = InterfaceModes(Truncation(tol=tol), local=local)
        body = craig_bampton(bar(*kinds), modes=10, frame=frame, interface_modes=choice, **PLAIN)
        sizes.append(body.n_modes)
        clamps = [(), (frame,)] if frame else [()]
        found, all_shapes = (
            [(2 * np.pi * one.frequencies(clamped)[:6]) ** 2 for clamped in clamps] for one in (body, whole)
        )
        added = max(map(error, found, all_shapes))
        assert added <= tol
        told = float(body.provenance["error of eigenvalues added by them"].split()[0])
        assert added == pytest.approx(told, rel=0.01, abs=1e-8)
        true = error(found[-1], exact(held=held))
        assert true <= (1 + interior) * (1 + told) - 1 + 1e-9
        assert body.nodal is None
    assert sizes == sorted(set(sizes))
    assert sizes[-1] < whole.n_modes


@pytest.mark.parametrize("local", [False, True])
def test_all_modes_are_all_shapes(local):
    """Any numbering of what carries the rigid motions, six dofs of both ends, leaves the same body."""
    whole = craig_bampton(bar(*FREE), modes=4, **PLAIN)
    every = craig_bampton(bar(*FREE), modes=4, interface_modes=InterfaceModes(48, local=local), **PLAIN)
    np.testing.assert_allclose(every.stiffness, whole.stiffness, rtol=1e-8)
    with pytest.raises(ReductionError, match="there are 48"):
        craig_bampton(bar(*FREE), modes=4, interface_modes=InterfaceModes(49, local=local))


def test_modes_of_a_free_body_are_those_of_its_condensed_matrices():
    """And none of a body that is held at six dofs of its nodes."""
    element = superelement(guyan(bar(*FREE), **PLAIN), nodes=True)
    values = scipy.linalg.eigh(element.K, element.M, eigvals_only=True)
    body = craig_bampton(bar(*FREE), modes=0, interface_modes=InterfaceModes(9), **PLAIN)
    np.testing.assert_allclose(body.stiffness, values[6:15], rtol=1e-8)


def test_nodes_that_are_kept_are_exact_in_statics(tmp_path):
    """A free body, loaded on the nodes of one end in equilibrium, the other's reduced."""
    rng = np.random.default_rng(3)
    whole = craig_bampton(bar(*FREE), modes=2, **PLAIN)
    choice = InterfaceModes(3, joints=["x_max"])
    body = craig_bampton(bar(*FREE), modes=2, interface_modes=choice, **PLAIN)
    # six of the kept nodes' dofs carry the rigid motions
    assert body.n_modes == 27 - 6 + 3 + 2
    assert body.nodal.names == ("x_max",)
    assert body.provenance["nodal interfaces"] == "x_max"
    assert body.provenance["nodal interfaces without nodes"] == "x_min"
    forces = rng.normal(size=(27, 4))
    rigid = superelement(body, nodes=True).rigid_motions(np.zeros(3))[:27]
    forces -= rigid @ np.linalg.lstsq(rigid, forces, rcond=None)[0]
    answers = []
    for one in (body, whole):
        rows = one.nodal.phi[one.nodal.interface == one.nodal.names.index("x_max")].reshape(27, -1)
        answers.append(forces.T @ (rows / one.stiffness @ rows.T) @ forces)
    np.testing.assert_allclose(*answers, rtol=1e-9)
    if MPI.COMM_WORLD.rank == 0:
        fm.export.dmig(body, tmp_path / "half.pch")
        text = (tmp_path / "half.pch").read_text()
        assert text.count("GRID*") == 9
        assert text.count("SPOINT") == 3 + 2


def seam(body):
    """(27, n) displacements of the nodes of the end "x_max", along the mesh's axes, and their places there."""
    x = body.modes.x @ body.R_MB.T + body.p_MB_M
    on = np.flatnonzero(abs(x[:, 0] - HALF) < 1e-9)
    return (body.R_MB @ body.modes.phi[on]).reshape(3 * len(on), -1), x[on]


def tied(one, other):
    """Stiffness and mass of the first half, its foot held, and the other's, whose nodes follow those of the first."""
    rows, places = seam(one)
    K, M, x = blocks(other, moved=HALF)
    order = [int(np.linalg.norm(places - place, axis=1).argmin()) for place in x]
    assert abs(places[order] - x).max() < 1e-12
    first = 6 * len(other.interfaces)
    nodes, n = np.arange(first, first + 3 * len(x)), one.n_modes
    rest = np.setdiff1d(np.arange(len(K)), nodes)
    motion = np.zeros((len(K), n + len(rest)))
    motion[nodes, :n] = rows.reshape(-1, 3, n)[order].reshape(-1, n)
    motion[rest, n + np.arange(len(rest))] = 1.0
    k, m = motion.T @ K @ motion, motion.T @ M @ motion
    k[np.arange(n), np.arange(n)] += one.stiffness
    m[:n, :n] += one.mass_matrix()[6:, 6:]
    return k, m, n


def test_two_halves_vibrate_as_the_whole_the_more_modes_there_are():
    """The nodes of the second half follow those of the first, whose seam is reduced; nothing else is left out."""
    full = FullModel(bar(halves=2))
    free = np.flatnonzero(np.repeat(full.x[:, 0] > 1e-9, 3))
    expected = scipy.linalg.eigh(*(one.toarray()[np.ix_(free, free)] for one in (full.K, full.M)), eigvals_only=True)
    other = craig_bampton(bar(NodalInterface("x_min")), modes=81, **PLAIN)
    errors = []
    for count in (6, 12, 18, 27):
        one = craig_bampton(
            bar(*FOOT), modes=54, frame="x_min", interface_modes=InterfaceModes(count), keep=Keep(modes=True), **PLAIN
        )
        k, m, _ = tied(one, other)
        errors.append(error(scipy.linalg.eigh(k, m, eigvals_only=True), expected[:6]))
    assert min(errors) > -1e-8  # from above
    assert errors == sorted(errors, reverse=True)
    assert errors[1] < 1e-2
    assert errors[-1] < 1e-8


def test_two_halves_bend_as_the_whole_the_more_modes_there_are():
    """The flexibility of a rigid tip."""
    other = guyan(bar(NodalInterface("x_min"), Interface("x_max")), frame="x_max", **PLAIN)
    whole = guyan(bar(Interface("x_min"), Interface("x_max"), halves=2), frame="x_min", **PLAIN)
    expected = np.linalg.inv(superelement(whole).K[6:, 6:])
    size = np.sqrt(np.diag(expected))
    errors = []
    for count in (6, 12, 18, 27):
        one = craig_bampton(
            bar(*FOOT), modes=0, frame="x_min", interface_modes=InterfaceModes(count), keep=Keep(modes=True), **PLAIN
        )
        k, _, n = tied(one, other)
        tip = np.linalg.inv(k)[n : n + 6, n : n + 6]
        errors.append(abs((tip - expected) / np.outer(size, size)).max())
    assert errors == sorted(errors, reverse=True)
    assert errors[1] < 1e-2
    assert errors[-1] < 1e-8


def test_what_is_left_of_a_seam_whose_nodes_are_reduced():
    body = craig_bampton(bar(*FREE), modes=2, interface_modes=InterfaceModes(4), **PLAIN)
    with pytest.raises(InterfaceError, match="no interface 'x_max'"):
        body.interface("x_max")
    with pytest.raises(ExportError, match=r"no interface frame and no node.*joints="):
        superelement(body, nodes=True)
    for joints, message in ((["foot"], "joints names 'foot'.*x_min, x_max"), (["x_min", "x_max"], "none is left")):
        with pytest.raises(ReductionError, match=message):
            craig_bampton(bar(*FREE), modes=2, interface_modes=InterfaceModes(4, joints=joints))
    mesh = meshes.block(HALF, 0.05, 0.04, divisions=(2, 2, 2))
    at = dolfinx.mesh.locate_entities(
        mesh.mesh, 1, lambda x: np.isclose(x[0], HALF) & np.isclose(x[1], -0.025)
    )
    mesh = dataclasses.replace(mesh, edge_groups={"edge": at})
    kinds = NodalInterface("x_min"), NodalInterface("edge")
    edge = ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=kinds)
    with pytest.raises(ReductionError, match=r"'x_min' alone.*do not hold the body"):
        craig_bampton(edge, modes=2, interface_modes=InterfaceModes(4, local=True))
