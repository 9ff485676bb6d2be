"""Hot spots of a run against the stress of every node at every instant."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
INSTANTS = np.linspace(0.0, 0.4, 700)


@pytest.fixture(scope="module")
def swung():
    mesh = meshes.block(0.6, 0.03, 0.02, divisions=(16, 2, 2), comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    record = craig_bampton(model, modes=6, frame="x_min", keep=Keep(stress=True, modes=True))
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    rod = scene.add(fm.FlexibleBody(record), name="rod")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rod.frame("x_min"))
    tip = scene.add(fm.RigidBody(mass=0.7, inertia=(1e-3, 2e-3, 2e-3)), name="tip")
    scene.connect(fm.joint.Fixed(), rod.frame("x_max"), tip.frame())
    return scene.simulate(t_end=0.4, rtol=1e-4), rod, model


def everything(run, rod, measure, *, clearance=True):
    """(nt, k) the measure of all nodes, and their numbers."""
    stress = rod.record.stress
    rows = np.flatnonzero(stress.interface < 0) if clearance else np.arange(len(stress.node))
    six = np.einsum("kcn,tn->tkc", stress.sigma[rows], rod.record.strained(run.q(rod, t=INSTANTS)))
    tensor = six[..., [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    principal = np.linalg.eigvalsh(tensor)
    if measure is fm.StressMeasure.VON_MISES:
        a, b, c = np.moveaxis(principal, -1, 0)
        return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2), stress.node[rows]
    return (principal[..., 2] if measure is fm.StressMeasure.TENSION else -principal[..., 0]), stress.node[rows]


@pytest.mark.parametrize("measure", fm.StressMeasure)
@pytest.mark.parametrize("clearance", [0.0, None])
def test_every_node_at_every_instant(swung, measure, clearance):
    run, rod, _ = swung
    values, numbers = everything(run, rod, measure, clearance=clearance is not None)
    found = fm.hot_spots(run, rod, measure=measure, count=12, clearance=clearance, t=INSTANTS)
    peaks = np.sort(values.max(axis=0))[::-1][:12]
    sign = -1.0 if measure is fm.StressMeasure.COMPRESSION else 1.0
    assert [sign * one.stress for one in found] == pytest.approx(peaks, rel=1e-10)
    for one in found:
        i, k = np.argmin(abs(INSTANTS - one.t)), np.flatnonzero(numbers == one.node)[0]
        assert values[i, k] == pytest.approx(sign * one.stress, rel=1e-10)
    assert len({one.node for one in found}) == 12
    assert str(found[0]).startswith(measure.value)


def test_the_models_own_stress_there(swung):
    run, rod, model = swung
    worst = fm.hot_spots(run, rod, measure=fm.StressMeasure.TENSION)[0]
    field = model.stress_field(rod.record, rod.record.strained(run.q(rod, t=[worst.t]))[0])
    k = np.flatnonzero(field.node == worst.node)[0]
    assert np.linalg.eigvalsh(field.stress[k])[2] == pytest.approx(worst.stress, rel=1e-9)


def test_where(swung):
    run, rod, _ = swung
    outer = fm.hot_spots(run, rod, where=lambda x: x[0] > 0.3)[0]
    assert 0.3 < outer.x[0] < 0.6
    assert outer.stress < fm.hot_spots(run, rod)[0].stress


def test_wrong_arguments(swung):
    run, rod, _ = swung

    def refused(what, body=rod, **changed):
        with pytest.raises(SceneError, match=what):
            fm.hot_spots(run, body, **changed)

    refused("FlexibleBody", body="rod")
    refused("StressMeasure", measure="von Mises")
    refused("count must be", count=0)
    refused("clearance must be", clearance=-1.0)
    refused("no node is left", where=lambda x: x[0] > 1.0)
    refused("no instant is left", t=[])
    refused("`where` raised", where=lambda x: x[7])
