"""The site's reference: every public name once, on the page of its kind, from its docstring."""

from __future__ import annotations

import importlib
import inspect
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

#: Pages by file: title, names of the root, and rooms of which all public names stand there.
PAGES = {
    "system": (
        "Systems",
        "System CompiledMachine Runnable CompiledScene Start WorkingPoint Instant Team LinearizedMachine "
        "StateSpace Input Controller Measurement States StateEquation Followed campbell Campbell "
        "CriticalSpeed FirstOrderMachine Continuation EquilibriumPath CriticalPoint CriticalKind PathEnd",
        "parameter output",
    ),
    "running": (
        "Simulations and results",
        "Trajectory ResultTable Momentum Energy Stats Departure RunSettings Event Moment Direction Occurrence "
        "ControllerSamples Checkpoint SteppedMachine SteppedState Recording BodyRecording load_recording "
        "SimulationError SimulationInterrupted",
        "ensemble",
    ),
    "integrators": (
        "Integrators",
        "GeneralizedAlpha AlphaFamily RadauIIA ExplicitRungeKutta "
        "Pair Tableau Rotations CentralDifference EnergyMomentum MoreauJean",
        "integrate",
    ),
    "bodies": (
        "Bodies and frames",
        "Body Ground RigidBody PointMass FlexibleBody Frame "
        "Axis DrawnBody PseudoRigidBody PseudoRigidSwarm SwarmEnergy SwarmContacts "
        "HomogeneousEnergy StVenantKirchhoff CompiledEnergy polar Solid Outline Shape ContinuumBody ExactBeam "
        "thermal_strain Interior "
        "InteriorFrame InteriorMesh "
        "InteriorFields InteriorModes LinearInterior InteriorIteration ObservedInterior "
        "FrameMotion Push Scheme Memory TimeFactor TouchingInterior ReducedTouchingInterior "
        "Obstacle FacingSurface ReducedFacets",
        "beams",
    ),
    "joints": ("Joints", "Way Multipliers Penalty AugmentedLagrangian", "joint"),
    "forces": (
        "Forces and functions of time",
        "Table Beyond Sine Motion Piecewise Switched Signal TimeFunction compiled Compiled "
        "Port PortFlow InducedFlow StrainFlow PortSeries",
        "force",
    ),
    "contact": ("Contact", "", "contact"),
    "record": (
        "Reduced bodies",
        "ReducedBody InterfaceFrame Coupling ContactPatches DistributedLoads Heat Ports FurtherUnknowns "
        "GeometricStiffness Gyroscopic ModalStretch NodalInterfaces NodalModes NonlinearStiffness StressModes "
        "StressField Surface YieldMonitor YieldHistory YieldPoint Slab "
        "hot_spots HotSpot StressMeasure "
        "yielding_slabs",
        "",
    ),
    "continuum": ("The continuum", "", "continuum"),
    "reduction": ("The reduction", "", "reduction"),
    "forms": ("Forms", "", "forms"),
    "meshes": ("Meshes", "", "meshes"),
    "export": ("Exports", "", "export"),
    "visual": ("Pictures", "", "visual"),
    "errors": (
        "Errors and warnings",
        "FlexmbdError AssemblyError ConvergenceError EnsembleError ExportError FormulationError InterfaceError "
        "MeshError MissingLibraryError OutOfMemoryError PathError PictureError RecordError ReductionError SceneError "
        "VersionError EquilibriumWarning EventWarning DamageWarning LockingWarning MeshWarning ModesWarning "
        "PathWarning PulseWarning RangeWarning ResolutionWarning StartWarning StepsWarning TableWarning "
        "ToleranceWarning UnitWarning",
        "",
    ),
}


def write_pages(folder: Path) -> None:
    """Write the pages and their index into a folder of the site's sources.

    Raises:
        LookupError: a public name of the root stands on no page, or a page names what is not public.
    """
    root = importlib.import_module("flexmbd")
    told = {name for _, names, rooms in PAGES.values() for name in f"{names} {rooms}".split()}
    public = {name for name in dir(root) if not name.startswith("_")}
    if told != public:
        raise LookupError(
            f"the reference and the public names differ by {sorted(told ^ public)}; see tools/reference.py"
        )
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shown = {id(getattr(root, name)) for _, names, _ in PAGES.values() for name in names.split()}
    for file, (title, names, rooms) in PAGES.items():
        parts = [f"# {title}", *(_entry("flexmbd", name, getattr(root, name)) for name in names.split())]
        for room in rooms.split():
            parts += _room(importlib.import_module(f"flexmbd.{room}"), shown)
        (folder / f"{file}.md").write_text("\n\n".join(parts) + "\n")
    index = "# Reference\n\nWhat `import flexmbd as fm` gives, by kind.\n\n```{toctree}\n"
    (folder / "index.md").write_text(index + "\n".join(PAGES) + "\n```\n")


def _room(room: ModuleType, shown: set[int]) -> Iterator[str]:
    """A room's own text, and what it offers that was not shown before: classes and functions, or whole modules."""
    yield f"## {room.__name__}"
    yield f"```{{eval-rst}}\n.. automodule:: {room.__name__}\n   :no-members:\n   :ignore-module-all:\n```"
    for name in sorted(vars(room)):
        thing = vars(room)[name]
        own = getattr(thing, "__module__", "") or ""
        if name.startswith("_") or id(thing) in shown:
            continue
        shown.add(id(thing))
        if own.startswith("flexmbd"):
            yield _entry(room.__name__, name, thing)
        elif room.__name__ == "flexmbd.forms" and inspect.ismodule(thing) and room.__name__ in thing.__name__:
            yield f"```{{eval-rst}}\n.. automodule:: {thing.__name__}\n   :no-members:\n```"


def _entry(place: str, name: str, thing: Any) -> str:
    kind = "autoclass" if inspect.isclass(thing) else "autofunction" if callable(thing) else "autodata"
    return f"```{{eval-rst}}\n.. {kind}:: {place}.{name}\n```"
