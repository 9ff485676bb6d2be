"""What a prompt or a notebook shows of the objects that calls return: a line, or a table."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from machines import pendulum

import flexmbd as fm
from flexmbd.files.result_table import ResultTable


def objects():
    scene, bob, hinge = pendulum()
    run = scene.simulate(2.0, checkpoints=[0.5], events=[fm.Event(lambda now: now.beta(hinge) - 4.0)])
    spring = scene.add_force(fm.force.JointSpring(hinge, 1.0))
    return {
        "energy": run.energy(), "momentum": run.momentum(), "checkpoint": run.checkpoints[0], "event": run.events[0],
        "equilibrium": scene.equilibrium(), "body": bob, "joint": hinge, "frame": bob.frame(), "spring": spring,
        "stats": run.stats, "run": run, "compiled": fm.compiled(lambda t: t),
    }  # fmt: skip


OBJECTS = objects()


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_is_shown_in_a_line(name):
    text = repr(OBJECTS[name])
    assert len(text) <= 450
    assert "\n" not in text
    assert type(OBJECTS[name]).__name__ in text


def test_arrays_are_told_by_their_shapes():
    text = repr(OBJECTS["energy"])
    assert f"kinetic=<array ({len(OBJECTS['run'].t)},)>" in text


@pytest.mark.parametrize(("rows", "columns"), [(3, 2), (10, 8), (11, 9), (500, 30)])
def test_a_table_is_a_table_in_a_notebook(rows, columns):
    names = tuple(f"a<{k}>" for k in range(columns))
    table = ResultTable(names, ("m",) * columns, np.arange(rows * columns, dtype=float).reshape(rows, columns))
    root = ET.fromstring(table._repr_html_())
    lines = [[cell.text for cell in line] for line in root.iter("tr")]
    shown = min(columns, 8)
    assert lines[:2] == [list(names[:shown]), ["[m]"] * shown]
    assert lines[2] == [f"{k:g}" for k in range(shown)]
    assert lines[-1] == [f"{(rows - 1) * columns + k:.6g}" for k in range(shown)]
    assert len(lines) == (2 + rows if rows <= 10 else 13)
    assert (rows <= 10) or lines[9] == [f"... {rows - 10} more rows ..."]
    more = [line.text for line in root.iter("p")]
    assert more == ([] if columns <= 8 else [f"and {columns - 8} more columns: " + more[0].partition(": ")[2]])
