"""What holds for every format: what is not a reduced body is refused by name, and nothing is written."""

from dataclasses import replace

import numpy as np
import pytest
from exported_bodies import soft_bar
from particles import particle_body, polynomial

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import check_losses
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.groups import (
    GROUPS,
    DistributedLoads,
    FurtherUnknowns,
    GeometricStiffness,
    Gyroscopic,
    Heat,
    ModalStretch,
    NodalInterfaces,
    NodalModes,
    Ports,
    StressModes,
)


@pytest.mark.parametrize("one", fm.export.FORMATS, ids=lambda one: one.name)
@pytest.mark.parametrize("make", [fm.System, lambda: fm.FlexibleBody(soft_bar())], ids=["System", "FlexibleBody"])
def test_only_reduced_bodies_are_written(tmp_path, one, make):
    with pytest.raises(ExportError, match=r"take a ReducedBody, .* not a (System|FlexibleBody); a whole System"):
        one.write(make(), tmp_path / f"body{one.suffix}")
    assert not list(tmp_path.iterdir())


#: What a format has to be able to carry, or a loss is told; a surface is for pictures, which no program asks for.
CARRIED = {
    "modes": "nodes", "nodal": "nodal_interfaces", "unknowns": "unknowns", "geometric": "stiffening",
    "stretch": "stiffening", "nonlinear": "nonlinear", "gyroscopic": "gyroscopic", "loads": "loads", "ports": "ports",
    "heat": "heat", "stress": "stress", "contact": "contact",
}  # fmt: skip


def optional_parts():
    """Of a body of two modes."""
    phi, half = np.zeros((3, 3, 2)), np.array([[0.0, 1.0], [-1.0, 0.0]])
    nodes, x = np.arange(3), np.zeros((3, 3))
    return {
        "modes": NodalModes(nodes, x, phi),
        "nodal": NodalInterfaces(("weld",), nodes, x, np.zeros(3, int), phi),
        "unknowns": FurtherUnknowns(nodes, np.zeros((3, 2))),
        "geometric": GeometricStiffness(("B.x",), np.zeros((1, 2, 2))),
        "stretch": ModalStretch(np.zeros((3, 2)), np.zeros((3, 2, 2))),
        "nonlinear": polynomial(None, np.zeros((2, 6, 2))),
        "gyroscopic": Gyroscopic(np.zeros(3), np.zeros((3, 2)), half),
        "loads": DistributedLoads(("gas",), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 2))),
        "ports": Ports(("a",), ("voltage",), ("V",), ("charge",), ("C",), np.zeros((1, 2)), np.eye(1)),
        "heat": Heat(("warm",), nodes, np.ones((1, 3))),
        "stress": StressModes(nodes, x, np.zeros(3), np.zeros((3, 6, 2))),
        "contact": ContactPatches(
            ("tooth",), np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], np.ones(1), np.zeros((1, 3, 2)), np.eye(3),
            np.zeros((0, 3), int), np.zeros(0, int),
        ),
    }  # fmt: skip


def test_each_part_of_a_record_is_carried_or_told():
    """One part after another."""
    parts = optional_parts()
    assert {*CARRIED, "surface"} == set(GROUPS)
    assert set(CARRIED) == set(parts)
    bare = replace(particle_body(1, modes=2).record, **dict.fromkeys(GROUPS))
    for one in fm.export.FORMATS:
        before = check_losses(bare, one.capabilities, kind=one.name, lossy=True)
        for group, capability in CARRIED.items():
            body = replace(bare, **{group: parts[group]})
            told = set(check_losses(body, one.capabilities, kind=one.name, lossy=True)) - set(before)
            assert bool(told) != getattr(one.capabilities, capability), (one.name, group, told)
