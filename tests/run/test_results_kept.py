"""Results that are kept: a trajectory's file, its table, momentum and centre of mass."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from spring_interior import ImplicitSprings, as_continuum, chain
from two_crosses_body import two_crosses

import flexmbd as fm
from flexmbd.errors import ExportError, RecordError, SceneError
from flexmbd.files.result_table import ResultTable


def torque(t):
    return 3.0 if t < 0.02 else 0.0


def machine(mass=0.5):
    """A loop of a crank, a flexible rod and a slider, a torque that jumps; and what is asked of it."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.3, (1e-3, 2e-3, 2e-3), (0.05, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.FlexibleBody(two_crosses()), name="rod")
    slider = scene.add(fm.RigidBody(mass, (1e-3, 1e-3, 1e-3)), name="slider")
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame(), name="drive")
    pin = scene.connect(fm.joint.Revolute("z"), crank.frame((0.3, 0.0, 0.0)), rod.frame("A"), name="pin")
    scene.connect(fm.joint.Spherical(), rod.frame("B"), slider.frame(), name="ball")
    scene.connect(fm.joint.Cylindrical("x"), scene.ground.frame(), slider.frame(), name="rail")
    drive.position, drive.velocity = 0.4, 2.0
    scene.add_force(fm.force.JointTorque(drive, fm.Piecewise(torque, [0.02])))
    return scene, rod, drive, pin, slider.frame((0.1, 0.0, 0.0))


@pytest.fixture(scope="module")
def ran():
    scene, rod, drive, pin, tip = machine()
    event = fm.Event(lambda now: now.beta(drive) - 0.45, name="passed")
    run = scene.simulate(0.05, rtol=1e-5, integrator=fm.RadauIIA(), events=[event])
    assert run.events  # else nothing is shown of these
    assert run.departures
    return run, (rod, drive, pin, tip)


