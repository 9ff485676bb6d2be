"""The errors flexmbd raises; each names the thing at fault and the remedy.

Numpy-free leaf: every room of the house may import it. What stops a simulation is in `flexmbd.run.stopped`, with
the trajectory that it keeps.
"""

import os
import sys
import sysconfig
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

_PACKAGE = f"{Path(__file__).parent}{os.sep}"


class FlexmbdError(Exception):
    """Base class of all errors raised on purpose by flexmbd.

    Catch it to catch them all; the message of each names the thing at fault and the remedy.
    """


class VersionError(FlexmbdError, ImportError):
    """DOLFINx is older or newer than flexmbd knows.

    Remedy: run in the environment that ``./run`` makes, or install a version that the message names.
    """


class MissingLibraryError(FlexmbdError, ImportError):
    """A library is not installed that this part of flexmbd needs, as DOLFINx for all that has a mesh.

    Remedy: install it as the message says; machines of rigid bodies and of saved records need none.
    """


class FormulationError(FlexmbdError):
    """A form file breaks the contract; the message lists every violation.

    Remedy: mend what is listed; ``flexmbd check my_form.py`` tries the form on small problems.
    """


class MeshError(FlexmbdError):
    """A mesh cannot be built, read, or lacks a named group.

    Remedy: look at the mesh: the names of its groups, its unit of length, the size and shape of its cells.
    """


class InterfaceError(FlexmbdError):
    """An interface cannot carry a six-dof frame, or no interface has that name.

    Remedy: give it facets or points that are not all in one line, or one of the names in the message.
    """


class ReductionError(FlexmbdError):
    """A reduction was asked for something impossible, or failed its own accuracy check.

    Remedy: look for a part that is connected to nothing and for cells without volume, or ask for other modes.
    """


class ConvergenceError(FlexmbdError):
    """An iterative solver (eigenvalues, Newton) stopped before its tolerance was met.

    Remedy: shorter steps of the load or of time, another start, or a wider tolerance.
    """


class PathError(ConvergenceError):
    """A path of equilibria, or a slow loading, that could not be followed to its end.

    Remedy: the message says where it stopped and why; shorter steps, or another start.

    Attributes:
        path: the path found so far: an ``EquilibriumPath`` of a machine, of a body a ``StaticPath`` or a ``BodyPath``.
    """

    def __init__(self, message: str, path: Any = None) -> None:
        super().__init__(message)
        self.path = path


class RecordError(FlexmbdError):
    """A reduced-body file is truncated, foreign, of another version, or lacks an optional group.

    So of files of trajectories and checkpoints.  Remedy: write it again, with the group that the message names.
    """


class ExportError(FlexmbdError):
    """A body cannot be carried by another program's file, or such a file cannot be written or read.

    Remedy: the message says what the format cannot carry; reduce the body otherwise, or take another format.
    """


class SceneError(FlexmbdError):
    """A scene is not well formed: a body, frame, joint or force does not fit.

    So is an argument with a wrong value.  Remedy: the message names the thing and what is wanted in its place.
    """


class OutOfMemoryError(FlexmbdError, MemoryError):
    """The request needs more memory than there is, or than the process may have (ulimit -v).

    Remedy: fewer modes, rows or bodies; an explicit method, which keeps no matrix; several ranks for a large part.
    """


