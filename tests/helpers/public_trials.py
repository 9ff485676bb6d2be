"""One public call, with what is wrong for each of its parameters in turn."""

from __future__ import annotations

from collections import defaultdict

from public_calls import Public
from public_examples import right_call
from wrong_values import judged, wrong_for


def faults(public: Public) -> dict[str, list[str]]:
    """By parameter, what was neither an answer nor one clear error; the right call is made first."""
    right_call(public)({})
    found = defaultdict(list)
    for name, parameter in public.parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        for value, wrong in wrong_for(parameter.annotation):
            fault = judged(lambda: right_call(public)({name: value}), public.name, name, value, wrong=wrong)  # noqa: B023
            if fault is not None:
                found[name].append(str(fault))
    return dict(found)
