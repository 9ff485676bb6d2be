"""Exudyn reads our file, computes the same arrays from the same elements, and moves as we do."""

import re
import sys
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from exported_bodies import damped_rod, soft_bar
from mutations import survive
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.record.point_masses import point_masses
from flexmbd.record.reduced_body import InterfaceFrame

exudyn = pytest.importorskip("exudyn", reason="Exudyn is not installed: pip install exudyn")
from exudyn import itemInterface as item  # noqa: E402
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
GRAVITY = (-2.0, -6.0, -7.0)


def loaded(path):
    """The file as Exudyn reads it."""
    found = ObjectFFRFreducedOrderInterface()
    found.LoadFromFile(str(path))
    return found


def computed(x, phi, mass, stiffness):
    """What Exudyn computes itself of nodes, modes and full matrices."""
    mesh = FEMinterface()
    mesh.nodes = {"Position": x}
    mesh.massMatrix, mesh.stiffnessMatrix = mass, stiffness
    mesh.modeBasis = {"matrix": phi.reshape(3 * len(x), -1), "type": "HCBmodes"}
    return ObjectFFRFreducedOrderInterface(mesh)


def assert_same_arrays(found, wanted):
    """Each array of the two, to 1e-12 of its largest entry."""
    skipped = ("trigList", "postProcessingModes", "rigidBodyNodeType")
    for key, right in wanted.GetDictionary().items():
        if key not in skipped:
            array = np.asarray(found.GetDictionary()[key], dtype=float)
            np.testing.assert_allclose(array, right, rtol=0.0, atol=1e-12 * np.abs(right).max(), err_msg=key)
    assert str(found.rigidBodyNodeType) == str(wanted.rigidBodyNodeType)


@cache
def block():
    """A block, reduced, with its full matrices (3 k, 3 k) in the order of the record's nodes."""
    import scipy.sparse

    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import Keep, craig_bampton

    rubber = solid_linear.Parameters(E=4.4e7, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.1, 0.2, divisions=(3, 1, 1))
    model = ContinuumModel(mesh, solid_linear, rubber, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    body = craig_bampton(model, modes=4, frame="x_min", geometric_stiffness=False, keep=Keep(modes=True))
    x = np.array(model.node_x)
    order = np.lexsort(np.round(x, 9).T)[np.argsort(np.lexsort(np.round(body.modes.x, 9).T))]
    assert np.abs(x[order] - body.modes.x).max() < 1e-12
    rows = model.displacement_dofs.reshape(-1, 3)[order].ravel()

    def full(matrix):
        indptr, indices, values = matrix.getValuesCSR()
        return scipy.sparse.csr_matrix((values, indices, indptr))[rows][:, rows]

    return body, full(model.M), full(model.K)


def test_arrays_equal_those_of_the_finite_elements(tmp_path):
    body, mass, stiffness = block()
    fm.export.exudyn(body, tmp_path / "block.npz")
    found = loaded(tmp_path / "block.npz")
    wanted = computed(body.modes.x, body.modes.phi, mass, stiffness)
    k = len(body.modes.x)
    assert np.array_equal(found.xRef[: 3 * k], wanted.xRef)
    assert np.array_equal(found.modeBasis[: 3 * k], wanted.modeBasis)
    # what Exudyn computes of the added nodes too is compared below
    found.xRef, found.modeBasis, found.nNodes = wanted.xRef, wanted.modeBasis, wanted.nNodes
    assert_same_arrays(found, wanted)


def test_arrays_equal_those_of_the_fictitious_points(tmp_path):
    """And Exudyn does not mind that frames and centre are nodes without mass."""
    from scipy import sparse

    body = damped_rod()
    fm.export.exudyn(body, tmp_path / "rod.npz", lossy=True)
    found = loaded(tmp_path / "rod.npz")
    masses = np.zeros(found.nNodes)
    points = point_masses(body).mass
    masses[: len(points)] = points
    assert found.nNodes == len(points) + 2 * 4 + 1
    mass = sparse.diags(np.repeat(masses, 3)).tocsr()
    wanted = computed(found.xRef.reshape(-1, 3), found.modeBasis, mass, sparse.csr_matrix(mass.shape))
    wanted.stiffnessMatrixReduced = np.diag(body.stiffness)
    assert_same_arrays(found, wanted)


def test_no_pickle_and_the_surface(tmp_path):
    body = soft_bar()
    assert fm.export.exudyn(body, tmp_path / "bär.npz") == ("stiffening by load and by spinning",)
    with zipfile.ZipFile(tmp_path / "bär.npz") as archive:
        for member in archive.namelist():
            assert b"'descr': '|O'" not in archive.read(member), member
    found = loaded(tmp_path / "bär.npz")
    x = found.xRef.reshape(-1, 3)
    assert np.array_equal(x[np.array(found.trigList)], body.surface.x[body.surface.triangle])
    assert found.nNodes == len(body.modes.x) + 2 * 4 + 1  # each vertex is a node of the mesh


def machine(body, **options):
    """A system of Exudyn, the marker of its ground, and the body."""
    mbs = exudyn.SystemContainer().AddSystem()
    ground = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround())))
    return mbs, ground, fm.export.add_to_exudyn(mbs, body, **options)


