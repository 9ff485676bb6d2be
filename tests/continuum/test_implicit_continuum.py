"""A body with history that the machine steps implicitly: its condensed tangent, and its motion."""

import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, ImplicitContinuum, Interface, NonlinearModel
from flexmbd.errors import InterfaceError, SceneError
from flexmbd.integrate.alpha import interiors as alpha_interiors
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.reduction import craig_bampton

J2, HENCKY, ELASTIC = forms.j2_plasticity, forms.hencky_plasticity, forms.solid_linear
STEEL = {"E": 2.0e9, "nu": 0.3, "rho": 7800.0}
ENDS = (Interface("x_min"), Interface("x_max"))
H = 2e-3
GRAVITY = np.array([0.0, 1.0, -9.81])


def bar(form, parameters, *, interfaces=ENDS, comm=MPI.COMM_WORLD):
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(4, 1, 1), comm=comm)
    return NonlinearModel(mesh, form, parameters, degree=1, interfaces=list(interfaces))


def scheme(rho=0.8):
    alpha_m, alpha_f = (2 * rho - 1) / (1 + rho), rho / (1 + rho)
    return Scheme(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f)


def spinning(interior):
    """Frames of a body that stands askew, turns and is just let go."""
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    w, alpha = np.array([0.5, -1.0, 2.0]), np.zeros(3)
    p = np.array([frame.p_BI_B for frame in interior.frames]) @ R.T
    turning = np.cross(w, np.cross(w, p))
    return FrameMotion(
        p,
        np.array([R @ frame.R_BI for frame in interior.frames]),
        np.cross(w, p),
        np.tile(w, (2, 1)),
        turning,
        np.tile(alpha, (2, 1)),
    )


class TrialMotion:
    """Motions of the frames near a trial one at the end of a step, as the scheme moves them."""

    def __init__(self, start, *, size):
        rng = np.random.default_rng(1)
        self._per_x, self._per_v = scheme().slopes(H)
        turn = [Rotation.from_rotvec(H * w + 20 * size * rng.normal(size=3)).as_matrix() for w in start.w]
        self._base = FrameMotion(
            start.p + H * start.v + size * rng.normal(size=(2, 3)),
            np.einsum("kab,kbc->kac", turn, start.R),
            *(part + rng.normal(size=(2, 3)) for part in (start.v, start.w, start.a, start.alpha)),
        )

    def at(self, y):
        base, (move, turn) = self._base, np.split(y.reshape(2, 6), 2, axis=1)
        R = np.einsum("kab,kbc->kac", Rotation.from_rotvec(turn).as_matrix(), base.R)
        speed = self._per_v / self._per_x
        return FrameMotion(
            base.p + move, R, base.v + speed * move, base.w + speed * turn,
            base.a + move / self._per_x, base.alpha + turn / self._per_x,
        )  # fmt: skip


CASES = {
    "elastic": (ELASTIC, ELASTIC.Parameters(**STEEL), 5e-4),
    "small strain": (J2, J2.Parameters(**STEEL, yield_stress=1.0e6, hardening=J2.LinearHardening(2.0e8)), 2e-3),
    "logarithmic": (HENCKY, HENCKY.Parameters(**STEEL, yield_stress=1.0e6, hardening=J2.LinearHardening(2.0e8)), 2e-3),
}


RIGID, AVERAGED = fm.Coupling
HELD = {
    "both rigid": (RIGID, RIGID),
    "both averaged": (AVERAGED, AVERAGED),
    "first averaged": (AVERAGED, RIGID),
    "last averaged": (RIGID, AVERAGED),
}


