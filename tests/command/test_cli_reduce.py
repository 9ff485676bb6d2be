"""`flexmbd reduce` and `flexmbd inspect`: the same record as by hand, one clear error for whatever is wrong."""

import re
import subprocess
import sys

import pytest
from two_crosses_body import two_crosses

from flexmbd.cli import main
from flexmbd.record.reduced_body import ReducedBody

STEEL = ("--parameter", "E=2.1e11", "--parameter", "nu=0.3", "--parameter", "rho = 7850")
ENDS = ("--interface", "start", "--interface", "end:averaged")


def test_inspect_prints_the_sheet(tmp_path, capsys):
    two_crosses().save(tmp_path / "a.h5")
    assert main(["inspect", str(tmp_path / "a.h5")]) == 0
    assert capsys.readouterr() == (two_crosses().inspect(), "")


@pytest.mark.parametrize(
    ("content", "message"), [(None, "cannot read .*No such file"), (b"solid", "is not a flexmbd record")]
)
def test_inspect_refuses_in_one_line(tmp_path, capsys, content, message):
    path = tmp_path / "a.h5"
    if content is not None:
        path.write_bytes(content)
    assert main(["inspect", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert re.search(message, err)


def test_inspect_loads_nothing_of_the_continuum(tmp_path):
    two_crosses().save(tmp_path / "a.h5")
    code = "import sys; from flexmbd.cli import main; main(['inspect', sys.argv[1]]); "
    code += "print([name for name in ('dolfinx', 'mpi4py', 'petsc4py', 'gmsh', 'ufl') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a.h5"], capture_output=True, text=True, check=True)
    assert done.stdout == two_crosses().inspect() + "[]\n"


def test_the_module_runs_as_the_command(tmp_path):
    two_crosses().save(tmp_path / "a.h5")
    command = [sys.executable, "-m", "flexmbd", "inspect", tmp_path / "a.h5"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == two_crosses().inspect()


@pytest.fixture
def beam_file(shared_path):
    """A short beam as gmsh writes it. Collective."""
    from mpi4py import MPI

    path = shared_path / "beam.msh"
    if MPI.COMM_WORLD.rank == 0:
        import gmsh

        gmsh.initialize(interruptible=False)  # or Ctrl-C would end the tests on the spot ever after
        gmsh.option.setNumber("General.Terminal", 0)
        box = gmsh.model.occ.addBox(0, 0, 0, 0.4, 0.1, 0.1)
        gmsh.model.occ.synchronize()
        for name, x in (("start", 0.0), ("end", 0.4)):
            faces = gmsh.model.getEntitiesInBoundingBox(x - 1e-6, -1, -1, x + 1e-6, 1, 1, dim=2)
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in faces], name=name)
        gmsh.model.addPhysicalGroup(3, [box], name="beam")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.1)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
        gmsh.finalize()
    MPI.COMM_WORLD.barrier()
    return path


def by_hand(path, **keywords):
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.coupling import Coupling
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    ends = [Interface("start"), Interface("end", coupling=Coupling.AVERAGED)]
    model = ContinuumModel(meshes.read(path), solid_linear, steel, degree=2, interfaces=ends)
    return craig_bampton(model, **keywords)


@pytest.mark.mpi
def test_reduce_writes_the_record_that_a_script_writes(beam_file, capsys):
    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", "solid_linear", *STEEL, *ENDS, "--frame", "start"]
    assert main([*arguments, "--modes", "3", "--keep-modes", "-o", str(output)]) == 0
    out, err = capsys.readouterr()
    from flexmbd.reduction import Keep

    expected = by_hand(beam_file, modes=3, frame="start", keep=Keep(modes=True))
    written = ReducedBody.load(output)
    from mpi4py import MPI

    if MPI.COMM_WORLD.size == 1:
        assert written.fingerprint() == expected.fingerprint()
        assert written.inspect() == expected.inspect()
    # on several ranks MUMPS does not repeat itself to the bit
    assert written.stiffness == pytest.approx(expected.stiffness, rel=1e-9)
    assert abs(written.gram - expected.gram).max() < 1e-9 * abs(expected.gram).max()
    assert abs(written.modes.phi - expected.modes.phi).max() < 1e-7 * abs(expected.modes.phi).max()
    assert written.geometric is not None
    assert written.surface is None
    assert written.provenance["averaged interfaces"] == "end"
    assert err == ""
    lowest = f"{expected.frequencies(['start'])[0]:.6g} Hz"
    assert out == (
        f"{output}: {expected.n_modes} modes, the lowest at {lowest}; `flexmbd inspect {output}` shows it\n"
        if MPI.COMM_WORLD.rank == 0
        else ""
    )


