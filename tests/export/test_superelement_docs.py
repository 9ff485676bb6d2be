"""The pages on superelements and on importing: their code runs, and their figures on large motions are true."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from exported_bodies import damped_rod, soft_bar

import flexmbd as fm

DOCS = Path(__file__).parents[2] / "docs"


def run(page, **names):
    text = (DOCS / page).read_text(encoding="utf-8")
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        exec(block, names)
    return names


def two_boxes():
    """Four springs a pair of nodes between two faces: a free body, enough for the page's code."""
    corners = np.array([(x, y, z) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.1) for z in (0.0, 0.1)])
    K = np.zeros((36, 36))
    for i in range(12):
        for j in range(i):
            line = (corners[j] - corners[i]) / np.linalg.norm(corners[j] - corners[i])
            pull = np.zeros(36)
            pull[3 * i : 3 * i + 3], pull[3 * j : 3 * j + 3] = -line, line
            K += 1e5 * np.outer(pull, pull)
    return np.column_stack([np.arange(1, 13), corners]), K, 0.25 * np.eye(36)


def test_the_code_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    damped_rod().save("rod.h5")
    nodes, K, M = two_boxes()
    np.savetxt("nodes.csv", nodes, delimiter=",")
    for name, matrix in (("k.mtx", K), ("m.mtx", M)):
        scipy.io.mmwrite(name, scipy.sparse.coo_array(matrix), symmetry="symmetric", precision=17)
    run("export/superelement.md")
    run("export/openfast.md")
    names = run("import.md")
    assert names["own"].frame == "big_end"
    np.testing.assert_allclose(names["rod"].frequencies(["pin"]), damped_rod().frequencies(["small_end"]), rtol=1e-8)
    np.testing.assert_allclose(names["body"].mass, 3.0, rtol=1e-12)


def end(body):
    """(nt, 3) where the far end of a pendulum is, falling for 0.3 s from the horizontal."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    flexible = scene.add(fm.FlexibleBody(body), name="body")
    near, far = (frame.name for frame in body.interfaces)
    scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), flexible.frame(near))
    with pytest.warns(fm.RangeWarning, match="no stiffening by the tension"):  # the record has none, as files have none
        trajectory = scene.simulate(t_end=0.3, h=1e-3)
    return trajectory.position(flexible.frame(far))


def test_large_motions_of_a_body_that_comes_back(tmp_path):
    """A bar that bends by a tenth of its length: what a superelement does not say costs less than a thousandth."""
    bar = dataclasses.replace(soft_bar(), stretch=None, geometric=None)
    fm.export.op4(bar, tmp_path / "bar.op4")
    found, wanted = end(fm.export.read_op4(tmp_path / "bar.op4")), end(bar)
    assert abs(wanted - wanted[0]).max() > 0.1
    assert 1e-6 < abs(found - wanted).max() < 1e-3
