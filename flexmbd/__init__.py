"""flexmbd: from a UFL form to a body that moves in a machine.

What a user may rely on is what `dir(flexmbd)` shows, and the names in the rooms among it (`flexmbd.joint`,
`flexmbd.reduction`, ...); all else is private and moves without a word.  Nothing loads before it is asked for: the
names of this root, which `flexmbd/names.py` lists, load numpy, scipy and llvmlite, and numba where something is to be
compiled; DOLFINx and PETSc load with `flexmbd.continuum`, `flexmbd.reduction` and `flexmbd.meshes`.
"""

import importlib
import typing

from flexmbd.portraits import draw_with as _draw_with

__version__ = "0.2.0"

_ROOMS = frozenset(
    {
        "beams", "contact", "continuum", "ensemble", "export", "force", "forms", "integrate", "joint", "meshes",
        "output", "parameter", "reduction", "visual",
    }
)  # fmt: skip

_draw_with("flexmbd.visual.portraits")

if typing.TYPE_CHECKING:
    from flexmbd import beams as beams
    from flexmbd import contact as contact
    from flexmbd import continuum as continuum
    from flexmbd import ensemble as ensemble
    from flexmbd import export as export
    from flexmbd import force as force
    from flexmbd import forms as forms
    from flexmbd import integrate as integrate
    from flexmbd import joint as joint
    from flexmbd import meshes as meshes
    from flexmbd import output as output
    from flexmbd import parameter as parameter
    from flexmbd import reduction as reduction
    from flexmbd import visual as visual
    from flexmbd.names import *  # noqa: F403
else:  # hidden from type checkers, for which it would make every misspelt name good

    def __getattr__(name: str) -> typing.Any:
        """A room or a public name that is not loaded yet; Python asks once for each."""
        if name == "__all__":  # what `from flexmbd import *` brings: no room, for they load others' libraries
            return sorted(_public_names())
        if name in _ROOMS:
            return importlib.import_module(f"{__name__}.{name}")
        if not name.startswith("_"):
            globals().update(_public_names())
            if name in globals():
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _public_names() -> dict[str, typing.Any]:
    found = vars(importlib.import_module(f"{__name__}.names"))
    return {name: value for name, value in found.items() if not name.startswith("_")}


def __dir__() -> list[str]:
    """The public names: no module but the rooms."""
    return sorted({*_public_names(), *_ROOMS, "__version__"})
