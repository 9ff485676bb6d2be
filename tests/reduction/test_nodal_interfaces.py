"""Nodal interfaces: two halves of a bar coupled node by node are the whole bar; what files hold; what is refused."""

import functools
import re

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from full_model import FullModel
from halved_bar import HALF, STEEL, TURNED, bar, blocks

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import Interface, NodalInterface, NonlinearModel, SymmetryPlane
from flexmbd.errors import ExportError, InterfaceError, ReductionError
from flexmbd.export import InterfaceNode, NodeSet
from flexmbd.export.superelements.superelement import superelement
from flexmbd.forms import solid_linear
from flexmbd.reduction import Truncation, craig_bampton, guyan, linear_buckling, prestressed

pytestmark = pytest.mark.mpi

@functools.cache
def first_half():
    """On its foot, with all 54 modes of what is inside."""
    model = bar(Interface("x_min", axes=TURNED), NodalInterface("x_max"))
    return craig_bampton(model, modes=54, frame="x_min", geometric_stiffness=False)


@functools.cache
def second_half():
    """Held by nothing and without a frame, with all 81 modes of what is inside."""
    return craig_bampton(bar(NodalInterface("x_min")), modes=81, geometric_stiffness=False)


def coupled(one, other):
    """K and M of two superelements, whose first rows and which rows of the nodes begin where is given, assembled.

    ``one``, ``other``: (K, M, x, first row of the nodes).
    """
    (K1, _, x1, first1), (_, _, x2, first2) = one, other
    order = [int(np.linalg.norm(x1 - place, axis=1).argmin()) for place in x2]
    assert abs(x1[order] - x2).max() < 1e-12
    n1, n2 = len(K1), len(other[0])
    at = np.full(n2, -1)
    for j, i in enumerate(order):
        at[first2 + 3 * j : first2 + 3 * j + 3] = first1 + 3 * i + np.arange(3)
    at[at < 0] = n1 + np.arange(n2 - 3 * len(x2))
    whole = []
    for mine, theirs in zip(one[:2], other[:2], strict=True):
        matrix = np.zeros((n1 + n2 - 3 * len(x2),) * 2)
        matrix[:n1, :n1] = mine
        matrix[np.ix_(at, at)] += theirs
        whole.append(matrix)
    return whole


def test_two_halves_vibrate_as_the_whole():
    """All modes of both are kept, so that nothing is left out."""
    K, M = coupled((*blocks(first_half()), 6), (*blocks(second_half(), moved=HALF), 0))
    # the foot, whose rows are the first, is held
    found = np.sqrt(scipy.linalg.eigh(K[6:, 6:], M[6:, 6:], eigvals_only=True)) / (2.0 * np.pi)
    full = FullModel(bar(halves=2))
    free = np.flatnonzero(np.repeat(full.x[:, 0] > 1e-9, 3))
    whole = (matrix.toarray()[np.ix_(free, free)] for matrix in (full.K, full.M))
    exact = scipy.linalg.eigh(*whole, eigvals_only=True)
    exact = np.sqrt(exact) / (2.0 * np.pi)
    assert len(found) == len(exact)
    np.testing.assert_allclose(found, exact, rtol=1e-8)


def test_two_halves_bend_as_the_whole():
    """By static shapes alone: the flexibility of a rigid tip."""
    one = guyan(bar(Interface("x_min"), NodalInterface("x_max")), frame="x_min", geometric_stiffness=False)
    other = guyan(bar(NodalInterface("x_min"), Interface("x_max")), frame="x_max", geometric_stiffness=False)
    K, _ = coupled((*blocks(one), 6), (*blocks(other, moved=HALF), 6))
    tip = np.linalg.inv(K[6:, 6:])[-6:, -6:]
    whole = guyan(bar(Interface("x_min"), Interface("x_max"), halves=2), frame="x_min", geometric_stiffness=False)
    exact = np.linalg.inv(superelement(whole).K[6:, 6:])
    np.testing.assert_allclose(tip, exact, rtol=1e-8, atol=1e-10 * abs(exact).max())


def test_the_record_says_which_node_and_direction(tmp_path):
    body = first_half()
    assert body.n_modes == 27 + 54
    numbers = FullModel(bar()).x
    for name, row in zip(body.partition_names[:27], body.partition[:27], strict=True):
        group, node, axis = name.split(".")
        place = int(np.flatnonzero(body.nodal.node == int(node))[0])
        assert group == "x_max"
        np.testing.assert_allclose(body.nodal.phi[place, "xyz".index(axis)], row, atol=1e-9 * abs(row).max())
        np.testing.assert_allclose(body.R_MB @ body.nodal.x[place] + body.p_MB_M, numbers[int(node)], atol=1e-12)
    assert set(body.nodal.node) == set(np.flatnonzero(numbers[:, 0] > HALF - 1e-9))
    assert body.provenance["nodal interfaces"] == "x_max"
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "half.h5"))
    if MPI.COMM_WORLD.rank == 0:
        body.save(path)
        assert fm.ReducedBody.load(path).fingerprint() == body.fingerprint()
        assert "9 nodes" in body.inspect()