def sensor(mbs, marker, kind):
    return mbs.AddSensor(
        item.SensorMarker(markerNumber=marker, outputVariableType=kind, storeInternal=True, writeToFile=False)
    )


@pytest.mark.parametrize("make", [soft_bar, damped_rod])
def test_markers_have_position_and_rotation_of_the_frames(make):
    """A frame turned by 0.4 rad is where R = exp(theta) puts it, from the record and from a file's nodes."""
    body = make()
    frame = body.interfaces[1]
    mbs, _, added = machine(body, position=(1.0, 2.0, 3.0))
    q = np.random.default_rng(1).normal(size=body.n_modes) / np.sqrt(body.stiffness)
    q *= 0.4 / np.linalg.norm(frame.modes[3:] @ q)
    mbs.SetNodeParameter(added.modal_node, "initialCoordinates", q)
    place = sensor(mbs, added.markers[frame.name], exudyn.OutputVariableType.Position)
    turn = sensor(mbs, added.markers[frame.name], exudyn.OutputVariableType.RotationMatrix)
    middle = sensor(mbs, added.centre, exudyn.OutputVariableType.Position)
    start = sensor(mbs, added.markers[body.frame], exudyn.OutputVariableType.Position)
    mbs.Assemble()
    np.testing.assert_allclose(mbs.GetSensorValues(start), (1.0, 2.0, 3.0), atol=1e-14)
    np.testing.assert_allclose(
        mbs.GetSensorValues(place), frame.p_BI_B + frame.modes[:3] @ q + (1.0, 2.0, 3.0), rtol=0.0, atol=1e-13
    )
    R = np.reshape(mbs.GetSensorValues(turn), (3, 3))
    np.testing.assert_allclose(R, Rotation.from_rotvec(frame.modes[3:] @ q).as_matrix(), rtol=0.0, atol=1e-12)
    shift = np.einsum("ia,i->a", body.gram[0, 4:].reshape(-1, 3), q) / body.mass
    np.testing.assert_allclose(mbs.GetSensorValues(middle), body.com + shift + (1.0, 2.0, 3.0), rtol=0.0, atol=1e-13)


def floppy_bar(n=12):
    """The bar of a fifth of its stiffness, its lowest modes, without stretch, which Exudyn does not know."""
    bar = soft_bar()
    return fm.ReducedBody(
        gram=bar.gram[: 4 + 3 * n, : 4 + 3 * n],
        stiffness=bar.stiffness[:n] / 5.0,
        damping=np.zeros((n, n)),
        interfaces=tuple(replace(frame, modes=frame.modes[:, :n]) for frame in bar.interfaces),
        frame="x_min",
        partition=np.eye(n),
        partition_names=bar.partition_names[:n],
        modes=replace(bar.modes, phi=bar.modes.phi[:, :, :n]),
    )


LOAD, LOAD_AT = 0.3, np.array([0.02, 0.05, -0.03])  # kg, m from the bar's end
INERTIA = (1e-3, 2e-3, 1.5e-3)
SPIN = (3.0, -2.0, 4.0)  # rad/s


