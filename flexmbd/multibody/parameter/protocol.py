"""What a compiled machine asks of a parameter."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from flexmbd.multibody.plan.compiled_scene import CompiledScene


@runtime_checkable
class Parameter(Protocol):
    """A quantity of one body, frame, joint or force that may take other values than those of the scene."""

    @property
    def of(self) -> Any:
        """The body, frame, joint or force."""

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError where the scene has no such quantity, or cannot vary it."""

    def changed(self, now: Any, value: Any) -> Any:
        """A body, frame, joint or force as ``now``, but with this value.

        Raises:
            SceneError: the value is not possible.
        """