@pytest.mark.mpi
def test_reduce_with_a_floating_frame_a_form_file_and_fewer_groups(beam_file):
    """The form by its path, the mean axis, no geometric stiffness, the surface, a damping ratio."""
    import flexmbd.forms.solid_linear as form

    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", form.__file__, *STEEL, *ENDS, "--floating", "--degree", "1"]
    arguments += ["--modes", "0", "--no-geometric-stiffness", "--keep-surface", "--damping-ratio", "0.03"]
    assert main([*arguments, "-o", str(output)]) == 0
    written = ReducedBody.load(output)
    assert written.frame is None
    assert written.damping.diagonal() == pytest.approx(2 * 0.03 * written.stiffness**0.5, rel=1e-12)
    assert written.geometric is None
    assert written.modes is None
    assert written.surface is not None
    assert written.mass == pytest.approx(0.4 * 0.1 * 0.1 * 7850.0, rel=1e-9)
    assert written.provenance["degree"] == "1"


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("words", "keywords"),
    [
        (["--below-hz", "9e3"], {"below_hz": 9e3}),
        (["--tol", "1e-2"], {"tol": 1e-2}),
        (["--tol", "1e-2", "--below-hz", "1e4"], {"tol": 1e-2, "below_hz": 1e4}),
    ],
)
def test_reduce_by_a_frequency_and_by_a_tolerance(beam_file, words, keywords):
    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", "solid_linear", *STEEL, *ENDS, "--frame", "start"]
    assert main([*arguments, *words, "--no-geometric-stiffness", "-o", str(output)]) == 0
    from flexmbd.reduction import Truncation

    expected = by_hand(beam_file, modes=Truncation(**keywords), frame="start", geometric_stiffness=False)
    written = ReducedBody.load(output)
    assert written.n_modes > 6
    assert written.stiffness == pytest.approx(expected.stiffness, rel=1e-9)
    notes = ("fixed-interface modes", "modes below", "tolerance of eigenvalues", "estimated error of eigenvalues")
    assert [written.provenance.get(note) for note in notes] == [expected.provenance.get(note) for note in notes]


def test_reduce_by_interface_modes_and_free_modes(beam_file, capsys):
    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", "solid_linear", *STEEL, *ENDS, "--frame", "start", "--modes", "3"]
    arguments += ["--no-geometric-stiffness", "-o", str(output)]
    assert main([*arguments, "--free", "--interface-modes", "4"]) == 0
    from flexmbd.reduction import InterfaceModes, Truncation

    keywords = {"modes": Truncation(3, free=True), "frame": "start", "geometric_stiffness": False}
    expected = by_hand(beam_file, **keywords, interface_modes=InterfaceModes(4))
    assert ReducedBody.load(output).stiffness == pytest.approx(expected.stiffness, rel=1e-9)
    assert main([*arguments, "--force", "--residual-vectors", "--interface-tol", "1e-3"]) == 0
    assert "residual vectors" in ReducedBody.load(output).provenance
    assert "interface modes" in ReducedBody.load(output).provenance
    with pytest.raises(SystemExit):
        main([*arguments, "--force", "--joint", "end"])
    assert "goes with --interface-modes" in capsys.readouterr().err


def test_reduce_to_nodes(beam_file, capsys):
    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", "solid_linear", *STEEL, "--modes", "3", "-o", str(output)]
    assert main([*arguments, "--degree", "1", "--interface", "end:nodal", "--interface", "start"]) == 0
    body = ReducedBody.load(output)
    assert (body.frame, body.nodal.names) == ("start", ("end",))
    assert body.partition_names[0] == f"end.{body.nodal.node[0]}.x"
    more = ["--force", "--degree", "1", "--interface", "end:nodal", "--interface", "start", "--interface-modes", "4"]
    assert main([*arguments, *more]) == 0
    body = ReducedBody.load(output)
    assert body.nodal is None
    assert body.partition_names[:4] == tuple(f"interface mode {i}" for i in range(1, 5))
    assert main([*arguments, *more, "--joint", "nowhere"]) != 0


def test_reduce_a_half(beam_file, capsys):
    output = beam_file.with_name("beam.h5")
    arguments = ["reduce", str(beam_file), "--form", "solid_linear", *STEEL, "--interface", "start", "--modes", "3"]
    assert main([*arguments, "--symmetry", "end=x", "--roller", "end=y", "-o", str(output)]) == 0
    said = ReducedBody.load(output).provenance["supports"]
    assert said.startswith("symmetry plane 'end' with normal (1, 0, 0); roller 'end' along (0, 1, 0)")
    assert main([*arguments, "--force", "--symmetry", "end=y", "-o", str(output)]) != 0
    assert "do not lie in a plane of that normal" in capsys.readouterr().err
    assert main([*arguments, "--force", "--roller", "end:y", "-o", str(output)]) != 0
    assert "write NAME=AXIS" in capsys.readouterr().err