def our_run(body, *, end, spin):
    """Trajectory, the frame at the bar's end, and the largest displacement of it against the body."""
    scene = fm.System(gravity=GRAVITY if spin else (0.0, 0.0, -9.81))
    bar = scene.add(fm.FlexibleBody(body), name="bar")
    joint = fm.joint.Spherical() if spin else fm.joint.Revolute("y")
    hinge = scene.connect(joint, scene.ground.frame(), bar.frame("x_min"))
    if spin:
        hinge.velocity = SPIN
        load = scene.add(fm.RigidBody(LOAD, INERTIA, com=tuple(LOAD_AT)), name="load")
        scene.connect(fm.joint.Spherical(), bar.frame("x_max"), load.frame())
    run = scene.simulate(end, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    q = run.q(bar)
    return run, bar.frame("x_max"), np.linalg.norm(q @ body.interface("x_max").modes[:3].T, axis=1).max()


def exudyn_run(body, *, end, spin, h, trap=False):
    """Positions of the bar's end at 11 instants."""
    from exudyn.utilities import RigidBodyInertia

    gravity = GRAVITY if spin else (0.0, 0.0, -9.81)
    mbs, ground, added = machine(
        body, gravity=(0.0, 0.0, 0.0) if trap else gravity, angular_velocity=SPIN if spin else (0.0, 0.0, 0.0)
    )
    if trap:
        whole = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=added.object))
        mbs.AddLoad(item.LoadMassProportional(markerNumber=whole, loadVector=gravity))
    axes = [1, 1, 1, 0, 0, 0] if spin else [1, 1, 1, 1, 0, 1]
    mbs.AddObject(item.GenericJoint(markerNumbers=[ground, added.markers["x_min"]], constrainedAxes=axes))
    if spin:
        tensor = RigidBodyInertia(mass=LOAD, com=LOAD_AT, inertiaTensor=np.diag(INERTIA), inertiaTensorAtCOM=True)
        load = mbs.CreateRigidBody(
            inertia=tensor,
            referencePosition=list(body.interface("x_max").p_BI_B),
            initialVelocity=list(np.cross(SPIN, body.interface("x_max").p_BI_B)),
            initialAngularVelocity=list(SPIN),
            gravity=list(gravity),
        )
        held = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=load))
        mbs.AddObject(item.GenericJoint(markerNumbers=[added.markers["x_max"], held], constrainedAxes=axes))
    place = sensor(mbs, added.markers["x_max"], exudyn.OutputVariableType.Position)
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime, integration.verboseMode = round(end / h), end, 0
    integration.newton.relativeTolerance = integration.newton.absoluteTolerance = 1e-10
    integration.generalizedAlpha.spectralRadius = 0.9
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = end / 10.0
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.GeneralizedAlpha)
    return mbs.GetSensorStoredData(place)


@pytest.mark.parametrize("spin", [False, True], ids=["pendulum", "spin"])
def test_moves_as_we_do(spin):
    """What is left at h -> 0 is below 1e-7 m: under weight about a hinge, and on a ball joint with a load."""
    body, end = floppy_bar(), 0.24
    run, tip, bend = our_run(body, end=end, spin=spin)
    assert bend > 0.1
    coarse, fine = (exudyn_run(body, end=end, spin=spin, h=h) for h in (4e-4, 2e-4))
    right = run.position(tip, t=fine[:, 0])
    errors = [np.abs(found[:, 1:] - right).max() for found in (coarse, fine)]
    assert errors[0] > 3.0 * errors[1]
    assert np.abs((4.0 * fine - coarse)[:, 1:] / 3.0 - right).max() < 1e-7


