"""Beams, plates and micro-structures as bodies with history in implicit steps, their rotations with inertia.

Against the same bodies reduced, rigid bodies, Timoshenko's and Simo's beams; momenta, ranks, restart, refusals.
"""

import types
import warnings
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, ExplicitContinuum, ImplicitContinuum, Interface, NonlinearModel
from flexmbd.continuum.interior import turn_law
from flexmbd.errors import FormulationError, InterfaceError, MeshError, RangeWarning, SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.reduction.craig_bampton import craig_bampton

BEAM, EXACT, PLATE, SOLID = forms.beam_timoshenko, forms.beam_exact, forms.plate_mitc, forms.solid_micropolar
SECTION = BEAM.Parameters.rectangle(2e9, 0.3, 1500.0, width=0.05, height=0.02, orientation=(0.3, 1.0, 0.2))
SHEET = PLATE.Parameters(E=7e8, nu=0.3, rho=2700.0, t=0.02)
FOAM = SOLID.Parameters(E=7.5e7, nu=0.25, rho=1200.0, coupling=1e7, length=0.02, micro_inertia=1e-3)
THICK = BEAM.Parameters.rectangle(2e10, 0.3, 1500.0, width=0.2, height=0.1, orientation=(0.0, 1.0, 0.0))
ALPHA = fm.GeneralizedAlpha()


def rod(form=BEAM, p=SECTION, cells=4, degree=1, comm=MPI.COMM_SELF, kind=NonlinearModel):
    ends = [Interface("start"), Interface("end")]
    return kind(meshes.line(1.0, divisions=cells, comm=comm), form, p, degree=degree, interfaces=ends)


def sheet(p=SHEET, comm=MPI.COMM_SELF, kind=NonlinearModel, last=fm.Coupling.RIGID):
    ends = [Interface("x_min"), Interface("x_max", coupling=last)]
    return kind(meshes.sheet(0.5, 0.2, divisions=(4, 2), comm=comm), PLATE, p, degree=1, interfaces=ends)


def foam(p=FOAM, comm=MPI.COMM_SELF, kind=NonlinearModel):
    ends = [Interface("x_min"), Interface("x_max")]
    return kind(meshes.block(0.3, 0.05, 0.05, divisions=(3, 1, 1), comm=comm), SOLID, p, degree=1, interfaces=ends)


MAKERS = {"beam": rod, "plate": sheet, "foam": foam}


def pendulum(part, *, spin=3.0, joint=None):
    """On a hinge across its length, under its weight, let go with a spin."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(part, name="part")
    frames = part.interior.frames if isinstance(part, fm.ContinuumBody) else part.reduced().interfaces
    names = [frame.name for frame in frames]
    hinge = scene.connect(joint or fm.joint.Revolute(axis="y"), scene.ground.frame(), body.frame(names[0]))
    if spin:
        hinge.velocity = spin
    return scene, body, names[1]


def full(body, **more):
    return fm.ContinuumBody(ImplicitContinuum(body, **more))


@pytest.mark.parametrize("vector", turn_law._LAWS)
def test_vectors_of_rotations_change_as_their_tangents_say(vector):
    theta, step = np.array([[0.9, -0.5, 0.7], [1e-5, 0.0, 2e-5], [0.0, 0.0, 0.0]]), 1e-5
    R = vector.rotations(theta)
    assert vector.vectors(R) == pytest.approx(theta, abs=1e-12)
    there, back = (
        np.stack([vector.vectors(Rotation.from_rotvec(s * step * unit).as_matrix() @ R) for unit in np.eye(3)], axis=2)
        for s in (1.0, -1.0)
    )
    assert vector.tangents(theta) == pytest.approx((there - back) / (2 * step), abs=1e-9)


@pytest.mark.parametrize(
    ("body", "finite", "by_steps", "angle"),
    [(rod, True, False, 2 * np.arctan(0.5)), (lambda: rod(EXACT), True, True, 1.0), (sheet, False, False, 1.0)],
)
def test_how_rotations_are_written_is_found_by_turning_the_body(body, finite, by_steps, angle):
    law = ImplicitContinuum(body())._nodes.law
    assert (law.is_finite, law.by_steps) == (finite, by_steps)
    assert law.vector.angles(np.array([[0.0, 1.0, 0.0]])) == pytest.approx([angle])


@pytest.mark.parametrize("name", MAKERS)
def test_a_pendulum_swings_and_vibrates_as_the_reduced_one(name):
    """With all modes; the record is linear, so that displacements of a ten-thousandth are off by less still."""
    make = MAKERS[name]
    record = craig_bampton(make(kind=ContinuumModel), modes=18, frame=make().interfaces[0].name)
    tips, strains = [], []
    for part in (full(make()), fm.FlexibleBody(record)):
        scene, body, tip = pendulum(part)
        run = scene.simulate(0.06, h=1e-3, integrator=ALPHA)
        tips.append(run.position(body.frame(tip)))
        strains.append(run.energies(body)["elastic"] if isinstance(part, fm.ContinuumBody) else run.energy().elastic)
    sizes = np.linalg.norm(tips[0], axis=1)
    assert abs(tips[0] - tips[1]).max() < 2e-5 * sizes.max()
    assert strains[0][20:] == pytest.approx(strains[1][20:], abs=0.02 * strains[1].max())


@pytest.mark.parametrize("name", MAKERS)
def test_linear_machines_of_them_vibrate_as_the_reduced_ones(name):
    """Clamped, and on a hinge, where the body's axes turn with its first frame."""
    make = MAKERS[name]
    record = craig_bampton(make(kind=ContinuumModel), modes=18, frame=make().interfaces[0].name)
    for joint in (fm.joint.Fixed(), fm.joint.Revolute(axis="y")):
        found = []
        for part in (full(make()), fm.FlexibleBody(record)):
            scene = pendulum(part, spin=0.0, joint=joint)[0]
            scene.gravity = (0.0, 0.0, 0.0)
            frequencies = scene.linearize().frequencies()
            found.append(frequencies[frequencies > 1e-2][:5])
        assert found[0] == pytest.approx(found[1], rel=1e-5)