def ends(couplings):
    return tuple(Interface(name, coupling=how) for name, how in zip(("x_min", "x_max"), couplings, strict=True))


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("name", CASES)
def test_condensed_tangent_is_the_derivative_of_the_wrenches(name, held):
    form, parameters, size = CASES[name]
    interior = ImplicitContinuum(bar(form, parameters, interfaces=ends(HELD[held])))
    start = spinning(interior)
    interior.begin(0.0, start, GRAVITY)
    motion = TrialMotion(start, size=size)
    _, slopes = interior.trial(H, H, scheme(), motion.at(np.zeros(12)))
    step, found = 1e-7, np.zeros((12, 12))
    for j, unit in enumerate(np.eye(12)):
        there, back = (interior.trial(H, H, scheme(), motion.at(sign * step * unit))[0] for sign in (1.0, -1.0))
        found[:, j] = (there - back).reshape(-1) / (2 * step)
    assert abs(found - slopes).max(axis=0) == pytest.approx(0.0, abs=2e-6 * abs(slopes).max())
    interior.trial(H, H, scheme(), motion.at(np.zeros(12)))
    interior.commit()
    if name != "elastic":
        assert interior.energies()["plastic"] > 0.1 * interior.energies()["elastic"] > 0.0


def nearest_rigid_motion(X, x):
    """Mean position of a bilinear face with corners x, and its rotation from X, of least mean square error."""
    points = np.array([(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]) / np.sqrt(3.0)
    corners = np.array([(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    shapes = np.prod(1.0 + points[:, None] * corners, axis=2) / 4.0
    before, after = shapes @ X, shapes @ x
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    return after.mean(axis=0), turn.as_matrix()


def test_an_averaged_frame_is_the_rigid_motion_nearest_to_its_face():
    """A soft bar, bent and squeezed out of shape in one step; the faces warp, the frames are in their midst."""
    form, parameters, _ = CASES["logarithmic"]
    body = bar(form, parameters, interfaces=ends(HELD["both averaged"]))
    interior = ImplicitContinuum(body)
    start = spinning(interior)
    interior.begin(0.0, start, GRAVITY)
    motion = TrialMotion(start, size=2e-3).at(np.zeros(12))
    interior.trial(H, H, scheme(), motion)
    interior.commit()
    kept, X = interior.snapshot()["x"], body.mesh.mesh.geometry.input_global_indices
    order = np.argsort(X)
    X = body.mesh.mesh.geometry.x[order]
    for k, place in enumerate((0.0, 1.0)):
        face = np.flatnonzero(abs(X[:, 0] - place) < 1e-9)
        face = face[np.lexsort((X[face, 2], X[face, 1]))]
        p, R = nearest_rigid_motion(X[face], kept[face])
        off = kept[face] - (p + (X[face] - X[face].mean(axis=0)) @ R.T)
        assert abs(off).max() > 1e-5
        assert motion.p[k] == pytest.approx(p, abs=1e-10)
        assert motion.R[k] == pytest.approx(R, abs=1e-9)


@pytest.mark.parametrize("held", HELD)
def test_free_start_has_the_weight_of_the_body(held):
    form, parameters, _ = CASES["elastic"]
    interior = ImplicitContinuum(bar(form, parameters, interfaces=ends(HELD[held])))
    rest = spinning(interior)
    rest = rest._replace(**{name: np.zeros((2, 3)) for name in ("v", "w", "a", "alpha")})
    wrenches = interior.begin(0.0, rest, GRAVITY)
    # held frames, with the interior let go: what falls freely is not felt but for its coupling by the mass matrix
    falling = rest._replace(a=np.tile(GRAVITY, (2, 1)))
    assert interior.begin(0.0, falling, GRAVITY) == pytest.approx(np.zeros((2, 6)), abs=1e-10)
    assert abs(wrenches[:, :3]).max() > 1.0
    assert interior.mass + sum(frame.mass for frame in interior.frames) == pytest.approx(78.0, rel=1e-12)


def swing(body, *, gravity, t_end=0.1):
    scene = fm.System(gravity=(0.0, 0.0, -gravity))
    scene.add(body, name="bar")
    scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), body.frame("x_min"))
    run = scene.simulate(t_end, h=1e-3, integrator=fm.GeneralizedAlpha(), rtol=1e-8)
    return run.position(body.frame("x_max")), run


@pytest.mark.parametrize("coupling", fm.Coupling)
def test_small_strains_are_those_of_the_reduced_body(coupling):
    """The difference falls with the square of the amplitude: ten times the load, a hundred times and more."""
    parameters = ELASTIC.Parameters(**STEEL)
    interfaces = ends((coupling, coupling))
    body = bar(ELASTIC, parameters)
    model = ContinuumModel(body.mesh, ELASTIC, parameters, degree=1, interfaces=list(interfaces))
    # all modes that there are, so that nothing but the strain measure differs
    record = craig_bampton(model, modes=36 if coupling is RIGID else 48, frame="x_min")
    off = []
    for gravity in (9.81, 98.1):
        reference, _ = swing(fm.FlexibleBody(record), gravity=gravity)
        interior = ImplicitContinuum(bar(ELASTIC, parameters, interfaces=interfaces))
        tip, _ = swing(fm.ContinuumBody(interior), gravity=gravity)
        off.append(abs(tip - reference).max())
    assert off[0] < 1e-6
    assert off[1] > 100 * off[0]
    assert off[1] < 1e-3


def test_account_of_a_swing_that_yields():
    form, _, _ = CASES["logarithmic"]
    parameters = form.Parameters(**STEEL, yield_stress=0.5e6, hardening=J2.LinearHardening(1.0e8))
    body = fm.ContinuumBody(ImplicitContinuum(bar(form, parameters)))
    _, run = swing(body, gravity=98.1)
    parts = run.energies(body)
    assert parts["plastic"][-1] > 1.0
    frames = run.energy()
    total = sum(parts.values()) + frames.kinetic + frames.gravitational
    largest = max(abs(parts["kinetic"]).max(), abs(parts["gravitational"]).max())
    assert abs(total - total[0]).max() < 0.01 * largest


def test_a_rejected_trial_leaves_no_trace():
    """Nor does one that was tried twice: to the bit what an interior finds that never heard of it."""
    form, parameters, size = CASES["small strain"]
    answers = []
    for rejected in (0, 2):
        interior = ImplicitContinuum(bar(form, parameters))
        start = spinning(interior)
        interior.begin(0.0, start, GRAVITY)
        kept = interior.snapshot()
        for k in range(rejected):
            interior.trial(2 * H, 2 * H, scheme(), TrialMotion(start, size=(2 + k) * size).at(np.zeros(12)))
            interior.revert()
            assert all(np.array_equal(part, kept[name]) for name, part in interior.snapshot().items())
        wrenches, slopes = interior.trial(H, H, scheme(), TrialMotion(start, size=size).at(np.zeros(12)))
        interior.commit()
        answers.append({"wrenches": wrenches, "slopes": slopes, **interior.snapshot()})
        assert interior.energies()["plastic"] > 0.0
    for name, part in answers[0].items():
        assert np.array_equal(answers[1][name], part), name


def iterations(interior, motion, *, h=H, most=12, tolerance=1e-12):
    """Newton's iterations of a step with the frames held at a motion."""
    found = []
    for _ in range(most):
        found.append(interior.iterate(h, h, scheme(), motion, tolerance=tolerance, renew=False))
        if found[-1].correction <= tolerance:
            break
    return found


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("name", CASES)
def test_iterations_end_where_a_trial_does(name, held):
    """One way solves for the nodes with searches and its own factors, the other goes along with the machine."""
    form, parameters, size = CASES[name]
    answers = []
    for jointly in (True, False):
        interior = ImplicitContinuum(bar(form, parameters, interfaces=ends(HELD[held])))
        start = spinning(interior)
        interior.begin(0.0, start, GRAVITY)
        motion = TrialMotion(start, size=size)
        if jointly:
            found = iterations(interior, motion.at(np.full(12, 1e-5)))
            found += iterations(interior, motion.at(np.zeros(12)))
            assert found[-1].correction <= 1e-12
            wrenches, slopes = found[-1].wrenches, found[-1].slopes
        else:
            wrenches, slopes = interior.trial(H, H, scheme(), motion.at(np.zeros(12)))
        interior.commit()
        answers.append((wrenches, slopes, interior.snapshot(), interior.energies()))
    (joint, joint_slopes, kept, energies), (alone, slopes, kept_alone, energies_alone) = answers
    assert joint == pytest.approx(alone, abs=1e-8 * abs(alone).max())
    assert kept["x"] == pytest.approx(kept_alone["x"], abs=1e-10)
    assert energies == pytest.approx(energies_alone, rel=1e-8)
    # kept from an iteration before, slopes are of somewhere near
    assert joint_slopes == pytest.approx(slopes, abs=(0.5 if name != "elastic" else 0.01) * abs(slopes).max())


@pytest.mark.parametrize("held", ["both rigid", "both averaged"])
def test_the_first_iteration_of_a_linear_body_is_the_last(held):
    """A body that answers linearly, moved as a machine moves it: what the first iteration foretells is the solution."""
    form, parameters, _ = CASES["elastic"]
    interior = ImplicitContinuum(bar(form, parameters, interfaces=ends(HELD[held])))
    start = spinning(interior)
    still = start._replace(**{name: np.zeros((2, 3)) for name in ("v", "w", "a", "alpha")})
    interior.begin(0.0, still, np.zeros(3))
    pulled = still._replace(p=still.p + 1e-9 * np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5]]))
    first, second, *_ = iterations(interior, pulled, tolerance=1e-6)
    assert second.correction < 1e-6
    assert first.wrenches == pytest.approx(second.wrenches, abs=1e-6 * abs(second.wrenches).max())
    assert abs(first.wrenches).max() > 0.01