@cache
def floating_block():
    """A soft block whose body frame floats on the mean axis."""
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    rubber = solid_linear.Parameters(E=1e6, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.1, 0.2, divisions=(3, 1, 1))
    model = ContinuumModel(mesh, solid_linear, rubber, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    return craig_bampton(model, modes=2, frame=None, geometric_stiffness=False)


def test_a_floating_body_tumbles_as_here():
    """In free flight, about no principal axis, under a force on one end that bends it."""
    body, end, push = floating_block(), 0.24, (0.0, 120.0, -180.0)
    scene = fm.System()
    block = scene.add(fm.FlexibleBody(body), name="block")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), block.frame())
    flight.velocity = (0.1, 0.2, -0.3, *SPIN)
    scene.add_force(fm.force.FrameForce(block.frame("x_min"), force=push))
    run = scene.simulate(end, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    found = []
    for h in (2e-4, 1e-4):
        mbs, _, added = machine(body, velocity=(0.1, 0.2, -0.3), angular_velocity=SPIN)
        mbs.AddLoad(item.LoadForceVector(markerNumber=added.markers["x_min"], loadVector=push))
        place = sensor(mbs, added.markers["x_max"], exudyn.OutputVariableType.Position)
        mbs.Assemble()
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = round(end / h), end
        settings.timeIntegration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = end / 10.0
        mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
        found.append(mbs.GetSensorStoredData(place))
    ends = body.interface("x_max").modes[:3] - body.interface("x_min").modes[:3]
    assert np.linalg.norm(run.q(block) @ ends.T, axis=1).max() > 0.02
    right = run.position(block.frame("x_max"), t=found[1][:, 0])
    assert np.abs((4.0 * found[1] - found[0])[:, 1:] / 3.0 - right).max() < 1e-7


def test_moments_are_taken_by_the_markers_own_axes():
    """What docs/export/exudyn.md says of moments: the virtual rotation of a turned marker is T(theta)' for T(theta).

    A marker's moment does work on the modes of a clamped bar, whose accelerations show it.
    """
    body = soft_bar()
    frame = body.interface("x_max")
    q = np.random.default_rng(1).normal(size=body.n_modes) / np.sqrt(body.stiffness)
    q *= 0.4 / np.linalg.norm(frame.modes[3:] @ q)
    moment, h = np.array([10.0, -20.0, 30.0]), 1e-8

    def acceleration(*, loaded):
        mbs, ground, added = machine(body)
        mbs.AddObject(item.GenericJoint(markerNumbers=[ground, added.markers["x_min"]], constrainedAxes=[1] * 6))
        mbs.SetNodeParameter(added.modal_node, "initialCoordinates", q)
        if loaded:
            mbs.AddLoad(item.LoadTorqueVector(markerNumber=added.markers["x_max"], loadVector=moment))
        mbs.Assemble()
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = 1, h
        settings.timeIntegration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False
        mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
        return mbs.GetNodeOutput(added.modal_node, exudyn.OutputVariableType.Coordinates_t) / h

    found = acceleration(loaded=True) - acceleration(loaded=False)
    angle = np.linalg.norm(frame.modes[3:] @ q)
    x, y, z = frame.modes[3:] @ q
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    tangent = np.eye(3) + (1 - np.cos(angle)) / angle**2 * turn + (angle - np.sin(angle)) / angle**3 * turn @ turn
    right, theirs = frame.modes[3:].T @ tangent.T @ moment, frame.modes[3:].T @ tangent @ moment
    np.testing.assert_allclose(found, theirs, rtol=0.0, atol=1e-7 * np.abs(right).max())
    assert np.abs(found - right).max() > 0.1 * np.abs(right).max()


def test_weight_acts_on_the_deformed_body():
    """Exudyn's own gravity of such a body is off by more than any step explains."""
    body = floppy_bar()
    run, tip, _ = our_run(body, end=0.25, spin=False)
    found = [exudyn_run(body, end=0.25, spin=False, h=5e-4, trap=trap) for trap in (False, True)]
    errors = [np.abs(rows[:, 1:] - run.position(tip, t=rows[:, 0])).max() for rows in found]
    assert errors[0] < 1e-5
    assert errors[1] > 1e-4


def test_damping_acts_whole(tmp_path):
    """A clamped bar with a full damping matrix rings down as the matrix exponential of its equations says."""
    from scipy.linalg import expm

    body = soft_bar()
    n = body.n_modes
    factor = np.random.default_rng(2).normal(size=(n, n)) * body.stiffness**0.25 / 3.0
    body = replace(body, damping=factor.T @ factor)
    fm.export.exudyn(body, tmp_path / "bar.npz", lossy=True)
    mbs, ground, added = machine(tmp_path / "bar.npz")
    mbs.AddObject(item.GenericJoint(markerNumbers=[ground, added.markers["x_min"]], constrainedAxes=[1] * 6))
    q = np.zeros(n)
    q[:2] = 0.1
    mbs.SetNodeParameter(added.modal_node, "initialCoordinates", q)
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = 1000, 0.2
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(body.stiffness), -body.damping]])
    right = (expm(0.2 * matrix) @ np.concatenate([q, np.zeros(n)]))[:n]
    found = mbs.GetNodeOutput(added.modal_node, exudyn.OutputVariableType.Coordinates)
    undamped = q[:2] * np.cos(0.2 * np.sqrt(body.stiffness[:2]))
    assert np.abs(right[:2] - undamped).max() > 1e-2
    np.testing.assert_allclose(found, right, rtol=0.0, atol=2e-5)