def timoshenko(length, bending, shear, mass, rotary):
    """First angular frequency (rad/s) of a cantilever: of EI, kGA, and mass and rotary inertia per length."""

    def closed(w):
        # roots of the field exp(k x): EI kGA k^4 + w^2 (EI mass + kGA rotary) k^2 + w^2 mass (w^2 rotary - kGA) = 0
        middle, last = w**2 * (bending * mass + shear * rotary), w**2 * mass * (w**2 * rotary - shear)
        k = np.sqrt(np.roots([bending * shear, middle, last]).astype(complex))
        k = np.concatenate([k, -k])
        slope = k + w**2 * mass / (shear * k)  # of the section, from the balance of shear
        at = np.exp(k * length)
        rows = [np.ones(4), slope, bending * slope * k * at, shear * (k - slope) * at]
        return np.linalg.det(np.array([row / abs(row).max() for row in rows]))

    lowest = 3.516 * np.sqrt(bending / mass) / length**2
    phase = closed(0.7 * lowest)
    return brentq(lambda w: (closed(w) / phase).real, 0.7 * lowest, 1.05 * lowest, xtol=1e-10 * lowest)


def test_a_thick_cantilever_has_timoshenkos_frequency_with_errors_of_second_order():
    """Rotary inertia takes a fiftieth of it."""
    p = BEAM.Parameters.rectangle(2e9, 0.3, 1500.0, width=0.3, height=0.4, orientation=(0.0, 1.0, 0.0))
    stiffness = p.E * p.Iy, p.kz * p.E / 2.6 * p.A
    exact = timoshenko(1.0, *stiffness, p.rho * p.A, p.rho * p.Iy) / (2 * np.pi)
    without = timoshenko(1.0, *stiffness, p.rho * p.A, 1e-9 * p.rho * p.Iy) / (2 * np.pi)
    assert without > 1.015 * exact
    errors = []
    for cells in (4, 8, 16):
        scene = pendulum(full(rod(p=p, cells=cells)), spin=0.0, joint=fm.joint.Fixed())[0]
        scene.gravity = (0.0, 0.0, 0.0)
        found = scene.linearize().frequencies()
        errors.append(abs(found - exact).min() / exact)
    assert errors[-1] < 2e-3
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx(4.0, rel=0.15)