class EnsembleError(FlexmbdError):
    """An ensemble was broken off, for a worker of its executor died.

    Remedy: fewer workers at once, if memory ran out; the message says why it died, where that is known, and at which
    variants.

    Attributes:
        variants: numbers, from 0, of those that the worker had, or may have had where its executor does not tell.
    """

    def __init__(self, message: str, variants: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.variants = variants


class AssemblyError(FlexmbdError):
    """The mechanism cannot be assembled: constraints contradict each other or the start.

    Remedy: place bodies nearer to where the loops close, or leave out the joint or motion of the message.
    """


class PictureError(FlexmbdError):
    """A picture or film was asked for something impossible, or cannot be written.

    Remedy: another path or suffix, or the library that the message names.
    """


class StartWarning(UserWarning):
    """A machine's start is consistent, but not the given one: closing loops bends bodies or changes velocities.

    Remedy: place the bodies so that the loops close, or mend the lengths of parts that do not meet; set no more
    velocities than the machine has freedoms.
    """


class PathWarning(UserWarning):
    """A path of equilibria ended before the load factor that was asked for; the path up to there is kept.

    Remedy: the message says whether the load has a maximum below it, or the path was broken off.
    """


class EquilibriumWarning(UserWarning):
    """An equilibrium that was found is unstable, or lies beyond a place where paths of equilibria turn or cross.

    Remedy: ``stable=True`` searches downhill; ``path=fm.Continuation(to=...)`` follows the equilibria as the load
    grows.
    """


class TableWarning(UserWarning):
    """A table's cubics would leave the range of its points by more than that range, as beside a jump: it is monotone.

    Remedy: ``monotone=True`` if that is meant, else more points beside the jump.
    """


class PulseWarning(UserWarning):
    """A Python function of time did something within a step of the run that no stage of the step saw.

    Remedy: ``fm.Piecewise(function, breaks=[...])``, ``fm.compiled(function, breaks=[...])`` or a smaller ``max_step``.
    """


class LockingWarning(UserWarning):
    """Cells of displacements alone may be too stiff: linear ones that bend, or a material that hardly changes volume.

    Told where a body is reduced, and of one with history before it moves. Remedy: ``degree=2``, more cells through the
    thickness, a form whose cells bend (``solid_enhanced``, walls), or one for nearly incompressible solids.
    """


class UnitWarning(UserWarning):
    """A density, or the speed of waves in a material, is that of no material in SI units.

    Remedy: m, kg, s, N and Pa throughout: 7850 kg/m^3 and 2.1e11 Pa for steel, lengths in m.
    """


class EventWarning(UserWarning):
    """An event's function passes through zero several times in a step, so that passages may be missed.

    Remedy: a smaller ``max_step``.
    """


class MeshWarning(UserWarning):
    """A file holds more than the mesh that was made of it: elements beside the solids, sets that overlap.

    Remedy: name the parts that are meant, by ``solids``, ``cell_groups`` and ``facet_groups``.
    """


class RangeWarning(UserWarning):
    """A reduced body is used beyond the range of its shapes: bent further than compared, or spun without modes.

    Or a contact beyond that of its law: pressed half-way to the middle of a shape.

    Remedy: reduce it for the range of loads that it sees, cut it in several pieces, or give it a mode or more; of a
    contact a stiffer law, or a thicker shape.
    """


class DamageWarning(UserWarning):
    """A part of a file is not as it was written; it is left out, and computed again.

    Remedy: look at the disk, and at whoever else writes to the file.
    """


class ResolutionWarning(UserWarning):
    """Cells do not resolve the band in which a body is damaged: cracks take too much work of fracture.

    Remedy: cells of a third of the form's length where it breaks, or a longer length.
    """


class StepsWarning(UserWarning):
    """Steps do not suit the machine: far more of an explicit method than its motion asks for, or too long fixed ones.

    Remedy: an implicit method, as ``integrator=fm.RadauIIA()``; of fixed steps shorter ones, or ``rtol`` without h.
    """


class ToleranceWarning(UserWarning):
    """A body with history is further off by its updates in time than the run's ``rtol`` asks for.

    Remedy: a smaller ``max_step``, or a form whose updates are of higher order.
    """


class ExplicitRunError(FlexmbdError):
    """An explicit run of a body by itself stopped early: a cell is inverted, or the step is too long.

    Remedy: a shorter step, or less load at once.
    """


class ModesWarning(UserWarning):
    """A reduction kept more modes than asked for, since some have equal frequencies.

    Nothing is wrong: a part of such modes would depend on the directions of the axes.
    """


_told: ContextVar[set[str] | None] = ContextVar("told", default=None)


@contextmanager
def told_once(told: set[str] | None = None) -> Iterator[None]:
    """Inside, each subject is warned of once: where one machine is asked at one speed after the other.

    Args:
        told: subjects that were warned of, where it goes on later; those from here on are added.
    """
    before = _told.set(set() if told is None else told)
    try:
        yield
    finally:
        _told.reset(before)


def warn(text: str, category: type[Warning], *, subject: str = "") -> None:
    """Warn at the caller's line that entered the package, however deep inside the cause was found.

    Args:
        text: what is told.
        category: of the warning.
        subject: what it is about, where `told_once` is to count; without it each text is told.
    """
    told = _told.get()
    if subject and told is not None:
        if subject in told:
            return
        told.add(subject)
    depth, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(text, category, stacklevel=depth)


@contextmanager
def memory_told(doing: str) -> Iterator[None]:
    """Tell of memory that is not there by one error that says what wanted it, where numpy's names an array alone.

    Raises:
        OutOfMemoryError: in the place of a MemoryError.
    """
    try:
        yield
    except OutOfMemoryError:  # told already
        raise
    except MemoryError as reason:
        raise out_of_memory(doing, reason) from reason


def out_of_memory(doing: str, reason: MemoryError) -> OutOfMemoryError:
    """The error that tells of a MemoryError."""
    return OutOfMemoryError(f"{doing}: there is no memory for it: {str(reason) or 'python got none'}")


def described(error: BaseException) -> str:
    """An error in one line: flexmbd's own by its text, another with its kind and the user's line that it came from.

    ``KeyError("boom")`` alone would read ``'boom'``.
    """
    if isinstance(error, FlexmbdError):
        return str(error)
    if isinstance(error, SyntaxError) and error.filename is not None and error.lineno is not None:
        return f"{type(error).__name__}: {error.msg} ({Path(error.filename).name}, line {error.lineno})"
    text = " ".join(str(error).split())
    told = f"{type(error).__name__}: {text}" if text else type(error).__name__
    place = _users_line(error)
    return f"{told} ({place})" if place else told


def _users_line(error: BaseException) -> str:
    """File and line of the innermost call that neither flexmbd nor another library made; empty where there is none."""
    libraries = (_PACKAGE, *(sysconfig.get_path(one) for one in ("stdlib", "platstdlib", "purelib", "platlib")), "<")
    libraries += ("/usr/lib/python3",)
    for step in reversed(traceback.extract_tb(error.__traceback__)):
        if not step.filename.startswith(libraries):
            return f"{Path(step.filename).name}, line {step.lineno}"
    return ""
