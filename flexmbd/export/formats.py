"""The formats by name, for `flexmbd export --to NAME` and `flexmbd convert`.

One line a format; each writer and reader stands in a file of its own and loads what it needs when it is called.
A format of one's own is a file anywhere, whose path takes the place of a name.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from flexmbd.errors import ExportError
from flexmbd.export.exudyn_files.exudyn_file import CAPABILITIES as _EXUDYN
from flexmbd.export.exudyn_files.exudyn_file import exudyn
from flexmbd.export.exudyn_files.exudyn_reader import read_exudyn
from flexmbd.export.functional_mockup.reduced_unit import CAPABILITIES as _FMU
from flexmbd.export.functional_mockup.reduced_unit import fmu
from flexmbd.export.loss import Capabilities
from flexmbd.export.mbdyn_files.mbdyn_deck import mbdyn_deck
from flexmbd.export.mbdyn_files.mbdyn_file import CAPABILITIES as _MBDYN
from flexmbd.export.mbdyn_files.mbdyn_file import mbdyn
from flexmbd.export.mbdyn_files.mbdyn_reader import read_mbdyn
from flexmbd.export.record_arrays import CAPABILITIES as _NPZ
from flexmbd.export.record_arrays import npz, read_npz
from flexmbd.export.sid_files.sid_file import CAPABILITIES as _SID
from flexmbd.export.sid_files.sid_file import read_sid, sid
from flexmbd.export.superelements.calculix_file import CAPABILITIES as _CALCULIX
from flexmbd.export.superelements.calculix_file import calculix, read_calculix
from flexmbd.export.superelements.dmig_file import CAPABILITIES as _DMIG
from flexmbd.export.superelements.dmig_file import dmig, read_dmig
from flexmbd.export.superelements.extptfm_file import CAPABILITIES as _OPENFAST
from flexmbd.export.superelements.extptfm_file import openfast, read_openfast
from flexmbd.export.superelements.op4_file import CAPABILITIES as _OP4
from flexmbd.export.superelements.op4_file import op4, read_op4
from flexmbd.export.superelements.simscape_file import CAPABILITIES as _SIMSCAPE
from flexmbd.export.superelements.simscape_file import read_simscape, simscape
from flexmbd.export.vtkhdf_file import CAPABILITIES as _VTKHDF
from flexmbd.export.vtkhdf_file import vtkhdf_modes
from flexmbd.given import checked
from flexmbd.record.reduced_body import ReducedBody

#: (body, path, lossy=...) -> what the file leaves out, a phrase each.
Writer = Callable[..., tuple[str, ...]]
Reader = Callable[[str | Path], ReducedBody]


@dataclass(frozen=True)
class Format:
    """A file format of reduced bodies.

    Attributes:
        name: as the command line says it, and the writer's name in `flexmbd.export`.
        programs: who reads it.
        suffix: the usual suffix of a file's name.
        capabilities: the parts of a body that it can carry.
        write: the writer, callable as ``write(body, path, lossy=False)``.
        read: the reader, or None where the format does not hold a whole body.
        digits: significant digits that a body keeps which is written and read back.
        deck: writes an input deck that runs the file, ``deck(body, file, path)``, or None.
    """

    name: str
    programs: str
    suffix: str
    capabilities: Capabilities
    write: Writer
    read: Reader | None = None
    digits: int = 9
    deck: Callable[..., object] | None = None


FORMATS: tuple[Format, ...] = (
    Format("npz", "numpy", ".npz", _NPZ, npz, read_npz, digits=15),
    Format("simscape", "Simscape Multibody, Matlab, Octave", ".mat", _SIMSCAPE, simscape, read_simscape, digits=11),
    Format("dmig", "Nastran, OptiStruct, Radioss", ".pch", _DMIG, dmig, read_dmig, digits=8),
    Format("calculix", "CalculiX, Abaqus", ".inp", _CALCULIX, calculix, read_calculix, digits=10),
    Format("openfast", "OpenFAST's ExtPtfm", ".dat", _OPENFAST, openfast, read_openfast, digits=10),
    Format("op4", "Nastran", ".op4", _OP4, op4, read_op4, digits=11),
    Format("fmu", "importers of FMI 3, as Simulink, Dymola, FMPy", ".fmu", _FMU, fmu),
    Format("mbdyn", "MBDyn", ".fem", _MBDYN, mbdyn, read_mbdyn, digits=10, deck=mbdyn_deck),
    Format("exudyn", "Exudyn", ".npz", _EXUDYN, exudyn, read_exudyn, digits=12),
    Format("sid", "SIMPACK, DLR FlexibleBodies, EMBSlib", ".SID_FEM", _SID, sid, read_sid, digits=12),
    Format("vtkhdf_modes", "ParaView, VTK", ".vtkhdf", _VTKHDF, vtkhdf_modes),
)


@checked(error=ExportError)
def format_named(name: str) -> Format:
    """The format of that name, or FORMAT of a Python file where the name ends in .py.

    Raises:
        ExportError: there is none; the message lists those there are, or says what is wrong with the file.
    """
    for one in FORMATS:
        if one.name == name:
            return one
    if name.endswith(".py"):
        return _format_in(Path(name))
    raise ExportError(
        f"there is no format {name!r}; choose from {', '.join(one.name for one in FORMATS)}, or give the path of a "
        "Python file with a format of your own"
    )


def _format_in(path: Path) -> Format:
    try:
        names = runpy.run_path(str(path))
    except (OSError, SyntaxError, ImportError) as error:
        raise ExportError(f"{path} cannot be imported: {error}") from error
    found = names.get("FORMAT")
    if not isinstance(found, Format):
        raise ExportError(f"{path} has no FORMAT = fm.export.Format(...) (docs/extending.md)")
    return found