@pytest.mark.parametrize("frame", ["x_min", None])
def test_one_process_has_the_same_body(frame):
    kinds = (Interface if frame else NodalInterface)("x_min"), NodalInterface("x_max")
    here, alone = (
        craig_bampton(bar(*kinds, comm=comm), modes=Truncation(below_hz=2e4), frame=frame)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    assert here.partition_names == alone.partition_names
    assert here.provenance["completeness"] == alone.provenance["completeness"]
    np.testing.assert_allclose(here.stiffness, alone.stiffness, rtol=1e-8)
    one, other = (superelement(body, nodes=True).K for body in (here, alone))
    np.testing.assert_allclose(one, other, atol=1e-9 * abs(other).max())


def test_frames_beside_nodes_are_a_machine(tmp_path):
    """A body with a nodal interface moves as one without it, and says that its nodes carry no joint."""
    plain = craig_bampton(bar(Interface("x_min")), modes=81, frame="x_min", geometric_stiffness=False)
    np.testing.assert_allclose(
        first_half().frequencies(["x_min"])[:20], plain.frequencies(["x_min"])[:20], rtol=1e-8
    )
    body = fm.System().add(fm.FlexibleBody(first_half()))
    with pytest.raises(InterfaceError, match=r"'x_max' is nodal.*Interface\('x_max'\).*fm\.export\.dmig"):
        body.frame("x_max")
    with pytest.raises(ExportError, match=r"the nodal interfaces \(x_max\)"):
        fm.export.op4(first_half(), tmp_path / "half.op4")


def punched(path):
    """GRIDs with their places and held components, and matrices, of a Nastran file in wide fields."""
    grids, matrices = {}, {}
    lines = [line for line in path.read_text().splitlines() if not line.startswith("$")]
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        fields = [line[8 + 16 * i : 24 + 16 * i].strip() for i in range(4)]
        if line.startswith("GRID*"):
            more = [following[8 + 16 * i : 24 + 16 * i].strip() for i in range(3)]
            grids[int(fields[0])] = ([number(text) for text in (*fields[2:4], more[0])], more[2])
        elif line.startswith("DMIG*"):
            name, column = fields[0], (int(fields[1]), int(fields[2]))
        elif line.startswith("*") and fields[1].isdigit() and "." in fields[2]:
            matrices.setdefault(name, {})[(int(fields[0]), int(fields[1])), column] = number(fields[2])
    return grids, matrices


def number(text):
    """Nastran leaves the E of an exponent out."""
    return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"E\1", text.replace("E", "")))


def test_files_for_finite_element_programs(tmp_path):
    body = first_half()
    element = superelement(body, nodes=True)
    fm.export.dmig(body, tmp_path / "half.pch")
    grids, matrices = punched(tmp_path / "half.pch")
    assert [held for _, held in grids.values()] == [""] + 9 * ["456"]
    np.testing.assert_allclose([place for place, _ in grids.values()], np.vstack([element.p, element.x]), atol=1e-12)
    dofs = [(1, c) for c in range(1, 7)] + [(2 + i, c) for i in range(9) for c in (1, 2, 3)]
    size = np.sqrt(np.diag(element.K))
    for name, matrix in (("KAAX", element.K), ("MAAX", element.M)):
        for i, j in [(8, 6), (20, 20), (32, 6), (32, 2)]:
            value = matrices[name].get((dofs[i], dofs[j]), 0.0)
            assert value == pytest.approx(matrix[i, j], abs=1e-9 * abs(matrix).max())
    fm.export.calculix(body, tmp_path / "half.inp")
    rows = np.loadtxt(tmp_path / "half.sti", delimiter=",")
    assert {tuple(row) for row in rows[:, :2].astype(int)} >= set(dofs)
    place = {dof: i for i, dof in enumerate(dofs)}
    for n1, c1, n2, c2, value in rows:
        if (n1, c1) in place and (n2, c2) in place:
            i, j = place[n1, c1], place[n2, c2]
            assert value == pytest.approx(element.K[i, j], abs=1e-12 * size[i] * size[j])
    deck = (tmp_path / "half.inp").read_text()
    assert "2, 4, 6\n" in deck
    assert '"mesh node": ' in deck
    for read, path in ((fm.export.read_dmig, "half.pch"), (fm.export.read_calculix, "half.inp")):
        with pytest.raises(ExportError, match="nodal interfaces, nodes of three components"):
            read(tmp_path / path)


