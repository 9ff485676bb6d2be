"""Contact pressure on elastic surfaces: in pictures, meshes, VTKHDF files and reports; its integral is the force."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.errors import PictureError, SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, Patch, craig_bampton
from flexmbd.visual import show as show_machine
from flexmbd.visual.drawn_scene import drawn_scene
from flexmbd.visual.part import placed
from flexmbd.visual.pressure_skin import patched_surface
from flexmbd.visual.view import SceneView

SMALL = (320, 240)
RUBBER = solid_linear.Parameters(E=5e6, nu=0.3, rho=1000.0)
QUANTITY = ("contact pressure", "Pa")


@functools.cache
def slab(divisions, facets, *, side=0.1, degree=2, surface=True, modes=True):
    """5 cm high, of rubber, with patches above or below."""
    model = ContinuumModel(meshes.block(side, side, 0.05, divisions=divisions), solid_linear, RUBBER, degree=degree)
    face = Patch("face", size=0.4 * side, facets=facets)
    kept = Keep(modes=modes, surface=surface)
    return craig_bampton(model, modes=8, contact=[face], keep=kept, geometric_stiffness=False)


@functools.cache
def pressed():
    """One slab on a larger one, whose mesh does not match, at rest under its weight and then pressed down."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    lower = scene.add(fm.FlexibleBody(slab((5, 4, 2), "z_max")), name="lower")
    upper = scene.add(fm.FlexibleBody(slab((3, 4, 2), "z_min", side=0.06)), name="upper")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), lower.frame())
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame((0.01, 0.005, 0.0)), upper.frame())
    slide.position = 0.05
    (pair,) = scene.touch(contact.ElasticSurface(upper, "face"), contact.ElasticSurface(lower, "face"), contact.Hard())
    scene.add_force(fm.force.JointForce(slide, lambda t: -500.0 * t))
    rest = scene.equilibrium()
    return scene.simulate(2e-3, about=rest, rtol=1e-4), pair, lower, upper