def momenta(interior):
    """Linear and angular momentum of all nodes, with what frames have of it; no rigid parts."""
    now, nodes = interior._state, interior._nodes
    n, inertia = interior.body.layout.n_owned_nodes, nodes.turning.inertia
    p, Q = nodes.frames.product(now.v), now.turns.Q[:n]
    spins = np.einsum("nab,nb->na", Q, inertia.momenta(np.einsum("nba,nb->na", Q, now.turns.w[:n])))
    return p.sum(axis=0), (np.cross(now.x[:n], p) + spins).sum(axis=0)


def thrown(body, centre, spin, *, h, t_end=0.05):
    """Free, at rest in its centre, spinning about no axis of it."""
    interior = ImplicitContinuum(body)
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="part")
    first = interior.frames[0]
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), part.frame(first.name))
    free.velocity = (*np.cross(spin, first.p_BI_B - centre), *spin)
    scene.start()
    before = momenta(interior)
    run = scene.simulate(t_end, h=h, integrator=ALPHA)
    return run, part, before, momenta(interior)


CENTRES = {"beam": (0.5, 0.0, 0.0), "plate": (0.25, 0.1, 0.0), "foam": (0.15, 0.025, 0.025)}
SPIN = np.array([20.0, 3.0, 9.0])  # rad/s


@pytest.mark.parametrize("name", [*MAKERS, "exact"])
def test_a_free_body_that_spins_keeps_its_momenta(name):
    make, centre = (lambda: rod(EXACT), CENTRES["beam"]) if name == "exact" else (MAKERS[name], CENTRES[name])
    lost = []
    for h in (2e-3, 1e-3):
        run, part, before, after = thrown(make(), np.array(centre), SPIN, h=h)
        speed = before[1] / 0.5
        assert abs(after[0] - before[0]).max() < 1e-7 * np.linalg.norm(speed)
        lost.append(np.linalg.norm(after[1] - before[1]) / np.linalg.norm(before[1]))
        energy = sum(run.energies(part).values()) + run.energy().total
        assert energy == pytest.approx(energy[0], rel=1e-3)
    assert lost[1] < 5e-5
    assert lost[0] / lost[1] > 3.0


@pytest.mark.parametrize(
    ("make", "centre", "inertia", "mass"),
    [
        # a rod's about itself is that of its sections; fibres of a plate have none about themselves
        (
            lambda: rod(p=THICK, cells=16),
            (0.5, 0.0, 0.0),
            30.0 / 12 * np.array([0.2**2 + 0.1**2, 1.0 + 0.1**2, 1.0 + 0.2**2]),
            30.0,
        ),
        (
            lambda: sheet(PLATE.Parameters(E=7e10, nu=0.3, rho=1000.0, t=0.08)),
            (0.25, 0.1, 0.0),
            8.0 / 12 * np.array([0.2**2 + 0.08**2, 0.5**2 + 0.08**2, 0.5**2 + 0.2**2]),
            8.0,
        ),
    ],
)
def test_a_stiff_free_body_turns_as_the_rigid_one(make, centre, inertia, mass):
    """Euler's equations with the closed form of the inertia, the sections' part of which is a fifth and more of one."""
    centre = np.array(centre)
    run, part, _, _ = thrown(make(), centre, SPIN, h=1e-3, t_end=0.1)
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass, np.diag(inertia)), name="rigid")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame()).velocity = (0.0, 0.0, 0.0, *SPIN)
    rigid = scene.simulate(0.1, h=1e-3, integrator=ALPHA)
    one, other = part.interior.frames
    along = run.position(part.frame(other.name))[-1] - run.position(part.frame(one.name))[-1]
    expected = rigid.rotation(body.frame())[-1] @ (other.p_BI_B - one.p_BI_B)
    assert along == pytest.approx(expected, abs=2e-3 * np.linalg.norm(expected))
    assert run.rotation(part.frame(one.name))[-1] == pytest.approx(rigid.rotation(body.frame())[-1], abs=3e-3)


