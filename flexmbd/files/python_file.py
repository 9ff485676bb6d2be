"""Python files that a user names beside a scene: run once, and their definitions.

To load one runs what stands in it, as `python file.py` would; nothing else in this room runs a user's code.
"""

from __future__ import annotations

import difflib
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from flexmbd.errors import FlexmbdError, described


@dataclass(frozen=True)
class PythonFiles:
    """Files that are run once each, so that the functions of one share its variables. Not collective.

    Attributes:
        kind: of the errors raised.
    """

    kind: type[FlexmbdError]
    _loaded: dict[Path, ModuleType] = field(default_factory=dict, init=False)

    def value(self, path: Path, name: str) -> Any:
        """The object ``name`` of a file: a function, or an object that a library made of one.

        Raises:
            FlexmbdError: of that kind; the file cannot be read or fails, which is told with its line; there is nothing
                of that name in it.
        """
        found = vars(self._module(path))
        if name not in found:
            own = [one for one in found if not one.startswith("_")]
            near = difflib.get_close_matches(name, own, n=1)
            told = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(own) or 'nothing'}"
            raise self.kind(f"{path} has no function {name!r}; {told}")
        return found[name]

    def _module(self, path: Path) -> ModuleType:
        key = path.absolute()
        if key not in self._loaded:
            self._loaded[key] = self._run(path)
        return self._loaded[key]

    def _run(self, path: Path) -> ModuleType:
        if not path.is_file():
            raise self.kind(f"cannot read {path}: {'it is no file' if path.exists() else 'there is no such file'}")
        spec = importlib.util.spec_from_file_location(path.stem, path.absolute())
        if spec is None or spec.loader is None:
            raise self.kind(f"{path} is no Python file: its name must end in .py")
        module = importlib.util.module_from_spec(spec)
        with _importable(module, path.absolute().parent):
            try:
                spec.loader.exec_module(module)
            except (Exception, SystemExit) as error:
                raise self.kind(f"{path} cannot be run: {described(error)}") from error
        return module


@contextmanager
def _importable(module: ModuleType, folder: Path) -> Iterator[None]:
    """While a file runs it is a module, as dataclasses need it, and may import what lies beside it.

    Afterwards its functions are pickled by value: other processes cannot import them.
    """
    before = sys.modules.get(module.__name__)
    sys.modules[module.__name__] = module
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        if before is None:
            sys.modules.pop(module.__name__, None)
        else:
            sys.modules[module.__name__] = before