def areas(part):
    """(t,) m^2 of the undeformed triangles."""
    a, b, c = (part.x[part.triangle[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.LockingWarning")
@pytest.mark.parametrize("degree", [1, 2])
def test_triangles_of_patches_have_their_areas(degree):
    """Facets of degree 2 are divided into triangles that the record does not know."""
    record = slab((5, 4, 2), "z_max", degree=degree)
    patched = patched_surface(record, "slab")
    of = patched.patch[patched.surface.triangle]
    assert (of == of[:, :1]).all()
    found = np.bincount(of[:, 0] + 1, areas(patched.surface), minlength=len(record.contact.area) + 1)
    np.testing.assert_allclose(found[1:], record.contact.area, rtol=1e-9)
    assert found.sum() == pytest.approx(0.04, rel=1e-9)  # of the whole slab


def test_facets_alone_and_curved_ones():
    """The bore of a rod, of tetrahedra, whose facets are smaller than the gaps between their chords and the bore."""
    mesh = meshes.connecting_rod(length=0.1, h=6e-3)
    radius = float(np.sort(np.hypot(*mesh.mesh.geometry.x[:, :2].T))[0])
    bore = Patch("bore", size=8e-3, facets=lambda x: np.hypot(x[0], x[1]) < 1.001 * radius)
    model = ContinuumModel(mesh, solid_linear, RUBBER, degree=2)
    for surface in (True, False):
        kept = Keep(modes=True, surface=surface)
        record = craig_bampton(model, modes=4, contact=[bore], keep=kept, geometric_stiffness=False)
        patched = patched_surface(record, "rod")
        of = patched.patch[patched.surface.triangle[:, 0]]
        found = np.bincount(of + 1, areas(patched.surface), minlength=len(record.contact.area) + 1)
        np.testing.assert_allclose(found[1:], record.contact.area, rtol=0.02)
        assert (found[0] > 0.0) == surface


def test_the_integral_of_the_pressure_is_the_force_on_both_bodies():
    """At rest it is the weight; even over each patch, as the series has it."""
    run, pair, lower, upper = pressed()
    t = np.linspace(0.0, 2e-3, 5)
    (met,) = run.contacts(pair, t=t)
    total = met.normal_force.sum(axis=1)
    assert total[0] == pytest.approx(9.81 * upper.record.mass, rel=1e-6)
    assert np.ptp(total) > 0.1 * total[0]
    found = run.contact_pressures(pair, t=t)
    assert list(found) == [upper, lower]
    np.testing.assert_array_equal(found[upper], met.pressure)
    drawn = drawn_scene(run, t, notes=[""] * 5, pressures=lambda t: run.contact_pressures(pair, t=t))
    parts = {part.label: part for part in drawn.parts if part.quantity == QUANTITY}
    assert set(parts) == {"lower", "upper"}
    for name, part in parts.items():
        for k in range(5):
            values = placed(part, k)[1][part.triangle]
            assert (values == values[:, :1]).all()
            assert areas(part) @ values[:, 0] == pytest.approx(total[k], rel=1e-8), name
        assert part.largest == found[run.bodies[name]].max()
    assert drawn.quantities == (QUANTITY,)


def test_pressures_may_be_lists():
    run, pair, *_ = pressed()

    def listed(t):
        return {body: values.tolist() for body, values in run.contact_pressures(pair, t=t).items()}

    largest = [
        drawn_scene(run, run.t[-1:], notes=[""], pressures=given).largest(QUANTITY)
        for given in (listed, run._pressures_of([pair]))
    ]
    assert largest[0] == largest[1] > 0.0


def test_pressures_of_several_contacts_add_up():
    """A slab between two half spaces whose patches each feel one; given twice, as one list."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(slab((3, 4, 2), "z_min")), name="slab")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame())
    slide.position = 0.025
    floors = [contact.HalfSpace(scene.ground.frame((0.0, 0.0, 1e-6 * k))) for k in range(2)]
    pairs = [scene.touch(contact.ElasticSurface(body), floor, contact.Hard())[0] for floor in floors]
    run = scene.simulate(1e-4, about=scene.equilibrium(), rtol=1e-3)
    both = run.contact_pressures(pairs)[body]
    one, other = (run.contact_pressures(pair)[body] for pair in pairs)
    np.testing.assert_array_equal(both, one + other)
    assert both[0] @ body.record.contact.area == pytest.approx(9.81 * body.record.mass, rel=1e-6)


def test_pictures_films_meshes_files_and_reports_have_it(tmp_path):
    run, pair, lower, upper = pressed()
    asked = {"pressures": [pair]}
    for name, given in (("bare", {}), ("pressed", asked), ("open", {**asked, "hide": [upper]})):
        run.show(path=tmp_path / f"{name}.png", t=1e-3, size=SMALL, view=(1.0, 1.0, 1.0), **given)
    assert len({(tmp_path / f"{name}.png").read_bytes() for name in ("bare", "pressed", "open")}) == 3
    run.animate(tmp_path / "a.gif", fps=2, slow_motion=1e3, size=SMALL, pressures=[pair])
    assert (tmp_path / "a.gif").stat().st_size > 0
    blocks = run.to_pyvista(1e-3, pressures=[pair])
    pressure = run.contact_pressures(pair, t=1e-3)
    for body in (lower, upper):
        mesh = blocks[body.name]
        sizes = mesh.compute_cell_sizes(length=False, volume=False).cell_data["Area"]
        values = mesh.point_data["contact pressure"][mesh.regular_faces[:, 0]]
        force = pressure[body][0] @ body.record.contact.area
        assert sizes @ values == pytest.approx(force, rel=1e-3)  # of deformed triangles
    t = np.array([0.0, 1e-3])
    (left,) = fm.export.vtkhdf(run, tmp_path / "a.vtkhdf", t=t)
    assert left.startswith("forces of contacts (contact of elastic surface face of upper")
    assert fm.export.vtkhdf(run, tmp_path / "a.vtkhdf", t=t, pressures=[pair]) == ()
    import h5py

    with h5py.File(tmp_path / "a.vtkhdf") as file:
        kept = file["VTKHDF/PointData/contact_pressure"][:].reshape(2, -1)
    largest = np.max([one.max(axis=1) for one in run.contact_pressures(pair, t=t).values()], axis=0)
    assert np.nanmax(kept, axis=1) == pytest.approx(largest, rel=1e-6)
    page = run.report(tmp_path / "report").read_text(encoding="utf-8")
    assert "Elastic surfaces that touch" in page
    assert "largest pressure [Pa]" in page


def test_the_bar_tells_the_unit():
    run, pair, _, upper = pressed()
    drawn = drawn_scene(run, np.array([0.0]), notes=[""], pressures=run._pressures_of([pair]), hide=[upper])
    assert "upper" not in {part.label for part in drawn.parts} | set(drawn.legend)
    view = SceneView(drawn, size=SMALL)
    try:
        (title,) = view.plotter.scalar_bars.keys()
        assert title.split() == ["contact", "pressure", "in", "Pa" if drawn.largest(QUANTITY) < 1e3 else "kPa"]
    finally:
        view.close()


def test_zoom_fills_the_height_with_a_place():
    run, *_ = pressed()
    place, radius = np.array([0.01, 0.0, 0.05]), 0.02
    drawn = drawn_scene(run, np.array([0.0]), notes=[""], zoom=(place, radius))
    whole = drawn_scene(run, np.array([0.0]), notes=[""])
    corners = np.vstack([placed(part, 0)[0] for part in drawn.parts])
    for view in (None, np.array([0.0, 0.6, 0.8])):
        camera = drawn.camera(1.5, view)
        assert (camera.focus == place).all()
        assert camera.half_height == radius < whole.camera(1.5, view).half_height
        np.testing.assert_array_equal(camera.towards, whole.camera(1.5, view).towards)
        assert ((corners - place) @ camera.towards).max() < camera.distance
    for wrong in (3.0, (1.0, 2.0), ((0.0, 0.0, 0.0), 0.0), ((0.0, 0.0), 1.0), ((0.0, 0.0, np.nan), 1.0)):
        with pytest.raises(PictureError, match="zoom is a place"):
            drawn_scene(run, np.array([0.0]), notes=[""], zoom=wrong)


def test_what_cannot_be_shown_is_told(tmp_path):
    run, pair, lower, _ = pressed()
    other = fm.FlexibleBody(slab((3, 4, 2), "z_min"))
    record = slab((3, 4, 1), "z_min", modes=False)
    scene = fm.System()
    bare = scene.add(fm.FlexibleBody(record), name="bare")
    scene.connect(fm.joint.Free(), scene.ground.frame(), bare.frame()).position = (0, 0, 1.0, 1, 0, 0, 0)
    ground = contact.HalfSpace(scene.ground.frame())
    (far,) = scene.touch(contact.ElasticSurface(bare), ground, contact.Hard())
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    scene.connect(fm.joint.Fixed(), scene.ground.frame((0, 0, 9.0)), ball.frame())
    (rigid,) = scene.touch(ground, contact.Sphere(ball.frame(), 0.1), contact.PowerLaw(k=1e3))
    start = scene.at_start()
    path = tmp_path / "no.png"
    with pytest.raises(PictureError, match=r"'bare'.*keep=Keep\(surface=True, modes=True\)"):
        start.show(path=path, pressures=[far])
    with pytest.raises(SceneError, match="each a SurfaceContact"):
        start.show(path=path, pressures=[rigid])
    with pytest.raises(SceneError, match="pressures must be a list"):
        run.show(path=path, pressures=pair)
    with pytest.raises(PictureError, match="pressures must be a list"):
        run.animate(tmp_path / "no.gif", pressures=3.0)
    with pytest.raises(SceneError, match="not in this trajectory"):
        run.show(path=path, pressures=[far])
    with pytest.raises(PictureError, match="no body of this machine"):
        run.show(path=path, hide=[other])
    with pytest.raises(PictureError, match="has one colour"):
        drawn_scene(run, np.zeros(1), notes=[""], models={lower: None}, pressures=run._pressures_of([pair]))
    for given, words in (
        (3.0, "must be a function"),
        (lambda t: 3.0, "a mapping"),
        (lambda t: {lower: np.zeros((1, 2))}, "has 6 patches"),
        (lambda t: {other: np.zeros((1, 6))}, "not in this machine"),
    ):
        with pytest.raises(PictureError, match=words):
            show_machine(run, path=path, t=0.0, pressures=given)