def test_damping_is_mapped_or_refused(tmp_path):
    body = soft_bar()
    proportional = replace(body, damping=np.diag(0.25 + 2e-4 * body.stiffness))
    (*_, hint) = fm.export.exudyn(proportional, tmp_path / "bar.npz")
    told = dict(word.strip(",").split("=") for word in hint.split() if "=" in word)
    assert float(told["massProportionalDamping"]) == pytest.approx(0.25, rel=1e-9)
    assert float(told["stiffnessProportionalDamping"]) == pytest.approx(2e-4, rel=1e-12)
    (tmp_path / "rod.npz").write_text("old")
    with pytest.raises(ExportError, match=r"lost would be the damping matrix.*lossy=True"):
        fm.export.exudyn(damped_rod(), tmp_path / "rod.npz")
    assert (tmp_path / "rod.npz").read_text() == "old"
    assert "the damping matrix" in fm.export.exudyn(damped_rod(), tmp_path / "rod.npz", lossy=True)


def rigid():
    """The bar without its modes."""
    body = soft_bar()
    frames = tuple(InterfaceFrame(f.name, f.p_BI_B, f.R_BI, np.zeros((6, 0))) for f in body.interfaces)
    return fm.ReducedBody(
        gram=body.gram[:4, :4], stiffness=[], damping=np.zeros((0, 0)), interfaces=frames, frame="x_min",
        partition=np.zeros((0, 0)), partition_names=(),
    )  # fmt: skip


def test_exudyn_is_asked_for_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(ExportError, match=r"Exudyn cannot be imported \(.*\): pip install exudyn"):
        fm.export.add_to_exudyn(None, soft_bar())


def test_a_rigid_body_is_refused(tmp_path):
    with pytest.raises(ExportError, match=r"this one has 0 modes and 2.64 kg: make a rigid body there"):
        fm.export.exudyn(rigid(), tmp_path / "rigid.npz")
    assert not (tmp_path / "rigid.npz").exists()