def test_a_soft_beam_turns_over_and_bends_far_as_the_exact_beam():
    """A rope that falls from level past its hinge; sections turn by more than half a revolution."""
    soft = BEAM.Parameters.rectangle(2e6, 0.3, 1500.0, width=0.02, height=0.02, orientation=(0.0, 1.0, 0.0))
    scene, body, tip = pendulum(full(rod(EXACT, soft, cells=4, degree=2)), spin=0.0)
    found = scene.simulate(0.6, h=6e-3, integrator=ALPHA).position(body.frame(tip))
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    points = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(points, {"rope": [("a", "b")]}, {"rope": soft}, 16), name="rope")
    scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), beam.frame("a"))
    expected = scene.simulate(0.6, h=6e-3, integrator=ALPHA).position(beam.frame("b"))
    assert abs(found - expected).max() < 1e-2
    assert abs(np.linalg.norm(found, axis=1).min() - 1.0) > 0.02  # it is bent far


def test_steps_are_of_second_order():
    ends = []
    for h in (8e-3, 4e-3, 2e-3, 1e-3):
        scene, body, tip = pendulum(full(rod(cells=2)))
        ends.append(scene.simulate(0.08, h=h, integrator=ALPHA).position(body.frame(tip))[-1])
    changes = [np.linalg.norm(a - b) for a, b in pairwise(ends)]
    assert np.array(changes[:-1]) / changes[1:] == pytest.approx(4.0, rel=0.3)


def test_a_shaft_that_is_twisted_far_is_solved_for_its_rotations():
    """By iterations with the machine's and by itself: of a twist rotations alone are out of balance.

    Their laws bend, 2 tan(phi / 2), so that it takes several.  Tolerances: of what both are solved to, 1e-9 and 1e-11.
    """
    scheme, h, found = Scheme(1.0 / 3.0, 4.0 / 9.0, 25.0 / 81.0, 11.0 / 18.0), 1e-3, []
    for jointly in (True, False):
        interior = ImplicitContinuum(rod())
        p, R = (np.array([getattr(one, name) for one in interior.frames]) for name in ("p_BI_B", "R_BI"))
        still, turn = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [0.8, 0.0, 0.0]])
        interior.begin(0.0, FrameMotion(p, R, still, still, still, still), np.zeros(3))
        per_x, per_v = scheme.slopes(h)
        turned = Rotation.from_rotvec(turn).as_matrix() @ R
        end = FrameMotion(p, turned, still, per_v / per_x * turn, still, turn / per_x)
        if jointly:
            correction, count = np.inf, 0
            while correction > 1e-9 and count < 20:
                answer = interior.iterate(h, h, scheme, end, tolerance=1e-9, renew=True)
                correction, count = answer.correction, count + 1
            wrenches = answer.wrenches
            assert 3 < count < 20
        else:
            wrenches = interior.trial(h, h, scheme, end)[0]
        interior.commit()
        found.append((wrenches, interior.body.displacement.copy()))
    for one, other in zip(*found, strict=True):
        assert one == pytest.approx(other, abs=1e-8 * abs(other).max())


@pytest.mark.parametrize("form", [BEAM, EXACT])
def test_slopes_at_rest_know_how_far_frames_have_turned(form):
    """The second frame by 0.94 rad against the first; central differences of 1e-5 m and rad."""
    interior = ImplicitContinuum(rod(form))
    p, R = (np.array([getattr(one, name) for one in interior.frames]) for name in ("p_BI_B", "R_BI"))
    still, first, second = np.zeros((2, 3)), np.array([0.2, -0.1, 0.3]), np.array([0.8, 0.1, -0.5])

    def at(y, share=1.0):
        move, turn = np.split(y.reshape(2, 6), 2, axis=1)
        whole = Rotation.from_rotvec(share * first)
        turned = np.array([whole.as_matrix(), (whole * Rotation.from_rotvec(share * second)).as_matrix()])
        return FrameMotion(
            p @ turned[0].T + move, Rotation.from_rotvec(turn).as_matrix() @ turned @ R, still, still, still, still
        )

    interior.begin(0.0, at(np.zeros(12), 0.0), np.zeros(3))
    for share in (0.25, 0.5, 0.75, 1.0):
        interior.equilibrate(0.0, at(np.zeros(12), share))
        interior.commit()
    slopes = interior.equilibrate(0.0, at(np.zeros(12)))[1]
    ends = [[interior.equilibrate(0.0, at(s * 1e-5 * unit))[0].reshape(-1) for s in (1.0, -1.0)] for unit in np.eye(12)]
    found = np.array([(there - back) / 2e-5 for there, back in ends]).T
    moments = slopes[9:, 9:]
    assert found[9:, 9:] == pytest.approx(moments, abs=1e-6 * abs(moments).max())
    assert found == pytest.approx(slopes, abs=1e-6 * abs(slopes).max())


