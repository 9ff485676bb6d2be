"""Full matrices that CalculiX stored: its own displacements, the block's mass, rigid motions; damaged files."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from mutations import mutations

import flexmbd as fm
from flexmbd.errors import ExportError

DATA = Path(__file__).parents[1] / "data" / "calculix_storage"
# Of *STATIC in CalculiX: nodes 11 to 14 held, node 23 pushed by 1000 N along x, node 24 by -500 N along z (m).
DISPLACED = {
    15: (8.090582e-08, 3.276879e-07, 2.266763e-07),
    18: (6.045221e-07, 2.752792e-07, 1.688656e-07),
    21: (4.673731e-07, 5.753288e-07, 2.977267e-07),
    22: (3.869402e-07, -2.618263e-07, -2.351884e-07),
    23: (1.723941e-06, -2.794181e-07, -4.177917e-07),
    24: (1.330580e-06, 6.483905e-07, 7.914975e-08),
}


def node_table():
    lines = (DATA / "beam.inp").read_text().splitlines()
    return np.array([[float(word) for word in line.split(",")] for line in lines[1:13]])


@pytest.fixture(scope="module")
def stored():
    """Node table, stiffness and mass; the table in an order of its own."""
    table = node_table()[::-1]
    return table, *(fm.export.read_matrix_storage(DATA / f"beam.{kind}", table) for kind in ("sti", "mas"))


def test_displacements_are_those_of_calculix(stored):
    table, K, _ = stored
    rows = {int(number): 3 * place for place, number in enumerate(table[:, 0])}
    free = np.array([rows[node] + k for node in rows if node > 14 for k in range(3)])
    force = np.zeros(len(K.toarray()))
    force[rows[23]], force[rows[24] + 2] = 1000.0, -500.0
    moved = np.zeros(len(force))
    moved[free] = np.linalg.solve(K.toarray()[np.ix_(free, free)], force[free])
    found = [moved[rows[node] : rows[node] + 3] for node in DISPLACED]
    np.testing.assert_allclose(found, list(DISPLACED.values()), rtol=1e-6)


def test_the_body_of_them(stored):
    table, K, M = stored
    # the second brick's far face is moved: 0.01 m in x at one corner, 0.02 m in y at the other
    ends = {"foot": fm.export.NodeSet([11, 12, 13, 14]), "head": fm.export.NodeSet([21, 22, 23, 24])}
    body = fm.export.reduce_matrices(K, M, table, interfaces=ends, modes=12, frame="foot")
    assert body.mass == pytest.approx(7850.0 * volume(), rel=1e-9)
    assert body.n_modes == 6 + 12
    assert "inertia of large motions" not in body.provenance  # one mass for all components: exact


def volume():
    """Of the two bricks (m^3), by the map of each brick from the unit cube."""
    places = {int(row[0]): row[1:] for row in node_table()}
    points, weights = np.polynomial.legendre.leggauss(3)
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = np.array([(a, b, c) for c in (-1, 1) for a, b in square])
    total = 0.0
    for nodes in ((11, 12, 13, 14, 15, 16, 17, 18), (15, 16, 17, 18, 21, 22, 23, 24)):
        x = np.array([places[node] for node in nodes])
        for a, wa in zip(points, weights, strict=True):
            for b, wb in zip(points, weights, strict=True):
                for c, wc in zip(points, weights, strict=True):
                    factors = 0.5 * (1.0 + corners * (a, b, c))
                    slopes = np.column_stack(
                        [0.5 * corners[:, k] * np.prod(np.delete(factors, k, axis=1), axis=1) for k in range(3)]
                    )
                    total += wa * wb * wc * np.linalg.det(x.T @ slopes)
    return total


def test_what_is_not_whole_is_refused(tmp_path):
    table, texts = node_table(), {kind: (DATA / f"beam.{kind}").read_text() for kind in ("sti", "dof")}

    def read(nodes=table, **changed):
        for kind, text in (texts | changed).items():
            (tmp_path / f"beam.{kind}").write_text(text)
        return fm.export.read_matrix_storage(tmp_path / "beam.sti", nodes)

    assert abs(read() - fm.export.read_matrix_storage(DATA / "beam.sti", table)).max() == 0.0
    for words, options in {
        "no row for component 3 of node 24": {"dof": texts["dof"].replace("24.3\n", "")},
        "no row for component 1 of node 9": {"nodes": np.vstack([table, (9.0, 0.0, 0.0, 0.0)])},
        "not the displacement of a node": {"nodes": table[:-1]},
        "there twice": {"dof": texts["dof"] + "24.3\n"},
        "cut short": {"sti": texts["sti"][: len(texts["sti"]) // 60 * 30]},
        "upper triangle": {"sti": texts["sti"].replace("1 2 ", "2 1 ", 1)},
        "an entry is there twice": {"sti": texts["sti"] + "36 36 1.0\n"},
        "row column value": {"sti": texts["sti"] + "36\n"},
        "finite": {"sti": texts["sti"].replace("4.9", "nan ", 1).replace("nan 358974358974e+09", "nan", 1)},
    }.items():
        with pytest.raises(ExportError, match=words):
            read(**options)
    (tmp_path / "beam.dof").unlink()
    with pytest.raises(ExportError, match=r"beam\.dof"):
        fm.export.read_matrix_storage(tmp_path / "beam.sti", table)


@pytest.mark.parametrize("kind", ["sti", "dof"])
def test_damaged_files_are_errors_or_matrices(tmp_path, kind):
    table = node_table()
    for name in ("sti", "dof"):
        (tmp_path / f"beam.{name}").write_bytes((DATA / f"beam.{name}").read_bytes())
    for damaged in mutations((DATA / f"beam.{kind}").read_bytes(), count=300):
        (tmp_path / f"beam.{kind}").write_bytes(damaged)
        try:
            found = fm.export.read_matrix_storage(tmp_path / "beam.sti", table)
        except ExportError:
            continue
        assert scipy.sparse.issparse(found)
        assert found.shape == (36, 36)
        assert np.isfinite(found.data).all()