def test_elastic_steps_assemble_no_tangent(monkeypatch):
    """Of a swing below the yield limit; and each takes few evaluations of the forces."""
    form, parameters, _ = CASES["logarithmic"]
    made, evaluated = [], []
    for name, calls in (("tangent", made), ("force", evaluated)):
        old = getattr(NonlinearModel, name)

        def counted(self, *args, old=old, calls=calls, **options):
            calls.append(0)
            return old(self, *args, **options)

        monkeypatch.setattr(NonlinearModel, name, counted)
    interior = ImplicitContinuum(bar(form, parameters))
    made.clear()
    _, run = swing(fm.ContinuumBody(interior), gravity=9.81, t_end=0.05)
    assert run.energies(next(iter(run.scene.interiors.bodies)))["plastic"][-1] == 0.0
    assert len(made) <= 3
    assert len(evaluated) <= 7 * run.stats.steps


def test_rejected_iterations_leave_no_trace():
    """To the bit what an interior finds that never heard of them."""
    form, parameters, size = CASES["small strain"]
    answers = []
    for rejected in (0, 2):
        interior = ImplicitContinuum(bar(form, parameters))
        start = spinning(interior)
        interior.begin(0.0, start, GRAVITY)
        kept = interior.snapshot()
        for k in range(rejected):
            iterations(interior, TrialMotion(start, size=(2 + k) * size).at(np.zeros(12)), h=2 * H, most=3)
            interior.revert()
            assert all(np.array_equal(part, kept[name]) for name, part in interior.snapshot().items())
        found = iterations(interior, TrialMotion(start, size=size).at(np.zeros(12)))
        interior.commit()
        answers.append({"wrenches": found[-1].wrenches, "slopes": found[-1].slopes, **interior.snapshot()})
        assert interior.energies()["plastic"] > 0.0
    for name, part in answers[0].items():
        assert np.array_equal(answers[1][name], part), name