@pytest.mark.parametrize("form", [BEAM, EXACT])
def test_a_beam_that_is_bent_far_vibrates_as_the_exact_beam(form):
    """Lifted at its end by 0.98 rad; sections have the inertia of their own axes, a tenth of one frequency."""
    thick = BEAM.Parameters.rectangle(2e7, 0.3, 1500.0, width=0.3, height=0.15, orientation=(0.0, 1.0, 0.0))
    points = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}
    exact = fm.ExactBeam(points, {"beam": [("a", "b")]}, {"beam": thick}, 32)
    found = []
    for part, first, last in ((full(rod(form, thick, 8, 2)), "start", "end"), (exact, "a", "b")):
        scene = fm.System()
        body = scene.add(part, name="beam")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame(first))
        lift = 3.0 * thick.E * thick.Iy
        scene.add_force(fm.force.FrameForce(body.frame(last), force=(0.0, 0.0, lift)))
        point = scene.equilibrium()
        assert point.rotation(body.frame(last))[0, 0] < 0.6
        frequencies = scene.linearize(about=point).frequencies()
        found.append(frequencies[frequencies > 1e-3][:6])
    assert found[0] == pytest.approx(found[1], rel=2e-3)


def test_it_sags_at_rest_as_a_beam_does():
    scene, body, tip = pendulum(full(rod(degree=2, cells=4)), spin=0.0, joint=fm.joint.Fixed())
    point = scene.equilibrium()
    p, load = SECTION, 1500.0 * SECTION.A * 9.81
    y = np.array([0.0, 1.0, 0.2]) / np.hypot(1.0, 0.2)
    z = np.cross([1.0, 0.0, 0.0], y)
    along = [(z, p.E * p.Iy, p.kz * p.E / 2.6 * p.A), (y, p.E * p.Iz, p.ky * p.E / 2.6 * p.A)]
    sag = sum(-axis[2] * axis * load * (1 / (8 * bending) + 1 / (2 * shear)) for axis, bending, shear in along)
    moved = point.position(body.frame(tip)) - [1.0, 0.0, 0.0]
    assert moved[1:] == pytest.approx(sag[1:], rel=1e-3)


def test_a_plate_that_bends_has_the_stress_of_its_curvature(tmp_path):
    """Where it turns by 0.1 rad; a membrane strain linear in the displacement would be -0.005 there."""
    body = sheet(PLATE.Parameters(E=2e8, nu=0.0, rho=2700.0, t=0.02))
    scene, part, _ = pendulum(full(body), spin=0.0, joint=fm.joint.Fixed())
    recording = fm.Recording(tmp_path / "plate.h5", every=5e-3)
    run = scene.simulate(0.06, h=5e-3, integrator=ALPHA, recording=recording)
    turns = body.displacement[body.displacement_dofs[:, 0] + 4]
    at = [turns[abs(body.layout.node_x[:, 0] - x) < 1e-6].mean() for x in np.linspace(0.0, 0.5, 5)]
    curvature = np.diff(at) / 0.125
    expected = 2e8 * 0.01 * 0.5 * (curvature[1] + curvature[2])
    assert max(at) > 0.05
    found = run.recorded(part).series("stress", point=(0.25, 0.0, 0.0))[-1]
    assert found[0] == pytest.approx(expected, rel=0.01)
    assert run.stress(part, t=0.06).max == pytest.approx(2e8 * 0.01 * curvature[0], rel=0.02)
    with pytest.raises(MeshError, match="no cell of the undeformed body holds the point"):
        run.recorded(part).series("stress", point=(0.25, 0.0, 0.01))


def without_rotary_inertia(form):
    light = types.ModuleType(f"light_{form.__name__}")
    vars(light).update({name: value for name, value in vars(form).items() if not name.startswith("__")})
    light.kinetic_energy = lambda v, p: form.kinetic_energy(v, p)[:1]  # type: ignore[attr-defined]
    return light


BOTH_ENDS = {name: fm.RigidBody(0.1, (1e-4, 1e-4, 1e-4)) for name in ("start", "end")}


