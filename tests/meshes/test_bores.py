"""Bores among the faces of STEP files: round holes and nothing else, wherever they lie and however they were cut."""

import math

import numpy as np
import pytest

gmsh = pytest.importorskip("gmsh")

import step_shapes  # noqa: E402  (needs gmsh)

from flexmbd import meshes  # noqa: E402
from flexmbd.meshes.bores import find_bores  # noqa: E402
from flexmbd.meshes.step_file import step_part  # noqa: E402


def written(path, build):
    """A STEP file of what `build` leaves in OpenCASCADE, lengths in mm."""
    step_shapes.write(path, lambda: build(gmsh.model.occ))
    return path


def drilled(occ, holes, *, turn=0.0):
    """A plate 100 x 40 x 20 with holes (x, y, z, direction, radius), turned about z."""
    plate = occ.addBox(0, 0, 0, 100, 40, 20)
    drills = [(3, occ.addCylinder(x, y, z, *direction, radius)) for x, y, z, direction, radius in holes]
    cut, _ = occ.cut([(3, plate)], drills)
    occ.rotate(cut, 0, 0, 0, 0.3, 0.2, 1, turn)


def test_bores_of_the_bracket():
    bores = find_bores(meshes.step_faces(meshes.BRACKET))
    assert [bore.name for bore in bores] == ["bore_1", "bore_2", "bore_3"]
    np.testing.assert_allclose([bore.radius for bore in bores], [4.5e-3, 8e-3, 4.5e-3], rtol=1e-9)
    centres = [(-0.028, 0, 0.004), (0, 0, 0.04), (0.028, 0, 0.004)]
    np.testing.assert_allclose([bore.centre for bore in bores], centres, atol=1e-12)
    np.testing.assert_allclose([bore.length for bore in bores], [8e-3, 20e-3, 8e-3], rtol=1e-9)
    np.testing.assert_allclose(np.abs([bore.axis for bore in bores]), [(0, 0, 1), (1, 0, 0), (0, 0, 1)], atol=1e-12)


def test_a_turned_part_with_a_blind_hole_and_one_across(tmp_path):
    holes = [(20, 20, -5, (0, 0, 30), 8), (60, -5, 10, (0, 60, 0), 4), (85, 20, 12, (0, 0, 30), 5)]
    part = step_part(written(tmp_path / "a.step", lambda occ: drilled(occ, holes, turn=0.7)))
    bores = find_bores(part.faces)
    np.testing.assert_allclose(sorted(bore.radius for bore in bores), [4e-3, 5e-3, 8e-3], rtol=1e-9)
    lengths = {round(bore.radius, 6): bore.length for bore in bores}
    np.testing.assert_allclose([lengths[4e-3], lengths[5e-3], lengths[8e-3]], [40e-3, 8e-3, 20e-3], rtol=1e-9)
    # the turned places of the holes' middles
    axis = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    for bore in bores:
        flat = {8e-3: (20, 20, 10), 4e-3: (60, 20, 10), 5e-3: (85, 20, 16)}[round(bore.radius, 6)]
        p = 1e-3 * np.array(flat)
        turned = p * math.cos(0.7) + np.cross(axis, p) * math.sin(0.7) + axis * (axis @ p) * (1 - math.cos(0.7))
        np.testing.assert_allclose(bore.centre, turned, atol=1e-9)
    volume = 1e-9 * (100 * 40 * 20 - math.pi * (64 * 20 + 16 * 40 + 25 * 8))
    assert part.volume == pytest.approx(volume, rel=1e-9)
    assert part.size == pytest.approx(np.ptp(corners(axis), axis=0), rel=0.05)


def corners(axis):
    """The corners of the turned plate, m."""
    box = 1e-3 * np.array([(x, y, z) for x in (0, 100) for y in (0, 40) for z in (0, 20)], float)
    return (
        box * math.cos(0.7) + np.cross(axis, box) * math.sin(0.7) + np.outer(box @ axis, axis) * (1 - math.cos(0.7))
    )


def test_two_half_cylinders_are_one_bore(tmp_path):
    """As many programs write a bore: cut along its axis. And the two legs of a fork are two bores."""

    def halves(occ):
        drilled(occ, [(20, 20, -5, (0, 0, 30), 8)])
        (_, plate) = occ.getEntities(3)[0]
        tool = occ.addBox(-10, 20, -10, 200, 100, 100)
        occ.fragment([(3, plate)], [(3, tool)])
        occ.remove([entity for entity in occ.getEntities(3) if occ.getMass(*entity) > 2e5], recursive=True)

    path = written(tmp_path / "a.step", halves)
    faces = meshes.step_faces(path)
    assert sum(face.cylinder is not None for face in faces) == 2
    (bore,) = find_bores(faces)
    assert len(bore.faces) == 2
    np.testing.assert_allclose(bore.centre, (0.02, 0.02, 0.01), atol=1e-12)

    def fork(occ):
        legs = [(3, occ.addBox(0, y, 0, 100, 10, 40)) for y in (0, 30)]
        yoke = [(3, occ.addBox(-20, 0, 0, 20, 40, 40))]
        body, _ = occ.fuse(legs, yoke)
        occ.cut(body, [(3, occ.addCylinder(80, -5, 20, 0, 50, 0, 6))])

    bores = find_bores(meshes.step_faces(written(tmp_path / "b.step", fork)))
    np.testing.assert_allclose([bore.centre for bore in bores], [(0.08, 0.005, 0.02), (0.08, 0.035, 0.02)], atol=1e-12)
    np.testing.assert_allclose([bore.length for bore in bores], 0.01, rtol=1e-9)


def test_slots_fillets_and_shafts_are_no_bores(tmp_path):
    def build(occ):
        plate = occ.addBox(0, 0, 0, 100, 40, 20)
        slot, _ = occ.fuse(
            [(3, occ.addBox(30, 14, -5, 40, 12, 30))],
            [(3, occ.addCylinder(x, 20, -5, 0, 0, 30, 6)) for x in (30, 70)],
        )
        cut, _ = occ.cut([(3, plate)], slot)
        occ.fuse(cut, [(3, occ.addCylinder(10, 20, 10, 0, 0, 50, 5))])

    faces = meshes.step_faces(written(tmp_path / "a.step", build))
    assert sorted(face.cylinder.hollow for face in faces if face.cylinder is not None) == [False, True, True]
    assert find_bores(faces) == ()