@pytest.mark.parametrize(("write", "read", "name"), [
    (fm.export.dmig, fm.export.read_dmig, "bar.pch"), (fm.export.calculix, fm.export.read_calculix, "bar.inp"),
])  # fmt: skip
def test_retained_nodes_bound_to_frames_are_the_body_with_rigid_interfaces(write, read, name, tmp_path):
    """Its fixed-interface modes are the same, and its static shapes sums of those of the nodes."""
    ends = {"x_min": 0.0, "x_max": HALF}
    how = {"modes": 7, "geometric_stiffness": False}
    rigid = craig_bampton(bar(*map(Interface, ends)), frame="x_min", **how)
    nodal = craig_bampton(bar(*map(NodalInterface, ends)), **how)
    mixed = craig_bampton(bar(Interface("x_min"), NodalInterface("x_max")), frame="x_min", **how)
    if MPI.COMM_WORLD.rank > 0:
        return
    clamps = [], ["x_max"], ["x_min", "x_max"]
    for body in (nodal, mixed):
        write(body, tmp_path / name)
        element = superelement(body, nodes=True)
        first = 1 + len(element.names)
        bound = {
            end: NodeSet([first + i for i, of in enumerate(element.node_interface) if of == end])
            for end in ends
            if end not in element.names
        }
        given = {**{end: InterfaceNode(None, 1) for end in element.names}, **bound}
        found = read(tmp_path / name, interfaces=given, frame="x_min")
        assert [one.name for one in found.interfaces] == [*ends]
        assert found.mass == pytest.approx(rigid.mass, rel=1e-9)
        for clamped in clamps:
            exact = rigid.frequencies(clamped=clamped)
            np.testing.assert_allclose(found.frequencies(clamped=clamped), exact, rtol=1e-6)
    with pytest.raises(ExportError, match="node 2 is of two interfaces, 'x_max' and 'more'"):
        read(tmp_path / name, interfaces={**given, "more": NodeSet([2, 3, 4])})
    with pytest.raises(ExportError, match="node 99 is not in the node table"):
        read(tmp_path / name, interfaces={**given, "x_max": NodeSet([*bound["x_max"].nodes, 99])})


@pytest.mark.parametrize(
    ("interfaces", "options", "message"),
    [
        ([Interface("x_min"), NodalInterface("y_min")], {}, "'y_min' shares nodes with x_min"),
        ([NodalInterface("x_min"), NodalInterface("y_min")], {}, "'y_min' shares nodes with x_min.*one group of both"),
        ([NodalInterface("x_min"), NodalInterface("x_min")], {}, "'x_min' is given twice"),
        ([Interface("x_min"), NodalInterface("weld")], {}, "no such group of facets, edges or vertices"),
        ([Interface("x_min", coupling=fm.Coupling.AVERAGED), NodalInterface("x_max")], {}, "'x_min' is averaged"),
        (
            [Interface("x_min"), NodalInterface("x_max")],
            {"supports": [SymmetryPlane("y_min", (0, 1, 0))]},
            "'x_max' shares nodes with symmetry plane",
        ),
    ],
)
def test_what_does_not_fit(interfaces, options, message):
    with pytest.raises(InterfaceError, match=message):
        bar(*interfaces, **options)


def test_what_knows_no_nodal_interfaces():
    model = bar(Interface("x_min"), NodalInterface("x_max"))
    with pytest.raises(ReductionError, match=r"nodal interfaces.*has no free"):
        craig_bampton(model, modes=Truncation(2, free=True), frame="x_min")
    with pytest.raises(ReductionError, match="nodal interfaces, as 'x_max', are those of a part at rest"):
        prestressed(model, frame="x_min", forces={"x_min": (0.0,) * 6})
    with pytest.raises(ReductionError, match="buckling takes no nodal interfaces"):
        linear_buckling(model, clamped=["x_min"], acceleration=(1.0, 0, 0))
    mesh = meshes.block(HALF, 0.05, 0.04, divisions=(1, 1, 1))
    with pytest.raises(InterfaceError, match=r"for reductions of a ContinuumModel.*write Interface\('x_max'\)"):
        NonlinearModel(mesh, solid_linear, STEEL, degree=1, interfaces=[NodalInterface("x_max")])
    with pytest.raises(InterfaceError, match="interface 'x_max' is nodal and carries no frame"):
        craig_bampton(model, modes=2, frame="x_max")


def test_so_many_nodes_that_nothing_is_reduced():
    model = bar(NodalInterface("x_min"), divisions=(1, 12, 12))
    with pytest.raises(ReductionError, match=r"keep 507 dofs: .* would have 2\.6e\+05 numbers, and that of"):
        craig_bampton(model, modes=2)
