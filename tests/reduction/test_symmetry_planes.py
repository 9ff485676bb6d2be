"""Half and quarter models against the whole part; rollers; a plate on four simple supports that buckles."""

import numpy as np
import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, Roller, SymmetryPlane
from flexmbd.coupling import Coupling
from flexmbd.errors import MeshError, ReductionError
from flexmbd.forms import beam_timoshenko, solid_linear
from flexmbd.reduction import InterfaceModes, Truncation, craig_bampton, linear_buckling, truncation_errors
from flexmbd.reduction.unit_loads import Pressure

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
LENGTH, WIDTH, HEIGHT = 0.5, 0.08, 0.06
Y, Z = SymmetryPlane("y_min", (0, 1, 0)), SymmetryPlane("z_min", (0.0, 0.0, -1.0))


def bar(*, halves=(), tip=True, coupling=Coupling.RIGID, supports=None):
    """The bar, or what is left of it where planes through its axis halve it."""
    width, height = (WIDTH / 2 if Y in halves else WIDTH), (HEIGHT / 2 if Z in halves else HEIGHT)
    divisions = (5, 1 if Y in halves else 2, 1 if Z in halves else 2)
    mesh = meshes.block(LENGTH, width, height, divisions=divisions)
    on_axis = (0.0, -width / 2 if Y in halves else 0.0, -height / 2 if Z in halves else 0.0)
    faces = [Interface("x_min", origin=on_axis)]
    if tip:
        faces.append(Interface("x_max", origin=(LENGTH, *on_axis[1:]), coupling=coupling))
    held = list(halves) if supports is None else supports
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=faces, supports=held)


def frequencies(model, count=40):
    """Of the unreduced part: its frame is its only interface."""
    return craig_bampton(model, modes=count, frame="x_min", geometric_stiffness=False).frequencies(["x_min"])


@pytest.fixture(scope="module")
def whole():
    return frequencies(bar(tip=False))


@pytest.mark.mpi
@pytest.mark.parametrize(("halves", "least"), [((Y,), 12), ((Z,), 12), ((Y, Z), 5)])
def test_frequencies_are_the_symmetric_ones_of_the_whole(whole, halves, least):
    found = frequencies(bar(halves=halves, tip=False), 20)
    found = found[found < 0.95 * whole[-1]]
    assert len(found) >= least
    nearest = abs(found[:, None] / whole - 1.0).min(axis=1)
    assert nearest.max() < 1e-8
    # and no frequency twice: a half has no antisymmetric modes
    assert len(found) < len(whole) - 4


@pytest.mark.mpi
def test_quarter_with_a_rigid_tip():
    """Four quarters are the whole: stiffness along the axis, mass, first longitudinal frequency."""
    body, quarter = (
        craig_bampton(bar(halves=halves), modes=15, frame="x_min", geometric_stiffness=False) for halves in ((), (Y, Z))
    )
    assert 4 * quarter.mass == pytest.approx(body.mass, rel=1e-12)
    assert "of the meshed part alone" in quarter.provenance["supports"]
    assert quarter.partition_names[0] == "x_max.x"
    assert quarter.partition_names[1].startswith("fixed-interface")
    softness = [(one.interface("x_max").modes[0] ** 2 / one.stiffness).sum() for one in (quarter, body)]
    assert softness[0] == pytest.approx(4 * softness[1], rel=1e-9)
    assert abs(quarter.interface("x_max").modes[1:]).max() == 0.0
    # the whole has fewer longitudinal modes among its fifteen
    assert abs(quarter.frequencies(["x_min"])[0] / body.frequencies(["x_min"]) - 1.0).min() < 2e-3


@pytest.mark.mpi
def test_half_with_a_rigid_tip():
    """The tip of a half moves in the plane and turns about its normal: the same flexibility, twice."""
    body, half = (
        craig_bampton(bar(halves=halves), modes=15, frame="x_min", geometric_stiffness=False) for halves in ((), (Y,))
    )
    assert half.partition_names[:3] == ("x_max.x", "x_max.z", "x_max.ry")
    softness = [one.interface("x_max").modes / one.stiffness @ one.interface("x_max").modes.T for one in (half, body)]
    kept = np.ix_([0, 2, 4], [0, 2, 4])
    assert softness[0][kept] == pytest.approx(2 * softness[1][kept], rel=1e-8, abs=1e-15)
    with_stiffening = craig_bampton(bar(halves=(Y,)), modes=6, frame="x_min")
    assert with_stiffening.stretch is not None
    reduced = craig_bampton(bar(halves=(Y,)), modes=6, frame="x_min", interface_modes=InterfaceModes(2))
    assert reduced.provenance["interface modes"] == "2 of 3"


@pytest.mark.mpi
def test_tolerances_hold_for_a_half(whole):
    model = bar(halves=(Y,))
    body = craig_bampton(model, modes=Truncation(tol=1e-3), frame="x_min", geometric_stiffness=False)
    exact = craig_bampton(model, modes=60, frame="x_min", geometric_stiffness=False)
    error = (body.frequencies(["x_min"])[:6] / exact.frequencies(["x_min"])[:6]) ** 2 - 1.0
    assert error.max() <= 1e-3
    estimate = truncation_errors(model, [4], frame="x_min", held=True).errors[0]
    four = craig_bampton(model, modes=4, frame="x_min", geometric_stiffness=False)
    true = (four.frequencies(["x_min"])[:6] / exact.frequencies(["x_min"])[:6]) ** 2 - 1.0
    assert (true <= estimate + 1e-6).all()


