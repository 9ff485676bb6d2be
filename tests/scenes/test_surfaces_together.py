"""Bodies whose patches press on several things: as the unreduced body between all of them, with any number of modes."""

from __future__ import annotations

import functools

from mpi4py import MPI

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse.linalg
from full_model import FullModel
from patch_loads import loads_of
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import Patch, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
SIZE, DEPTH = (0.06, 0.03, 0.02), 2e-6  # m
FACES = {
    "above": lambda x: (x[2] > 0.0099) & (x[0] > 0.0101),
    "below": lambda x: (x[2] < -0.0099) & (x[0] > 0.0101),
    "both": lambda x: (abs(x[2]) > 0.0099) & (x[0] > 0.0101),
}


def pressed(C, gap):
    """f >= 0 that closes the gaps: least squares without negative ones, of C's factor."""
    factor = np.linalg.cholesky(C)
    return scipy.optimize.nnls(factor.T, -np.linalg.solve(factor, gap))[0]


@functools.cache
def block_model():
    mesh = meshes.block(*SIZE, divisions=(6, 3, 2), comm=MPI.COMM_SELF)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])


@functools.cache
def block(modes, names):
    """Held at one end, patches above and below, of one surface or of two."""
    patches = [Patch(name, size=0.011, facets=FACES[name]) for name in names]
    return craig_bampton(block_model(), modes=modes, frame="x_min", contact=patches, geometric_stiffness=False)


def full_flexibility(record):
    """(3 p, 3 p) m/N along the patches' axes, of the unreduced block."""
    full = FullModel(block_model())
    loads = loads_of(record, full)
    free = np.flatnonzero(np.repeat(full.x[:, 0] > full.x[:, 0].min() + 1e-9, 3))
    return loads[free].T @ scipy.sparse.linalg.spsolve(full.K[free][:, free].tocsc(), loads[free])


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning", "ignore::flexmbd.errors.StartWarning")
@pytest.mark.parametrize("names", [("above", "below"), ("both",)], ids=["two surfaces", "one surface"])
def test_a_squeezed_block_is_the_full_model_with_any_number_of_modes(names):
    """It lies between two rigid plates. The upper one is tilted, so that some of the patches lift off it."""
    exact = None
    for modes in (1, 6, 20):
        record = block(modes, names)
        scene = fm.System()
        body = scene.add(fm.FlexibleBody(record), name="block")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
        R = Rotation.from_rotvec([3e-5, np.pi - 4e-4, 0.0]).as_matrix()
        places = np.array([(0.04, 0.0, 0.5 * SIZE[2] - DEPTH), (0.0, 0.0, -0.5 * SIZE[2] + DEPTH)])
        plates = [contact.HalfSpace(scene.ground.frame(p=p, R=r)) for p, r in zip(places, (R, np.eye(3)), strict=True)]
        surfaces = [contact.ElasticSurface(body, name) for name in names]
        sides = zip(surfaces * (2 // len(names)), plates, strict=True)
        pairs = [scene.touch(one, plate, contact.Hard())[0] for one, plate in sides]
        run = scene.simulate(1e-9, about=scene.equilibrium(), rtol=1e-3)
        force = np.zeros(len(record.contact.area))
        for pair in pairs:
            met = run.contacts(pair)[0]
            assert met.gap.min() > -1e-15
            force[pair.surface.patches] += met.normal_force[0]
        if exact is None:
            patches, is_above = record.contact, record.contact.axes[:, 2, :1] > 0.0
            normal, at = np.where(is_above, R[:, 2], (0.0, 0.0, 1.0)), np.where(is_above, *places)
            gap = np.einsum("pa,pa->p", patches.x - at, normal)
            along = np.einsum("pab,pa->pb", patches.axes, normal)
            C = np.einsum("pa,paqb,qb->pq", along, full_flexibility(record).reshape(len(gap), 3, -1, 3), along)
            exact = pressed(C, gap)
        np.testing.assert_allclose(force, exact, atol=1e-10 * exact.max())
    assert 3 < (exact > 0.0).sum() < len(exact) - 3


@functools.cache
def ring(modes):
    """Of 5 and 8 cm, its bore on a shaft, patches around."""
    around, radii, half = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False), np.linspace(0.05, 0.08, 3), 0.005
    nodes = np.array([(r * np.cos(a), r * np.sin(a), z) for z in (-half, half) for r in radii for a in around])
    number = np.arange(len(nodes)).reshape(2, 3, 32)
    corners = [(k, j, i) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    cells = np.array([[number[k, i + p, (j + q) % 32] for k, q, p in corners] for i in range(2) for j in range(32)])
    groups = {
        "bore": lambda x: np.hypot(x[0], x[1]) < 0.0501,
        "rim": lambda x: (np.hypot(x[0], x[1]) > 0.078) & (x[1] < -0.02),
    }
    mesh = meshes.from_arrays(MPI.COMM_SELF, nodes, cells, cell="hexahedron", degree=1, facet_groups=groups)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("bore")])
    return craig_bampton(
        model, modes=modes, frame="bore", contact=[Patch("rim", size=0.0157)], geometric_stiffness=False
    )


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
def test_a_ring_on_two_rollers_sinks_as_far_with_any_number_of_modes():
    """Its shaft is pushed down between them, and each bears half of it."""
    weight, found = 2e4, []
    for modes in (1, 8, 30):
        scene = fm.System(gravity=(0.0, 0.0, 0.0))
        body = scene.add(fm.FlexibleBody(ring(modes)), name="ring")
        slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), body.frame("bore"))
        scene.add_force(fm.force.JointForce(slide, -weight))
        angle, reach = np.radians(40.0), 0.08 + 0.04
        rim, pairs = contact.ElasticSurface(body, "rim", shape=contact.Cylinder(body.frame(), 0.08)), []
        for side in (-1.0, 1.0):
            axle = scene.ground.frame(p=(side * reach * np.sin(angle), -reach * np.cos(angle), 0.0))
            pairs += scene.touch(rim, contact.Cylinder(axle, 0.04), contact.Hard())
        rest = scene.equilibrium()
        run = scene.simulate(1e-9, about=rest, rtol=1e-3)
        forces = [run.contacts(pair)[0] for pair in pairs]
        for met, side in zip(forces, (-1.0, 1.0), strict=True):
            total = met.force[0].sum(axis=0)
            assert total[1] == pytest.approx(0.5 * weight, rel=1e-6)
            assert total[0] * -side > 0.4 * weight * np.tan(angle)
        found.append([rest.beta(slide), *np.concatenate([met.normal_force[0] for met in forces]) / weight])
    assert found[0][0] < -1e-6
    for one in found[1:]:
        assert one[0] == pytest.approx(found[0][0], rel=1e-4)
        np.testing.assert_allclose(one[1:], found[0][1:], atol=1e-4)