def test_a_swing_that_yields_is_the_one_of_nodes_solved_for_by_themselves(monkeypatch):
    """Machine and nodes as one, and nested: to the tolerance the same."""
    form, _, _ = CASES["logarithmic"]
    parameters = form.Parameters(**STEEL, yield_stress=0.5e6, hardening=J2.LinearHardening(1.0e8))
    ends_of = []
    for nested in (False, True):
        body = fm.ContinuumBody(ImplicitContinuum(bar(form, parameters)))
        if nested:
            monkeypatch.setattr(alpha_interiors, "IteratedInterior", type("Nothing", (), {}))
        tip, run = swing(body, gravity=98.1)
        ends_of.append((tip, run.energies(body)["plastic"]))
    (tip, plastic), (tip_nested, plastic_nested) = ends_of
    assert plastic[-1] > 1.0
    assert tip == pytest.approx(tip_nested, abs=1e-7)
    assert plastic == pytest.approx(plastic_nested, abs=1e-5 * plastic[-1])


@pytest.mark.mpi
def test_restored_on_any_number_of_ranks_it_goes_on_as_before():
    form, parameters, size = CASES["logarithmic"]
    interior = ImplicitContinuum(bar(form, parameters))
    start = spinning(interior)
    interior.begin(0.0, start, GRAVITY)
    interior.trial(H, H, scheme(), TrialMotion(start, size=size).at(np.zeros(12)))
    interior.commit()
    kept = interior.snapshot()
    other = ImplicitContinuum(bar(form, parameters))
    other.restore({name: part.copy() for name, part in kept.items()})
    end = TrialMotion(start, size=0.5 * size).at(np.full(12, 1e-4))
    answers = [one.trial(2 * H, H, scheme(), end) for one in (interior, other)]
    assert answers[1][0] == pytest.approx(answers[0][0], rel=1e-9, abs=1e-9 * abs(answers[0][0]).max())
    # what one rank alone finds, from the whole body's arrays
    assert kept["x"].shape == (20, 3)


