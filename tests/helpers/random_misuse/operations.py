"""What is done with a machine: runs, files, equilibria, linear machines, ensembles; by right and wrong arguments."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import flexmbd as fm
from flexmbd import export, force, output, parameter
from flexmbd.ensemble import Sampled
from flexmbd.run.stopped import SimulationError
from random_misuse.dice import Dice, Thing
from random_misuse.scenes import Parts, UsersFault, failing, machine, record
from random_misuse.watching import Session

SECONDS = 0.5  # of a run


def misuse(seed: int, folder: Path, begin: Callable[[str], None], clock: Callable[[], float]) -> Session:
    """One machine, and what is done with it.

    Args:
        seed: decides everything.
        folder: an empty one, for files.
        begin: hears of each statement before it is run.
        clock: s of the processor, without those that compilation takes.
    """
    dice, session = Dice(seed), Session(seed, clock, (UsersFault,), begin)
    parts = machine(session, dice)
    if parts is None:
        return session
    for _ in range(dice.whole(1, 4)):
        operation = dice.one_of([_run, _run, _run, _run, _balance, _linear, _variants, _variants, _words, _files])
        operation(session, dice, parts, folder)
    return session


# ------------------------------------------------------------------------------------------------------------- runs


def _method(dice: Dice) -> Any:
    kinds: list[Callable[[], Any]] = [
        lambda: "auto", lambda: "auto", lambda: fm.RadauIIA(), lambda: fm.GeneralizedAlpha(dice.value(0.8)),
        lambda: fm.ExplicitRungeKutta(), lambda: fm.EnergyMomentum(), lambda: fm.CentralDifference(),
        lambda: fm.ExplicitRungeKutta(dice.one_of(list(fm.Pair))),
    ]  # fmt: skip
    return dice.value(dice.one_of(kinds)())


def _event(dice: Dice) -> Any:
    def start_again(moment: fm.Moment) -> None:
        moment.v[:] = dice.one_of([0.0, float("nan"), 1e300])

    functions = [lambda moment: moment.t - 0.01, lambda moment: np.sin(300.0 * moment.t), lambda moment: 1.0,
                 failing, lambda moment: float("nan"), lambda moment: "text", lambda moment: np.zeros((2, 2)),
                 lambda: 0.0]  # fmt: skip
    how = dice.options(
        direction=lambda: dice.value(dice.one_of(list(fm.Direction))), stop=lambda: dice.value(True),
        action=lambda: dice.one_of([start_again, failing, Thing()]), name=lambda: dice.value("e"),
    )  # fmt: skip
    return fm.Event(dice.one_of(functions if dice.wrong else functions[:3]), **how)


def _settings(session: Session, dice: Dice, folder: Path) -> tuple[Any, dict[str, Any]]:
    t_end = dice.value(dice.one_of([0.02, 0.05, 0.2]))
    how = dice.options(
        rtol=lambda: dice.value(dice.one_of([1e-3, 1e-6, 1e-9])), t_start=lambda: dice.value(0.0),
        max_step=lambda: dice.value(0.01), max_steps=lambda: dice.value(50), max_rows=lambda: dice.value(40),
        checkpoints=lambda: dice.value([0.01]), stream=lambda: dice.value(folder / "run.h5"),
        events=lambda: dice.value([made for made in [session.do("Event", lambda: _event(dice))] if made]),
    )  # fmt: skip
    if dice.chance(0.15):
        how |= {"checkpoint_file": dice.value(folder / "last.npz"), "checkpoint_every": dice.value(0.005)}
    if dice.chance(0.15):
        how = {name: value for name, value in how.items() if name != "max_step"} | {"h": dice.value(1e-3)}
    if dice.chance(0.7):
        how["integrator"] = session.do("integrator", lambda: _method(dice))
    how["max_seconds"] = SECONDS
    return t_end, how


def _run(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    scene = parts.scene
    t_end, how = _settings(session, dice, folder)
    if dice.chance(0.1):
        how["about"] = session.do("about", scene.equilibrium)
    run = session.do(f"simulate {t_end!r:.40} {how!r:.300}", lambda: _kept(scene.simulate, t_end, **how))
    if run is None:
        return
    session.finite("rows", np.concatenate([run.t, run.x.ravel(), run.v.ravel()]))
    for _ in range(dice.whole(1, 5)):
        _ask(session, dice, parts, run)
    if isinstance(how.get("stream"), Path) and how["stream"].exists():
        _read_back(session, parts, how["stream"], run)
    if run.checkpoints and dice.chance(0.7):  # which may write the same stream anew
        _go_on(session, dice, parts, folder, run.checkpoints[0], t_end, how)
    if dice.chance(0.2):
        # a text that is given for a path is one
        saved = session.do("save", lambda: run.save(dice.value(folder / "saved.h5")))
        if saved is not None:
            _read_back(session, parts, saved, run)


def _kept(simulate: Callable[..., fm.Trajectory], *given: Any, **how: Any) -> fm.Trajectory:
    """A trajectory; of a run that stopped what it computed."""
    try:
        return simulate(*given, **how)
    except SimulationError as stopped:
        if not str(stopped).strip():
            raise
        return stopped.trajectory


def _read_back(session: Session, parts: Parts, path: Path, run: fm.Trajectory) -> None:
    again = session.do("load", lambda: fm.Trajectory.load(path, parts.scene))
    if again is not None and not np.array_equal(again.t, run.t):
        session.finite("rows read back differ", np.array([np.nan]))


def _go_on(
    session: Session, dice: Dice, parts: Parts, folder: Path, checkpoint: fm.Checkpoint, t_end: Any, how: dict[str, Any]
) -> None:
    path = folder / "checkpoint.npz"
    if dice.chance(0.5):
        session.do("checkpoint.save", lambda: checkpoint.save(path))
        checkpoint = session.do("Checkpoint.load", lambda: fm.Checkpoint.load(path)) or checkpoint
    again = {name: value for name, value in how.items() if name not in ("checkpoints", "about")}
    rest = session.do(
        f"restart {again!r:.200}", lambda: _kept(parts.scene.simulate, t_end, restart=dice.value(checkpoint), **again)
    )
    if rest is not None:
        session.finite("rows of the restart", rest.x)


def _ask(session: Session, dice: Dice, parts: Parts, run: fm.Trajectory) -> None:
    """One question of a run."""
    frame = dice.value(dice.one_of(parts.frames))
    body = dice.value(dice.one_of(parts.bodies)) if parts.bodies else None
    c = dice.value(dice.one_of(parts.joints)) if parts.joints else None
    t = dice.options(t=lambda: dice.value(dice.one_of([0.01, [0.0, 0.005], run.t[-1:], np.zeros(0)])))
    questions: list[tuple[str, Callable[[], Any]]] = [
        (name, lambda name=name: getattr(run, name)(frame, **t))
        for name in ("position", "rotation", "velocity", "angular_velocity", "acceleration")
    ]
    questions += [(name, lambda name=name: getattr(run, name)(c, **t)) for name in ("beta", "beta_rate")]
    questions += [(name, lambda name=name: getattr(run, name)(c)) for name in ("reaction", "drive")]
    questions += [(name, lambda name=name: getattr(run, name)(body, **t)) for name in ("q", "q_rate", "stretch")]
    questions += [
        ("energy", lambda: run.energy(**t).total), ("momentum", lambda: run.momentum(**t).linear),
        ("body_motion", lambda: run.body_motion(**t)), ("at", lambda: run.at(dice.value(0.01)).position(frame)),
        ("table", lambda: run.table(**t).values),
        ("table of", lambda: run.table(frame, c, every=_apart(run, dice.value(0.01))).values),
        ("resultants", lambda: run.resultants(body, **t)), ("plan", lambda: run.configuration(dice.value(0.01))),
    ]  # fmt: skip
    if parts.states:
        questions.append(("states", lambda: run.states(dice.one_of(parts.states), **t)))
    if parts.controllers:
        questions.append(("sampled", lambda: run.sampled(dice.one_of(parts.controllers)).inputs))
    name, question = dice.one_of(questions)
    answer = session.do(f"{name} {t!r:.60}", question)
    if answer is not None:
        session.finite(name, answer)


def _apart(run: fm.Trajectory, every: Any) -> Any:
    """That time, or one that makes fewer rows: ten million take their minutes, as they must."""
    some = isinstance(every, float) and every > 0.0 and len(run.t) > 1
    return max(every, float(np.ptp(run.t)) / 1e5) if some and np.isfinite(every) else every


# ------------------------------------------------------------------------------------------------ equilibria, linear


def _balance(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    how = dice.options(t=lambda: dice.value(0.0))
    if dice.chance(0.3):
        how["path"] = session.do(
            "Continuation", lambda: fm.Continuation(to=dice.number(3.0), most_points=dice.value(30))
        )
    point = session.do(f"equilibrium {how!r:.80}", lambda: parts.scene.equilibrium(**how))
    if point is None:
        return
    for one in getattr(point, "points", [point]):
        session.finite("equilibrium", one.x)
    session.do("unstable", lambda: getattr(point, "unstable", None))
    session.do("words of an equilibrium", lambda: repr(point))


def _linear(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    single = [one for one in parts.joints if len(one.joint.velocity_names) == 1]
    how: dict[str, Any] = {}
    if single:
        c = dice.one_of(single)
        kind = force.JointTorque if c.joint.angular[0] else force.JointForce
        inputs = session.do("input", lambda: [kind(c, dice.value(0.0))])
        how = {"inputs": dice.value(inputs), "outputs": dice.value([output.Position(dice.value(c))])}
    how |= dice.options(t=lambda: dice.value(0.0))
    if dice.chance(0.3):
        how["about"] = dice.value(session.do("about", parts.scene.equilibrium))
    linear = session.do(f"linearize {how!r:.120}", lambda: parts.scene.linearize(**how))
    if linear is None:
        return
    for name in ("M", "C", "K"):
        session.finite(f"linear {name}", session.do(f"linear {name}", lambda name=name: getattr(linear, name)))
    for name in ("eigenvalues", "frequencies", "damping_ratios", "shapes"):
        found = session.do(name, getattr(linear, name))
        if found is not None and name != "shapes":
            session.finite(name, found)
    omega = dice.value([1.0, 10.0])
    session.do("state_space", linear.state_space)
    session.do(f"frequency_response {omega!r:.60}", lambda: linear.frequency_response(omega))
    session.do("mode_motion", lambda: linear.mode_motion(dice.value(0), instants=dice.value(5)))


# ------------------------------------------------------------------------------------- variants, words, other programs


def _parameters(dice: Dice, parts: Parts) -> dict[str, Any]:
    rigid = [body for body in parts.bodies if isinstance(body, fm.RigidBody)]
    found: dict[str, Any] = {}
    if rigid:
        found["m"] = parameter.Mass(dice.one_of(rigid))
        found["com"] = parameter.CentreOfMass(dice.one_of(rigid))
    if parts.joints:
        found["speed"] = parameter.InitialVelocity(dice.one_of(parts.joints))
    if parts.forces:
        found["k"] = parameter.OfForce(dice.one_of(parts.forces), dice.value("stiffness"))
    found["p"] = parameter.FrameOrigin(dice.one_of(parts.frames))
    return {name: dice.value(one) for name, one in found.items() if dice.chance(0.5)}


def _variants(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    named = session.do("parameters", lambda: _parameters(dice, parts))
    compiled = session.do(f"compile {named!r:.200}", lambda: parts.scene.compile(parameters=named))
    if compiled is None:
        return
    right = {"m": 1.5, "com": (0.1, 0.0, 0.0), "speed": 0.5, "k": 20.0, "p": (0.1, 0.0, 0.0)}
    values = {name: dice.value(right.get(name, 1.0)) for name in named}
    method = dice.one_of([{}, {"integrator": fm.ExplicitRungeKutta()}])
    run = session.do(
        f"variant {values!r:.200}", lambda: _kept(compiled.simulate, 0.02, max_seconds=SECONDS, **method, **values)
    )
    if run is not None:
        session.finite("rows of a variant", run.x)
    n = dice.whole(1, 4)
    samples = {name: dice.value(np.array([right.get(name, 1.0)] * n)) for name in named}
    outputs = {"end": dice.one_of([lambda run: run.x[-1], lambda run: run.t[-1], lambda run: run.v[-1], failing])}
    if dice.chance(0.3):
        frame, times = dice.one_of(parts.frames), dice.value([0.0, 0.01])
        outputs = {"end": session.do("Sampled", lambda: Sampled(output.Position(frame), times))}
    how = dice.options(file=lambda: dice.value(folder / "study.h5"), workers=lambda: dice.value(2),
                       max_steps=lambda: dice.value(30), rtol=lambda: dice.value(1e-4))  # fmt: skip
    for _ in range(dice.whole(1, 2)):  # a second one goes on with the file
        with ThreadPoolExecutor(2) as pool:
            if dice.chance(0.2):
                how["executor"] = dice.value(pool)
            else:
                how.pop("executor", None)
            study = session.do(
                f"ensemble {samples!r:.120} {how!r:.120}",
                lambda: compiled.ensemble(samples, outputs, t_end=0.02, max_seconds=SECONDS, **method, **how),
            )
            if study is not None:
                session.finite("outputs of an ensemble", study.output("end")[study.done])
                session.do("failures", lambda study=study: [one.message for one in study.failures])
                study.close()


def _words(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    """What is told of a machine before it runs."""
    session.do("explain", parts.scene.explain)
    session.do("repr", lambda: [repr(one) for one in (parts.scene, *parts.bodies, *parts.joints, *parts.forces)])
    start = session.do("start", lambda: parts.scene.start(**dice.options(t=lambda: dice.value(0.0))))
    if start is not None:
        session.finite("start", np.concatenate([start.x, start.v, start.a]))
    session.do("at_start", lambda: parts.scene.at_start().energy().total)


def _files(session: Session, dice: Dice, parts: Parts, folder: Path) -> None:
    """Records for other programs and back."""
    body = dice.value(record(dice.whole(0, 3)))
    kind = dice.one_of([one for one in export.FORMATS if one.read is not None])
    path = folder / f"{kind.name}{kind.suffix}"
    session.do(f"export {kind.name}", lambda: kind.write(body, path, lossy=True))
    if path.exists():
        back = session.do(f"read {kind.name}", lambda: kind.read(path))
        if back is not None:
            session.finite(f"{kind.name} read back", back.frequencies())
    if dice.chance(0.3):
        run = session.do("simulate", lambda: _kept(parts.scene.simulate, 0.01, max_seconds=SECONDS))
        if run is not None:
            times = dice.options(t=lambda: dice.value([0.0, 0.005]))
            session.do(f"vtkhdf {times!r:.60}", lambda: export.vtkhdf(run, folder / "run.vtkhdf", **times))
