"""Full matrices: the same body as reduced from the form, CalculiX's frequencies, MatrixMarket files."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse
from full_model import FullModel
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import NodeSet
from flexmbd.record.reduced_body import ReducedBody

DATA = Path(__file__).parents[1] / "data" / "calculix_block"
# With one end clamped, as CalculiX prints them (Hz).
CLAMPED = [100.0459, 100.0459, 608.5650, 608.5650, 802.7393, 1306.773, 1648.371, 1648.371, 2428.061, 3116.942]


@cache
def block():
    """The CalculiX block, by our assembly; (model, full matrices, node table)."""
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear

    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(10, 2, 2))
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, steel, degree=1, interfaces=ends)
    full = FullModel(model)
    return model, full, np.column_stack([np.arange(1, len(full.x) + 1), full.x])


def faces(table, origins=(None, None)):
    low, high = table[:, 1].min(), table[:, 1].max()
    return {
        name: NodeSet(table[abs(table[:, 1] - x) < 1e-9, 0], origin)
        for name, x, origin in zip(("x_min", "x_max"), (low, high), origins, strict=True)
    }


def responses(body):
    """(n, k) modal coordinates under loads on the interfaces: shapes that do not depend on the basis."""
    loads = np.vstack([frame.modes for frame in body.interfaces if frame.name != body.frame]).T
    return np.hstack([loads / (body.stiffness + shift * body.stiffness[0])[:, None] for shift in (0.0, 1.0, 30.0)])


def seen(body):
    """The Gram matrix of these shapes."""
    shapes = responses(body)
    fields = np.zeros((4 + 3 * body.n_modes, 4 + 3 * shapes.shape[1]))
    fields[:4, :4] = np.eye(4)
    fields[4:, 4:] = np.kron(shapes, np.eye(3))
    return fields.T @ body.gram @ fields


@pytest.mark.parametrize("frame", ["x_min", "x_max", None])
def test_the_body_is_that_of_the_form(frame):
    from flexmbd.reduction import craig_bampton

    model, full, table = block()
    wanted = craig_bampton(model, modes=8, frame=frame, geometric_stiffness=False)
    body = fm.export.reduce_matrices(full.K, full.M, table, interfaces=faces(table), modes=8, frame=frame)
    np.testing.assert_allclose(body.stiffness, wanted.stiffness, rtol=1e-8)
    np.testing.assert_allclose(body.frequencies(["x_min"]), wanted.frequencies(["x_min"]), rtol=1e-8)
    np.testing.assert_allclose(body.p_MB_M, wanted.p_MB_M, atol=1e-10)
    found, right = (
        ReducedBody.from_tree({**one.tree(), "provenance": {}}) for one in (body, _in_order(wanted, body))
    )
    squares = np.diag(seen(right))
    # one size for the three components of a field
    size = np.sqrt(np.append(squares[:1], np.repeat(squares[1:].reshape(-1, 3).sum(axis=1), 3)))
    np.testing.assert_allclose(seen(found) / np.outer(size, size), seen(right) / np.outer(size, size), atol=1e-7)


def _in_order(body, like):
    """The body with its interfaces in another's order."""
    from dataclasses import replace

    return replace(body, interfaces=tuple(body.interface(frame.name) for frame in like.interfaces))


def test_calculix_clamped_frequencies():
    """Fixed-interface modes of one face are all there is: its frequencies are those of the clamped block."""
    _, full, table = block()
    root = {"root": faces(table)["x_min"]}
    body = fm.export.reduce_matrices(full.K, full.M, table, interfaces=root, modes=12, frame="root", keep_modes=True)
    np.testing.assert_allclose(body.frequencies(["root"])[: len(CLAMPED)], CLAMPED, rtol=1e-6)
    np.testing.assert_allclose(body.mass, 78.5, rtol=1e-12)
    at_root = np.isin(body.modes.node, root["root"].nodes)
    assert not np.any(body.modes.phi[at_root])
    tip = body.modes.node == table[abs(table[:, 1:] - table[:, 1:].max(axis=0)).max(axis=1) < 1e-9, 0]
    assert np.any(body.modes.phi[tip])