@pytest.mark.parametrize("make", [soft_bar, damped_rod])
def test_all_that_we_write_comes_back(tmp_path, make):
    body = make()
    fm.export.exudyn(body, tmp_path / "body.npz", lossy=True)
    back = fm.export.read_exudyn(tmp_path / "body.npz")
    for item_ in ("stiffness", "damping", "partition", "partition_names", "p_MB_M", "R_MB", "frame"):
        assert np.array_equal(getattr(back, item_), getattr(body, item_)), item_
    np.testing.assert_allclose(back.gram, body.gram, rtol=0.0, atol=1e-15 * np.abs(body.gram).max())
    for there, here in zip(back.interfaces, body.interfaces, strict=True):
        assert there.name == here.name
        assert np.array_equal(there.R_BI, here.R_BI)
        np.testing.assert_allclose(there.p_BI_B, here.p_BI_B, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(there.modes, here.modes, rtol=0.0, atol=1e-13 * np.abs(here.modes).max(initial=1.0))
    if body.modes is None:
        assert back.modes is None
        assert back.surface is None
    else:
        for item_ in ("node", "x", "phi"):
            assert np.array_equal(getattr(back.modes, item_), getattr(body.modes, item_)), item_
        assert np.array_equal(back.surface.phi[back.surface.triangle], body.surface.phi[body.surface.triangle])


def test_reads_what_exudyn_wrote_itself(tmp_path):
    """Its own modes, in no normal form, and frames by their nodes: frequencies and mass are those of our reduction."""
    body, mass, stiffness = block()
    change = np.random.default_rng(3).normal(size=(body.n_modes, body.n_modes))
    theirs = computed(body.modes.x, body.modes.phi @ change, mass, stiffness)
    theirs.SaveToFile(str(tmp_path / "block.npz"))
    ends = {name: np.flatnonzero(np.abs(body.modes.x[:, 0] - at) < 1e-9).tolist() for name, at in (("a", 0), ("b", 1))}
    back = fm.export.read_exudyn(tmp_path / "block.npz", interfaces=ends)
    np.testing.assert_allclose(back.frequencies(), body.frequencies(), rtol=1e-9)
    np.testing.assert_allclose(back.frequencies(["a"]), body.frequencies(["x_min"]), rtol=1e-9)
    np.testing.assert_allclose(back.frequencies(["a", "b"]), body.frequencies(["x_min", "x_max"]), rtol=1e-7)
    np.testing.assert_allclose(back.inertia, body.inertia, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(back.modal_mass(), np.eye(body.n_modes), rtol=0.0, atol=1e-10)


def rewritten(source, path, **changed):
    """The file with other members."""
    with np.load(source, allow_pickle=False) as file:
        np.savez(path, **{**file, **changed})
    return path


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"infoList": np.array([10**9, 57, 3, 4, 7, 19])}, "claims 1000000000 modes"),
        ({"infoList": np.array([12, 10**9, 3, 4, 7, 19])}, r"xRef is float64 \(147,\), expected numbers \(3"),
        ({"infoList": np.array([0, 49, 3, 4, 7, 7])}, "claims 0 modes"),
        ({"infoList": np.zeros(0, dtype=int)}, "does not hold the arrays"),
        ({"xRef": np.full(147, np.nan)}, "xRef holds values that are not finite"),
        ({"xRef": np.zeros(144)}, r"xRef is float64 \(144,\)"),
        ({"chiU": np.array(["a", "b", "c"])}, "chiU is <U1"),
        ({"stiffnessMatrixReduced": np.zeros((12, 12))}, "rigid motions"),
        ({"massMatrixReduced": np.zeros((12, 12))}, "not positive definite"),
        ({"trigList": np.array([[0, 1, 1000]])}, "names nodes 0 to 1000, and there are 49"),
        ({"trigList": np.zeros((1, 4), dtype=int)}, r"trigList is int64 \(1, 4\)"),
        ({"flexmbd interface nodes": np.full((2, 4), 3)}, "lie on one line"),
        ({"flexmbd interface nodes": np.full((2, 4), -1)}, "wants three nodes or more from 0 to 48"),
        ({"flexmbd interface nodes": np.zeros((1, 4), dtype=int)}, r"2 frames have nodes \(1, 4\)"),
        ({"flexmbd interface names": np.array(["a", "a"])}, "two interfaces share a name"),
        ({"flexmbd frame": np.array("hub")}, "'hub' is not among"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told(tmp_path, changed, says):
    fm.export.exudyn(damped_rod(), tmp_path / "rod.npz", lossy=True)
    path = rewritten(tmp_path / "rod.npz", tmp_path / "wröng.npz", **changed)
    with pytest.raises(ExportError, match=says) as caught:
        fm.export.read_exudyn(path)
    assert "wröng.npz" in str(caught.value)


def test_another_archive_is_told(tmp_path):
    fm.export.npz(damped_rod(), tmp_path / "rod.npz")
    with pytest.raises(ExportError, match="is not a reduced body of Exudyn: it lacks infoList"):
        fm.export.read_exudyn(tmp_path / "rod.npz")


def test_the_page_is_true(tmp_path, monkeypatch):
    """The snippets of docs/export/exudyn.md, one after the other."""
    monkeypatch.chdir(tmp_path)
    soft_bar().save("bar.h5")
    page = (Path(__file__).parents[2] / "docs" / "export" / "exudyn.md").read_text()
    fm.export.exudyn(soft_bar(), "bar.npz")
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block, names)
    assert set(names["added"]) >= {"nRigidBody", "oFFRFreducedOrder"}


def test_damaged_files(tmp_path):
    fm.export.exudyn(damped_rod(), tmp_path / "rod.npz", lossy=True)
    data = (tmp_path / "rod.npz").read_bytes()
    assert survive(fm.export.read_exudyn, tmp_path / "x.npz", data, count=1500) < 300