@pytest.mark.parametrize("form", [BEAM, EXACT, without_rotary_inertia(EXACT)])
def test_a_restart_of_turning_nodes_goes_on_to_the_bit(form):
    """Of rotations with inertia and without, those that are known by steps alone among them."""
    ends, kept = [], None
    for again in (False, True):
        scene, body, tip = pendulum(full(rod(form, cells=2), rigid_parts=BOTH_ENDS))
        at = {"restart": kept} if again else {"checkpoints": [0.02]}
        run = scene.simulate(0.04, h=1e-3, integrator=ALPHA, **at)
        kept = kept or run.checkpoints[0]
        ends.append((run.position(body.frame(tip))[-1], run.energies(body)["kinetic"][-1]))
    np.testing.assert_array_equal(*[end[0] for end in ends])
    assert ends[0][1] == ends[1][1]


@pytest.mark.mpi
@pytest.mark.parametrize("name", MAKERS)
def test_turning_nodes_go_alike_on_any_number_of_ranks(name):
    tips, kept = [], []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        interior = ImplicitContinuum(MAKERS[name](comm=comm))
        scene, body, tip = pendulum(fm.ContinuumBody(interior))
        run = scene.simulate(0.02, h=1e-3, integrator=ALPHA)
        tips.append(np.append(run.position(body.frame(tip))[-1], run.energies(body)["kinetic"][-1]))
        kept.append(interior.snapshot())
    assert tips[1] == pytest.approx(tips[0], rel=1e-8, abs=1e-9)
    assert kept[1]["turns w"] == pytest.approx(kept[0]["turns w"], abs=1e-5)
    other = ImplicitContinuum(MAKERS[name](comm=MPI.COMM_WORLD))
    other.restore(kept[0])
    np.testing.assert_array_equal(other.snapshot()["turns E"], kept[0]["turns E"])


@pytest.mark.mpi
def test_what_beams_and_plates_cannot_do_is_refused():
    comm = MPI.COMM_WORLD
    for body in (rod(comm=comm), sheet(comm=comm)):
        with pytest.raises(FormulationError, match=r"turn with the body \(rigid_motion\).*take implicit ones"):
            ExplicitContinuum(body)
    with pytest.raises(FormulationError, match=r"a kinetic energy of their own.*take implicit steps"):
        ExplicitContinuum(foam(comm=comm))
    with pytest.raises(InterfaceError, match=r"turn with the body.*Coupling.RIGID"):
        ImplicitContinuum(sheet(comm=comm, last=fm.Coupling.AVERAGED))
    scene, body, tip = pendulum(full(sheet(comm=comm)))
    with pytest.raises(SceneError, match=r"is a beam or a plate.*put shapes on its frames"):
        scene.touch(fm.contact.Nodes(body, tip), fm.contact.HalfSpace(scene.ground.frame()), fm.contact.Hard())


@pytest.mark.mpi
def test_the_watch_on_rotations_is_an_error_of_all_ranks_where_warnings_are():
    soft = PLATE.Parameters(E=5e6, nu=0.3, rho=2700.0, t=0.02)
    scene, *_ = pendulum(full(sheet(soft, comm=MPI.COMM_WORLD)), spin=0.0, joint=fm.joint.Fixed())
    with warnings.catch_warnings():
        warnings.simplefilter("error", RangeWarning)
        with pytest.raises(RangeWarning, match="a node has turned by"):
            scene.simulate(0.15, h=1e-2, integrator=ALPHA)


def test_small_rotations_are_watched_and_finite_ones_are_not():
    soft = PLATE.Parameters(E=5e7, nu=0.3, rho=2700.0, t=0.02)
    scene, *_ = pendulum(full(sheet(soft)), spin=0.0, joint=fm.joint.Fixed())
    told = r"plate_mitc: a node has turned by 0.\d+ rad against its first interface, 'x_min'"
    with pytest.warns(RangeWarning, match=told):
        scene.simulate(0.15, h=5e-3, integrator=ALPHA)
    soft = BEAM.Parameters.rectangle(5e7, 0.3, 1500.0, width=0.02, height=0.02, orientation=(0.0, 1.0, 0.0))
    scene, *_ = pendulum(full(rod(p=soft)), spin=0.0, joint=fm.joint.Fixed())
    with warnings.catch_warnings():
        warnings.simplefilter("error", RangeWarning)
        scene.simulate(0.2, h=5e-3, integrator=ALPHA)