@pytest.mark.mpi
def test_roller(whole):
    """A cantilever whose long side keeps its height hardly bends about y: below a bending frequency there is none."""
    free, held = (frequencies(bar(tip=False, supports=supports), 6) for supports in ((), (Roller("z_min", (0, 0, 1)),)))
    assert held[0] > 1.05 * free[0]
    # across it nothing is held: as a plane would do on a flat side
    plane = frequencies(bar(tip=False, supports=(SymmetryPlane("z_min", (0, 0, 1)),)), 6)
    assert held == pytest.approx(plane, rel=1e-9)


@pytest.mark.mpi
def test_plate_on_simple_supports_buckles():
    """A square plate under compression along x: 4 pi^2 D / b^2 (Bryan), of which a quarter is meshed."""
    side, thickness = 1.0, 0.01
    mesh = meshes.block(side / 2, side / 2, thickness, divisions=(8, 8, 1))
    planes = [SymmetryPlane("x_min", (1, 0, 0)), SymmetryPlane("y_min", (0, 1, 0))]
    # without lateral contraction the edges may be kept from moving along themselves, as Kirchhoff's plates are
    rollers = [Roller("x_max", (0, 0, 1)), Roller("y_max", (0, 0, 1)), Roller("x_max", (0, 1, 0))]
    material = solid_linear.Parameters(E=STEEL.E, nu=0.0, rho=STEEL.rho)
    plate = ContinuumModel(mesh, solid_linear, material, degree=2, interfaces=[], supports=planes + rollers)
    found = linear_buckling(plate, clamped=[], loads=[(Pressure("push", "x_max"), 1.0)], count=2)
    stiffness = STEEL.E * thickness**3 / 12
    # halves m and n of waves that are symmetric: odd; (m + n^2 / m)^2 for n = 1, m = 1, 3
    waves = np.array([4.0, (3 + 1 / 3) ** 2])
    share = found.factors * thickness / (waves * np.pi**2 * stiffness / side**2)
    # five cells and a third a half wave, and less than three
    assert share == pytest.approx([1.0, 1.0], rel=2e-2)
    assert share[0] == pytest.approx(1.0, rel=2e-3)
    assert found.note.startswith("counted, 2")


@pytest.mark.mpi
def test_wrong_arguments():
    def refused(what, supports, error=MeshError):
        with pytest.raises(error, match=what):
            craig_bampton(bar(supports=supports), modes=2, frame="x_min")

    refused("do not lie in a plane of that normal", [SymmetryPlane("y_min", (1, 0, 0))])
    refused("along an axis of the mesh", [SymmetryPlane("y_min", (0, 1, 1))])
    refused("along an axis of the mesh", [Roller("y_min", (0, 0, 0))])
    with pytest.raises(MeshError, match="direction must be finite numbers, got 'z'"):
        Roller("y_min", "z")
    refused("must be a list", SymmetryPlane("y_min", (0, 1, 0)))
    refused("must be a SymmetryPlane", ["y_min"])
    refused("no_such", [SymmetryPlane("no_such", (0, 1, 0))])
    with pytest.raises(ReductionError, match="body frame"):
        craig_bampton(bar(halves=(Y,)), modes=2)
    with pytest.raises(ReductionError, match="averaged"):
        craig_bampton(bar(halves=(Y,), coupling=Coupling.AVERAGED), modes=2, frame="x_min")
    with pytest.raises(ReductionError, match="no free modes"):
        craig_bampton(bar(halves=(Y,)), modes=Truncation(2, free=True), frame="x_min")
    with pytest.raises(ReductionError, match="free to move"):
        linear_buckling(bar(halves=(Y,)), clamped={"x_min": ("x",)}, forces={"x_max": (-1.0, 0, 0, 0, 0, 0)})
    section = beam_timoshenko.Parameters.rectangle(2e11, 0.3, 7800.0, width=0.1, height=0.1, orientation=(0, 1, 0))
    line = meshes.line(1.0, divisions=2)
    with pytest.raises(MeshError, match="displacement alone"):
        ContinuumModel(line, beam_timoshenko, section, degree=2, supports=[SymmetryPlane("start", (1, 0, 0))])


def test_an_interface_on_a_roller_with_its_origin_elsewhere():
    """Its face turns about the edge on the roller wherever the frame is, which then moves along as it turns."""
    found = []
    for away in (0.0, 0.3):
        mesh = meshes.block(LENGTH, WIDTH, HEIGHT, divisions=(5, 1, 1))
        ends = [Interface("x_min"), Interface("x_max", origin=(LENGTH + away, 0.0, -HEIGHT / 2))]
        model = ContinuumModel(
            mesh, solid_linear, STEEL, degree=2, interfaces=ends, supports=[Roller("z_min", (0, 0, 1))]
        )
        found.append(craig_bampton(model, modes=6, frame="x_min", geometric_stiffness=False).frequencies(["x_min"]))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