def test_a_trajectory_is_read_back_to_the_bit_and_answers_as_before(ran, tmp_path):
    run, (rod, drive, pin, tip) = ran
    path = run.save(tmp_path / "run.h5")
    scene, rod_2, drive_2, pin_2, tip_2 = machine()
    again = fm.Trajectory.load(path, scene)
    for name in ("t", "x", "v", "a", "row_multipliers", "multipliers"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert again.stats == run.stats
    assert again.kept_rows == run.kept_rows
    assert [(one.name, one.t, one.row) for one in again.events] == [(one.name, one.t, one.row) for one in run.events]
    between = np.linspace(0.0, 0.05, 37)
    for name in ("position", "velocity", "acceleration", "rotation"):
        np.testing.assert_array_equal(getattr(again, name)(tip_2, t=between), getattr(run, name)(tip, t=between))
    np.testing.assert_array_equal(again.reaction(pin_2), run.reaction(pin))
    np.testing.assert_array_equal(again.drive(drive_2), run.drive(drive))
    np.testing.assert_array_equal(again.q(rod_2), run.q(rod))
    np.testing.assert_array_equal(again.energy().total, run.energy().total)
    assert repr(again) == repr(run)
    assert run.save(tmp_path / "again.h5").read_bytes() == path.read_bytes()


def test_another_process_reads_the_file_and_its_series_without_flexmbd(ran, tmp_path):
    run, (_, _, _, tip) = ran
    path = run.save(tmp_path / "run.h5")
    code = f"""
import h5py, numpy as np
with h5py.File({str(path)!r}) as file:
    names = [name.decode() for name in file["series/names"][()]]
    units = [unit.decode() for unit in file["series/units"][()]]
    k = names.index("slider.x")
    assert units[k] == "m", units[k]
    np.save({str(tmp_path / "x.npy")!r}, file["series/values"][:, k])
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    np.testing.assert_array_equal(np.load(tmp_path / "x.npy"), run.position(tip.body.frame())[:, 0])


def test_a_variant_is_read_with_its_values(tmp_path):
    scene, *_ = machine()
    slider = next(body for body in scene.compile().bodies if body.name == "slider")
    compiled = scene.compile(parameters={"m": fm.parameter.Mass(slider)})
    run = compiled.simulate(0.01, h=1e-3, integrator=fm.GeneralizedAlpha(), m=0.7)
    path = run.save(tmp_path / "run.h5")
    again = fm.Trajectory.load(path, compiled, m=0.7)
    np.testing.assert_array_equal(again.energy().kinetic, run.energy().kinetic)
    for wrong in ({}, {"m": 0.71}):
        with pytest.raises(RecordError, match="another machine"):
            fm.Trajectory.load(path, compiled, **wrong)
    with pytest.raises(SceneError, match="no parameter 'k'"):
        fm.Trajectory.load(path, compiled, k=1.0)


def test_a_body_with_history_is_read_back(tmp_path):
    def hanging():
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body, frames = as_continuum(scene, chain(ImplicitSprings, stiffness=500.0))
        foot = scene.connect(fm.joint.Fixed(), scene.ground.frame(), frames[0], name="foot")
        return scene, body, foot, frames[1]

    scene, body, foot, end = hanging()
    run = scene.simulate(0.02, h=2e-3, integrator=fm.GeneralizedAlpha())
    path = run.save(tmp_path / "run.h5")
    scene, body_2, foot_2, end_2 = hanging()
    again = fm.Trajectory.load(path, scene)
    np.testing.assert_array_equal(again.reaction(foot_2), run.reaction(foot))
    np.testing.assert_array_equal(again.position(end_2), run.position(end))
    assert again.energies(body_2).keys() == run.energies(body).keys()
    for name, series in run.energies(body).items():
        np.testing.assert_array_equal(again.energies(body_2)[name], series)
    with pytest.raises(SceneError, match=r"momentum .* bodies with history"):
        run.momentum()


def test_what_is_no_file_of_this_machine_is_refused(ran, tmp_path):
    run, _ = ran
    path = run.save(tmp_path / "run.h5")
    scene, *_ = machine(mass=0.6)
    with pytest.raises(RecordError, match=r"another machine: .*drive"):
        fm.Trajectory.load(path, scene)
    scene, *_ = machine()
    whole = path.read_bytes()
    for k in range(0, len(whole), len(whole) // 40):
        (tmp_path / "bad.h5").write_bytes(whole[:k] + bytes([whole[k] ^ 0x10]) + whole[k + 1 :])
        with pytest.raises(RecordError, match=r"bad.h5"):
            fm.Trajectory.load(tmp_path / "bad.h5", scene)
    with pytest.raises(RecordError, match="cannot read"):
        fm.Trajectory.load(tmp_path / "none.h5", scene)
    two_crosses().save(tmp_path / "body.h5")
    with pytest.raises(RecordError, match=r"is not a flexmbd trajectory; pass a file that Trajectory.save wrote"):
        fm.Trajectory.load(tmp_path / "body.h5", scene)
    with pytest.raises(SceneError, match=r"machine .*System"):
        fm.Trajectory.load(path, run)
    with pytest.raises(RecordError, match=r"cannot write"):
        run.save(tmp_path / "nowhere" / "run.h5")


def test_the_table_has_names_units_and_what_the_trajectory_tells(ran, tmp_path):
    run, (rod, drive, pin, tip) = ran
    table = run.table(drive, tip, rod, reactions=[pin], energies=True)
    np.testing.assert_array_equal(table.column("t"), run.t)
    np.testing.assert_array_equal(table.column("drive.angle"), run.beta(drive))
    np.testing.assert_array_equal(table.column(f"{tip.label}.vy"), run.velocity(tip)[:, 1])
    np.testing.assert_array_equal(table.column("rod.q2"), run.q(rod)[:, 1])
    np.testing.assert_array_equal(table.column("pin.reaction.fx"), run.reaction(pin)[:, 0])
    np.testing.assert_array_equal(table.column("energy.total"), run.energy().total)
    assert dict(zip(table.names, table.units, strict=True))["drive.angle_rate"] == "rad/s"
    for name in ("run.csv", "run.npz"):
        again = ResultTable.load(table.save(tmp_path / name))
        assert again.names == table.names
        assert again.units == table.units
        np.testing.assert_array_equal(again.values, table.values)
    frame = table.to_pandas()
    assert frame.index.name == "t [s]"
    np.testing.assert_array_equal(frame["drive.angle [rad]"], run.beta(drive))
    assert len(repr(table)) < 300


def test_a_printed_table_shows_rows_under_names_and_units():
    values = np.column_stack([np.arange(12.0), np.linspace(-1.0, 1e6, 12)])
    lines = str(ResultTable(("t", "drive.angle"), ("s", "rad"), values)).splitlines()
    assert lines[0].split() == ["t", "drive.angle"]
    assert lines[1].split() == ["[s]", "[rad]"]
    assert lines[2].split() == ["0", "-1"]
    assert lines[9] == "... 2 more rows ..."
    assert [line.split()[0] for line in lines[10:]] == ["9", "10", "11"]
    assert len({len(line) for line in lines if "more" not in line}) == 1
    whole = str(ResultTable(("t",), ("s",), values[:10, :1]))
    assert [float(line) for line in whole.splitlines()[2:]] == list(range(10))
    names = ("t", *(f"q{k}" for k in range(1, 20)))
    many = str(ResultTable(names, ("1",) * 20, np.zeros((1, 20))))
    assert many.splitlines()[-1] == "and 12 more columns: q8, q9, q10, q11, q12, q13, ..."


def test_all_bodies_in_one_pass_are_told_as_one_by_one(ran):
    run, _ = ran
    for t in (None, np.linspace(0.0, 0.05, 7)):
        whole = run.table(t=t)
        for body in run.bodies.values():
            alone = run.table(body, t=t)
            for name in alone.names:
                np.testing.assert_allclose(whole.column(name), alone.column(name), rtol=1e-13, atol=1e-13)


def test_a_joint_may_be_called_as_a_body_is(tmp_path):
    scene = fm.System()
    kite = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="kite")
    scene.connect(fm.joint.Free(), scene.ground.frame(), kite.frame(), name="kite").velocity = [1.0, 0, 0, 0, 0, 2.0]
    run = scene.simulate(0.1)
    run.save(tmp_path / "run.h5")
    np.testing.assert_array_equal(run.table().column("joint kite.x"), run.table().column("kite.x"))


def test_a_table_at_times_of_ones_own(ran):
    run, (_, drive, pin, _) = ran
    table = run.table(drive, every=0.02)
    np.testing.assert_allclose(table.column("t"), [0.0, 0.02, 0.04, 0.05], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(table.column("drive.angle"), run.beta(drive, t=table.column("t")))
    assert "energy.total" in run.table(t=0.03).names
    assert len(run.table(t=0.03).values) == 1
    for wrong, words in (
        ({"t": 0.01, "every": 0.01}, "t, or every"),
        ({"every": 0.0}, "positive time"),
        ({"every": float("nan")}, "positive time"),
        ({"t": 0.06}, "outside the trajectory"),
    ):
        with pytest.raises(SceneError, match=words):
            run.table(drive, **wrong)
    with pytest.raises(SceneError, match=r"ends of steps"):
        run.table(reactions=[pin], every=0.01)
    with pytest.raises(SceneError, match=r"reactions must be .*Connection, got \['pin'\]"):
        run.table(reactions=["pin"])
    with pytest.raises(RecordError, match=r"path must be a path, got 3"):
        run.save(3)
    with pytest.raises(ExportError, match=r"path .* got 3"):
        run.table(drive).save(3)
    with pytest.raises(SceneError, match=r"two columns would be called 'drive.angle'"):
        run.table(drive, drive)
    with pytest.raises(SceneError, match=r"not of 'drive'"):
        run.table("drive")


def test_a_table_is_the_same_in_blocks(ran, monkeypatch):
    """Ten million rows are made some at a time."""
    run, (rod, drive, _, tip) = ran
    times = np.linspace(0.0, 0.05, 23)
    whole = run.table(drive, tip, rod, energies=True, t=times)
    monkeypatch.setattr("flexmbd.run.series.table_rows._AT_ONCE", 5)
    np.testing.assert_allclose(run.table(drive, tip, rod, energies=True, t=times).values, whole.values, rtol=1e-13)
    with pytest.raises(SceneError, match=r"array \(k,\) of times"):
        run.table(drive, t=[])


def test_a_csv_that_cannot_be_written(ran, tmp_path):
    run, (_, drive, _, _) = ran
    with pytest.raises(ExportError, match="cannot write"):
        run.table(drive).save(tmp_path / "nowhere" / "run.csv")
    with pytest.raises(ExportError, match=r"\.csv or \.npz"):
        run.table(drive).save(tmp_path / "run.xls")


def test_momentum_of_what_flies_and_of_what_hangs(ran):
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    a = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.25), (0.1, 0.0, 0.05)), name="a")
    b = scene.add(fm.FlexibleBody(two_crosses()), name="b")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), a.frame(), name="flight")
    scene.connect(fm.joint.Spherical(), a.frame((0.4, 0.0, 0.0)), b.frame("A"), name="ball")
    flight.velocity = [1.0, 2.0, 3.0, 0.5, -0.4, 0.8]
    run = scene.simulate(0.3, rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    found = run.momentum()
    assert found.mass == 12.0
    t = run.t[:, None]
    g = np.array([0.0, 0.0, -9.81])
    np.testing.assert_allclose(found.linear, found.linear[0] + 12.0 * g * t, atol=1e-6)
    np.testing.assert_allclose(found.centre, found.centre[0] + found.linear[0] / 12.0 * t + 0.5 * g * t**2, atol=1e-7)
    np.testing.assert_allclose(found.spin, np.tile(found.spin[0], (len(t), 1)), atol=1e-6)
    assert abs(found.spin).max() > 0.1
    # what turns about a pin: m r x v of the particles of two crosses, that move as one while nothing stretches
    late = run.momentum(t=0.15)
    np.testing.assert_allclose(late.linear[0], found.linear[0] + 12.0 * g * 0.15, atol=1e-6)
    pendulum = fm.System(gravity=(0.0, 0.0, 0.0))
    bar = pendulum.add(fm.RigidBody(2.0, (0.1, 0.2, 0.25), (0.5, 0.0, 0.0)), name="bar")
    pin = pendulum.connect(fm.joint.Revolute("y"), pendulum.ground.frame(p=(0.0, 1.0, 0.0)), bar.frame(), name="pin")
    pin.velocity = 3.0
    told = pendulum.simulate(0.1).momentum()
    # about the origin: I_yy w along y, and the pin's place times the momentum
    expected = np.array([0.0, (0.2 + 2.0 * 0.25) * 3.0, 0.0]) + np.cross([0.0, 1.0, 0.0], told.linear)
    np.testing.assert_allclose(told.angular, expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(told.linear, axis=1), 2.0 * 0.5 * 3.0, rtol=1e-9)


def test_a_machine_without_mass_has_no_centre():
    scene = fm.System()
    with pytest.raises(SceneError, match="no mass"):
        scene.simulate(0.1).momentum()


@pytest.mark.mpi
def test_two_ranks_write_one_file_and_both_read_it(tmp_path_factory):
    from mpi4py import MPI

    from flexmbd.continuum import MpiTeam

    comm = MPI.COMM_WORLD
    folder = Path(comm.bcast(str(tmp_path_factory.mktemp("kept")) if comm.rank == 0 else None))
    scene, _, drive, *_ = machine()
    scene.team = MpiTeam(comm)
    run = scene.simulate(0.01, h=1e-3, integrator=fm.GeneralizedAlpha())
    path = run.save(folder / "run.h5")
    np.testing.assert_array_equal(fm.Trajectory.load(path, scene).beta(drive), run.beta(drive))
    with pytest.raises(RecordError, match="cannot write"):
        run.save(folder / "nowhere" / "run.h5")
    with h5py.File(path) as file:
        assert file.attrs["format"] == "flexmbd trajectory"
    comm.barrier()


@pytest.mark.mpi
def test_rank_0_saves_alone_and_waits_for_nobody(tmp_path_factory):
    """Also where writing fails; a later run is then saved by all, of which each finds the file."""
    from mpi4py import MPI

    from flexmbd.continuum import MpiTeam

    comm = MPI.COMM_WORLD
    folder = Path(comm.bcast(str(tmp_path_factory.mktemp("alone")) if comm.rank == 0 else None))
    scene, *_ = machine()
    scene.team = MpiTeam(comm)
    run = scene.simulate(0.01, h=1e-3, integrator=fm.GeneralizedAlpha())
    if comm.rank == 0:
        first = run.save(folder / "first.h5")
        np.testing.assert_array_equal(fm.Trajectory.load(first, scene).x, run.x)
        with pytest.raises(RecordError, match="cannot write"):
            run.save(folder / "nowhere" / "run.h5")
    later = scene.simulate(0.02, h=1e-3, integrator=fm.GeneralizedAlpha())
    np.testing.assert_array_equal(fm.Trajectory.load(later.save(folder / "later.h5"), scene).x, later.x)
    comm.barrier()
