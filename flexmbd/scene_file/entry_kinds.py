"""The kinds of joints, forces, couplings and integrators that a scene file may name, and the keys of each.

Those of shapes that touch and of the laws of contacts are in `touching`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from flexmbd import force, joint
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta
from flexmbd.integrate.moreau.moreau_jean import MoreauJean
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.scene_file import values as v
from flexmbd.scene_file.values import Names, nearest
from flexmbd.toml_file import TomlSection


@dataclass(frozen=True)
class Key:
    """A key of a kind.

    Attributes:
        read: gives its value.
        argument: what the class calls it, where that is another name.
    """

    read: Callable[[TomlSection, str, Names], object]
    argument: str = ""


@dataclass(frozen=True)
class Kind:
    """A kind of joint, force, coupling, shape or law.

    Attributes:
        make: its class.
        keys: that its table may have.
        needs: those that it must have; None: those whose arguments have no default in the class, a frozen dataclass.
    """

    make: Callable[..., Any]
    keys: Mapping[str, Key]
    needs: tuple[str, ...] | None = None

    @property
    def needed(self) -> tuple[str, ...]:
        """Keys that its table must have."""
        if self.needs is not None:
            return self.needs
        called = {one.argument or key: key for key, one in self.keys.items()}
        return tuple(
            called.get(field.name, field.name)
            for field in dataclasses.fields(self.make)  # type: ignore[arg-type]
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )


def _kind(make: Callable[..., Any], **keys: Callable[[TomlSection, str, Names], object] | Key) -> Kind:
    return Kind(make, {name: key if isinstance(key, Key) else Key(key) for name, key in keys.items()})


_JOINT = Key(v.joint, "connection")
_FROM, _TO = Key(v.frame, "frame_F"), Key(v.frame, "frame_G")
_ENDS = {"from": _FROM, "to": _TO}

JOINTS: dict[str, Kind] = {
    "fixed": _kind(joint.Fixed),
    "revolute": _kind(joint.Revolute, axis=v.axis),
    "prismatic": _kind(joint.Prismatic, axis=v.axis),
    "screw": _kind(joint.Screw, pitch=v.number, axis=v.axis),
    "cylindrical": _kind(joint.Cylindrical, axis=v.axis),
    "planar": _kind(joint.Planar, axis=v.axis),
    "planar_point": _kind(joint.PlanarPoint, axis=v.axis),
    "translation": _kind(joint.Translation),
    "universal": _kind(joint.Universal, first=v.axis, second=v.axis),
    "generic": _kind(joint.Generic, translations=v.text, rotations=v.text),
    "spherical": _kind(joint.Spherical),
    "free": _kind(joint.Free),
    "point_on_line": _kind(joint.PointOnLine, axis=v.axis),
    "point_on_plane": _kind(joint.PointOnPlane, axis=v.axis),
    "distance": _kind(joint.Distance, length=v.number),
    "constant_velocity": _kind(joint.ConstantVelocity, axis=v.axis),
    "rolling_disc": _kind(joint.RollingDisc, radius=v.number),
}

FORCES: dict[str, Kind] = {
    "joint_torque": _kind(force.JointTorque, joint=_JOINT, value=v.time_function),
    "joint_force": _kind(force.JointForce, joint=_JOINT, value=v.time_function),
    "joint_spring": _kind(
        force.JointSpring, joint=_JOINT, stiffness=v.stiffness, rest=v.number, damping=v.number, coordinate=v.whole
    ),
    "plastic_joint_spring": _kind(
        force.PlasticJointSpring,
        joint=_JOINT,
        deformation=v.numbers,
        force=v.numbers,
        rest=v.number,
        kinematic=v.number,
        coordinate=v.whole,
    ),
    "joint_damper": _kind(force.JointDamper, joint=_JOINT, damping=v.number, coordinate=v.whole),
    "joint_stop": _kind(
        force.JointStop,
        joint=_JOINT,
        lower=v.number,
        upper=v.number,
        stiffness=v.number,
        damping=v.number,
        transition=v.number,
        coordinate=v.whole,
    ),
    "joint_friction": _kind(
        force.JointFriction,
        joint=_JOINT,
        coulomb=v.number,
        regularisation=v.number,
        static=v.number,
        stribeck=v.number,
        viscous=v.number,
        coordinate=v.whole,
    ),
    "bearing_friction": _kind(
        force.BearingFriction, joint=_JOINT, coefficient=v.number, regularisation=v.number, radius=v.number
    ),
    "spring_damper": _kind(force.SpringDamper, **_ENDS, stiffness=v.number, length=v.number, damping=v.number),
    "plastic_spring": _kind(
        force.PlasticSpring, **_ENDS, deformation=v.numbers, force=v.numbers, length=v.number, kinematic=v.number
    ),
    "bushing": _kind(force.Bushing, **_ENDS, stiffness=v.six, damping=v.six, symmetric=v.flag),
    "gravitation": _kind(force.Gravitation, bodies=v.solids, G=v.number),
    "between_pairs": _kind(
        force.BetweenPairs, group=v.frames, law=v.function, own=v.rows, data=v.numbers, name=v.text
    ),
    "line_force": _kind(force.LineForce, **_ENDS, value=v.time_function),
    "shaft_inertia": _kind(
        force.ShaftInertia, joint=_JOINT, inertia=v.number, ratio=v.number, coordinate=v.whole
    ),
    "frame_force": _kind(
        force.FrameForce, frame=v.frame, force=v.three_time_functions, torque=v.three_time_functions
    ),
    "distributed_load": _kind(
        force.DistributedLoad, body=v.flexible, load=Key(v.text, "name"), factor=v.time_function
    ),
    "shunt": Kind(
        force.shunt,
        {
            "port": Key(v.port),
            **{
                name: Key(v.number)
                for name in ("resistance", "inductance", "capacitance", "charge", "voltage_scale")
            },
        },
        needs=("port", "resistance"),
    ),
    "joint_law": _kind(force.JointLaw, joint=_JOINT, law=v.function, coordinate=v.whole),
    "state_force": _kind(force.StateForce, law=Key(v.function, "function"), name=v.text),
    "kane_force": _kind(force.KaneForce, law=Key(v.function_of_scene, "function"), name=v.text),
}

COUPLINGS: dict[str, Kind] = {
    "gear": _kind(joint.Gear, first=v.joint, second=v.joint, ratio=v.number),
    "rack_and_pinion": _kind(joint.RackAndPinion, pinion=v.joint, rack=v.joint, radius=v.number),
}

INTEGRATORS: dict[str, Callable[[], Integrator]] = {
    "generalized_alpha": GeneralizedAlpha,
    "radau_iia": RadauIIA,
    "explicit_runge_kutta": ExplicitRungeKutta,
    "central_difference": CentralDifference,
    "energy_momentum": EnergyMomentum,
    "moreau_jean": MoreauJean,
}


def read_kind(section: TomlSection, kinds: Mapping[str, Kind], names: Names, *, also: tuple[str, ...] = ()) -> Any:
    """The kind's name and arguments of a table.

    Args:
        section: a table with the key "kind".
        kinds: to choose from.
        names: of bodies and joints.
        also: keys that the table may have besides those of its kind.

    Returns:
        The name of the kind, and its arguments by the names of the class.
    """
    name = section.text("kind")
    if name not in kinds:
        section.fail("kind", f"{name!r} is not known; {nearest(name, kinds)}")
    section.allow(("kind", *also, *kinds[name].keys))
    return name, read_arguments(section, kinds[name], name, names)


def read_arguments(section: TomlSection, kind: Kind, name: str, names: Names) -> dict[str, object]:
    """The arguments of a kind in a table, by the names of its class."""
    for key in kind.needed:
        if not section.has(key):
            section.fail("", f"has no {key!r}, which a {name} needs")
    keys = kind.keys.items()
    return {one.argument or key: one.read(section, key, names) for key, one in keys if section.has(key)}