GOOD = {
    "--form": ["solid_linear"],
    "--parameter": ["E=2.1e11", "nu=0.3", "rho=7850"],
    "--interface": ["start", "end"],
    "--frame": ["start"],
    "--modes": ["2"],
}


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"--form": ["solid_lnear"]}, "has no 'solid_lnear'"),
        ({"--form": ["nowhere/my_form.py"]}, "my_form.py"),
        ({"--parameter": ["E=2.1e11", "nu=0.3"]}, "has the parameters E, nu, rho, alpha; no rho: give each as"),
        ({"--parameter": ["E=2.1e11", "nu=0.3", "rho=1", "G=1"]}, "unknown G"),
        ({"--parameter": ["E=2.1e11", "nu=0.5", "rho=1"]}, "Poisson's ratio nu must lie between"),
        ({"--parameter": ["E=stiff"]}, "--parameter E=stiff: write NAME=VALUE with a number"),
        ({"--parameter": ["E"]}, "--parameter E: write NAME=VALUE with a number"),
        ({"--parameter": ["=1"]}, "--parameter =1: it has no name"),
        ({"--parameter": ["E=1", "E=2"]}, "--parameter E=2: is given twice"),
        ({"--interface": ["start:averged"]}, "--interface start:averged: write NAME, or NAME:COUPLING"),
        ({"--interface": [":rigid"]}, "--interface :rigid: write NAME"),
        ({"--interface": ["start", "top"]}, "'top'"),
        ({"--frame": ["end_"]}, "no interface 'end_'"),
        ({"--modes": ["-1"]}, "modes must be a whole number from 0 on, got -1"),
        ({"--modes": ["100000"]}, "100000 fixed-interface modes were asked for"),
        ({"--modes": []}, "exactly one of modes"),
        ({"--below-hz": ["100"]}, "got modes and below_hz"),
        ({"--modes": [], "--below-hz": ["1"]}, "lies below 1 Hz: the first has"),
        ({"--modes": [], "--tol": ["2"]}, "tol must be a relative error"),
        ({"--damping-ratio": ["2"]}, "a damping ratio must lie between 0 and 1"),
        ({"--degree": ["7"]}, "degree"),
        ({"-o": ["nowhere/b.h5"]}, "there is no folder"),
        ({"-o": ["."]}, "it is not a regular file"),
        ({"mesh": ["nowhere.msh"]}, "nowhere.msh: cannot be opened"),
        ({"mesh": ["beam.h5"]}, "beam.h5 is the file to read"),
        ({"mesh": ["beam.h5"], "-o": ["other.h5"]}, "beam.h5 is not a flexmbd mesh; pass a file"),
        ({"--tag": ["start=1"]}, "--tag is for STEP files"),
        ({"--size": ["0.1"]}, "--size is for STEP files"),
    ],
)
def test_reduce_says_what_is_wrong_and_leaves_the_old_record(beam_file, monkeypatch, capsys, changes, message):
    from mpi4py import MPI

    monkeypatch.chdir(beam_file.parent)
    if MPI.COMM_WORLD.rank == 0:
        two_crosses().save("beam.h5")
    MPI.COMM_WORLD.barrier()
    choices = {**GOOD, "-o": ["beam.h5"], "mesh": [str(beam_file)], **changes}
    mesh = choices.pop("mesh")
    words = (word for key, values in choices.items() for value in values for word in (key, value))
    assert main(["reduce", *mesh, *words, "--force"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    if MPI.COMM_WORLD.rank == 0:
        assert message in err
        assert err.startswith("flexmbd: ")
        assert ReducedBody.load("beam.h5").fingerprint() == two_crosses().fingerprint()
        assert sorted(path.name for path in beam_file.parent.iterdir()) == ["beam.h5", "beam.msh"]
    else:
        assert err == ""
    MPI.COMM_WORLD.barrier()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--form", "solid_linear", "-o", "a.h5", "--frame", "start", "--floating"], "--floating"),
        (["--form", "solid_linear", "-o", "a.h5", "--material", "steel.toml"], "--material"),
        (["--form", "solid_linear"], "-o/--output"),
        (["-o", "a.h5"], "--material --form"),
    ],
)
def test_words_that_do_not_go_together(words, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["reduce", "a.msh", "--modes", "1", *words])
    assert message in capsys.readouterr().err


def test_a_record_that_exists_is_kept_without_force(tmp_path, capsys):
    two_crosses().save(tmp_path / "a.h5")
    words = ["--form", "solid_linear", "--modes", "1", "-o", str(tmp_path / "a.h5")]
    assert main(["reduce", str(tmp_path / "nowhere.msh"), *words]) == 2
    assert "a.h5 exists; give --force" in capsys.readouterr().err
    assert ReducedBody.load(tmp_path / "a.h5").fingerprint() == two_crosses().fingerprint()
