"""A formulation by one of its elements alone: on each the suite compiles an involved law for half a minute."""

from types import ModuleType
from typing import Any

from flexmbd.continuum.contract.formulation import orders


def one_element(form: Any, cell: str, degree: int) -> ModuleType:
    """The same form file, which has only cells of that kind and elements of that degree."""
    module = ModuleType(form.__name__)
    vars(module).update(vars(form), CELLS=(cell,), ORDER={degree: orders(form, cell)[degree]})
    return module