@pytest.mark.mpi
@pytest.mark.parametrize("held", ["both averaged", "last averaged"])
def test_averaged_frames_are_pushed_alike_on_any_number_of_ranks(held):
    form, parameters, size = CASES["logarithmic"]
    answers = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        interior = ImplicitContinuum(bar(form, parameters, interfaces=ends(HELD[held]), comm=comm))
        start = spinning(interior)
        first = interior.begin(0.0, start, GRAVITY)
        wrenches, slopes = interior.trial(H, H, scheme(), TrialMotion(start, size=size).at(np.zeros(12)))
        interior.commit()
        answers.append((first, wrenches, slopes, np.array([*interior.energies().values(), interior.mass])))
    for alone, together in zip(*answers, strict=True):
        assert together == pytest.approx(alone, rel=1e-8, abs=1e-8 * abs(alone).max())


def test_what_cannot_be_bonded_is_refused():
    form, parameters, _ = CASES["elastic"]
    with pytest.raises(InterfaceError, match="needs an interface"):
        ImplicitContinuum(bar(form, parameters, interfaces=()))
    with pytest.raises(InterfaceError, match="a rigid part the name of one"):
        ImplicitContinuum(bar(form, parameters), rigid_parts={"nose": fm.RigidBody(1.0, (1.0, 1.0, 1.0))})
    touching = (Interface("x_min", coupling=AVERAGED), Interface("y_min"))
    with pytest.raises(InterfaceError, match="must not touch"):
        ImplicitContinuum(bar(form, parameters, interfaces=touching))
    with pytest.raises(SceneError, match="before begin was called"):
        ImplicitContinuum(bar(form, parameters)).energies()


def test_the_code_of_the_page_runs(capsys):
    text = (Path(__file__).parents[2] / "docs" / "implicit.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(code, names)
    assert set(names["run"].energies(names["rod"])) == {"kinetic", "gravitational", "elastic", "plastic"}
    assert "plastic" in capsys.readouterr().out


def test_kinetic_energies_of_frames_and_interior_sum_up_to_that_of_the_consistent_mass():
    """A bar of one cell whose one end moves has m v^2 / 6, its frame m v^2 / 4: the interior less than none."""
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    soft = forms.neo_hookean.Parameters(E=1e6, nu=0.0, rho=1000.0)
    model = NonlinearModel(mesh, forms.neo_hookean, soft, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    scene = fm.System()
    body = scene.add(fm.ContinuumBody(ImplicitContinuum(model)), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(p=(0.1, 0.0, 0.0)), body.frame("x_max"))
    slide.velocity = 0.01
    run = scene.simulate(1e-4, h=1e-4)
    inside, machine = run.energies(body)["kinetic"], run.energy().kinetic
    assert inside[0] < 0.0
    assert inside[0] + machine[0] == pytest.approx(0.01**2 / 6, rel=1e-12)
