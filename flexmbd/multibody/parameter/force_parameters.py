"""Parameters of force elements."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from flexmbd.errors import SceneError
from flexmbd.given import refuse_no_name, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, RigidBody
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.plan.compiled_scene import CompiledScene


@dataclass(frozen=True, eq=False)
class OfForce:
    """An argument of a force element by its name, as OfForce(spring, "stiffness"): a number, array or function of time.

    Attributes:
        force: a force element of the scene, a dataclass as all of `flexmbd.force` are.
        argument: name of one of its arguments.
    """

    force: Force
    argument: str

    @property
    def of(self) -> Force:
        """The force element."""
        return self.force

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this force, and it such an argument, which says where it acts not."""
        refuse_other(self.force, Force, "the force of a parameter OfForce", wanted="what scene.add_force() gives")
        refuse_no_name(self.argument, "the argument of a parameter OfForce")
        if self.force not in scene.index.forces:
            raise SceneError(f"this {type(self.force).__name__} is not in the scene")
        arguments = self._arguments()
        if self.argument not in arguments:
            raise SceneError(
                f"{type(self.force).__name__} has no argument {self.argument!r} to vary; it has {', '.join(arguments)}"
            )

    def changed(self, now: Force, value: Any) -> Force:
        """The force element with this argument."""
        return replace(now, **{self.argument: value})  # type: ignore[type-var]

    def _arguments(self) -> list[str]:
        """Names of what may vary."""
        if not is_dataclass(self.force):
            return []
        given = {field.name: getattr(self.force, field.name) for field in fields(self.force) if field.init}
        return [name for name, value in given.items() if not _is_of_scene(value)]


def _is_of_scene(value: Any) -> bool:
    """Whether a value says where a force acts: parts of the scene, or a list of them."""
    several = value if isinstance(value, list | tuple) and value else [value]
    return any(isinstance(one, Frame | Connection | FlexibleBody | RigidBody) for one in several)
