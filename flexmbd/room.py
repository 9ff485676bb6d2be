"""What ``from flexmbd.room import *`` brings of a room of files: its public names, and none of its files.

Every ``__init__`` of a public room may import it; it imports nothing of flexmbd.
"""

from collections.abc import Mapping
from types import ModuleType
from typing import Any


def public_names(namespace: Mapping[str, Any]) -> list[str]:
    """For ``__all__``, of an ``__init__``'s ``globals()``: a file ``modes.py`` would hide a user's own ``modes``."""
    return [name for name, value in namespace.items() if not name.startswith("_") and not isinstance(value, ModuleType)]