def test_calculix_condensed_matrices():
    """Twenty-four dofs of another program, whose mass couples the components: what is free of choice is exact."""
    files = ("h8_Kguyan_ccx223.csv", "h8_Mguyan_from_ccx_matrices.csv")
    K, M = (np.loadtxt(DATA / name, delimiter=",") for name in files)
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    table = np.column_stack([np.arange(11, 19), corners])
    root = {"root": NodeSet([11, 12, 13, 14])}
    body = fm.export.reduce_matrices(K, M, table, interfaces=root, modes=12, frame="root")
    expected = np.sqrt(scipy.linalg.eigh(K[12:, 12:], M[12:, 12:], eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(body.frequencies(["root"]), expected, rtol=1e-8)
    assert "completed" in body.provenance["inertia of large motions"]
    both = {"root": NodeSet([11, 12, 13, 14]), "tip": NodeSet([15, 16, 17, 18])}
    stiff = fm.export.reduce_matrices(K, M, table, interfaces=both, modes=0, frame="root")
    assert stiff.n_modes == 6
    np.testing.assert_allclose(stiff.com, [0.5, 0.0, 0.0], atol=1e-8)


def test_damping_and_origins():
    _, full, table = block()
    ends = faces(table, origins=(None, (0.7, 0.0, 0.01)))
    options = dict(interfaces=ends, modes=4, frame="x_min")
    body = fm.export.reduce_matrices(full.K, full.M, table, D=2e-5 * full.K, **options)
    np.testing.assert_allclose(np.diag(body.damping), 2e-5 * body.stiffness, rtol=1e-8)
    np.testing.assert_allclose(body.interface("x_max").p_BI_B, [0.7 - table[:, 1].min(), 0.0, 0.01], atol=1e-12)
    with pytest.raises(ExportError, match="damping resists rigid motions"):
        fm.export.reduce_matrices(full.K, full.M, table, D=full.M, **options)


def test_matrix_market_and_triplets(tmp_path):
    _, full, table = block()
    scipy.io.mmwrite(tmp_path / "k.mtx", full.K.tocoo(), symmetry="symmetric", precision=17)
    found = fm.export.read_matrix_market(tmp_path / "k.mtx")
    assert abs(found - full.K).max() <= 1e-13 * abs(full.K).max()
    K = full.K.tocoo()
    lines = [
        f"{int(table[i // 3, 0])},{i % 3 + 1},{int(table[j // 3, 0])},{j % 3 + 1},{v:.17g}"
        for i, j, v in zip(K.row, K.col, K.data, strict=True)
        if i >= j
    ]
    (tmp_path / "k.txt").write_text("** stiffness\n" + "\n".join(lines))
    found = fm.export.read_triplets(tmp_path / "k.txt", table)
    assert abs(found - full.K).max() <= 1e-9 * abs(full.K).max()
    with pytest.raises(ExportError, match="none of the table's displacements"):
        fm.export.read_triplets(tmp_path / "k.txt", table[:-1])


def test_what_does_not_fit():
    _, full, table = block()
    ends = faces(table)

    def refused(match, K=full.K, M=full.M, table=table, **changes):
        options = {"interfaces": ends, "modes": 2, "frame": "x_min", **changes}
        with pytest.raises(ExportError, match=match):
            fm.export.reduce_matrices(K, M, table, **options)

    refused(r"matrix K is \(297, 296\)", K=full.K[:, :-1])
    refused("matrix K must be one of numbers", K="K.npz")
    refused("not symmetric", K=full.K + scipy.sparse.eye(297, k=1) * 1e9)
    refused("resists rigid motions", K=full.K + scipy.sparse.eye(297) * 1e9)
    refused("node table has the shape", table=table[:, :3])
    refused("each once", table=np.vstack([table[:1], table[:-1]]))
    refused("node 5000 is not in the node table", interfaces={"a": NodeSet([5000])})
    refused("is of two interfaces, 'x_min' and 'b'", interfaces={**ends, "b": NodeSet(ends["x_min"].nodes[:3])})
    refused("in one line", interfaces={"x_min": NodeSet(table[(table[:, 1:3] == table[0, 1:3]).all(axis=1), 0])})
    refused("2 nodes", interfaces={"x_min": NodeSet([1, 2])})
    refused("no interfaces are named", interfaces={})
    refused("no interface 'nose'", frame="nose")
    refused("modes=-1", modes=-1)
    refused("axes are no rotation", interfaces={"x_min": NodeSet(ends["x_min"].nodes, axes=np.zeros((3, 3)))})
    alone = scipy.sparse.block_diag([full.K, full.K]).tocsr(), scipy.sparse.block_diag([full.M, full.M]).tocsr()
    twice = np.vstack([table, table + np.array([1000.0, 5.0, 0.0, 0.0])])
    refused("connected to no interface|held by nothing", *alone, table=twice)


def test_damaged_matrix_market_files(tmp_path):
    random = np.random.default_rng(0)
    a = scipy.sparse.random(12, 12, density=0.3, rng=random).tocoo()
    scipy.io.mmwrite(tmp_path / "a.mtx", a + a.T, symmetry="symmetric")

    def read(path):
        matrix = fm.export.read_matrix_market(path)
        assert np.isfinite(matrix.data).all()
        return small

    from exported_bodies import small_body

    small = small_body()
    dense = np.tril(np.arange(9.0).reshape(3, 3))
    scipy.io.mmwrite(tmp_path / "b.mtx", dense + dense.T, symmetry="symmetric")
    np.testing.assert_array_equal(fm.export.read_matrix_market(tmp_path / "b.mtx").toarray(), dense + dense.T)
    survive(read, tmp_path / "x.mtx", (tmp_path / "a.mtx").read_bytes(), count=2000)
    for text in ("%%MatrixMarket matrix coordinate real general\n9 9 999999999999\n1 1 1.0\n", "", "%%MatrixMarket\n"):
        (tmp_path / "x.mtx").write_text(text)
        with pytest.raises(ExportError, match="no MatrixMarket file"):
            fm.export.read_matrix_market(tmp_path / "x.mtx")
