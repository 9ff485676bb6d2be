"""Scenes in TOML files: bodies, joints, forces, a simulation and its results, without a line of Python.

``read_scene(path)`` gives the description, ``build(description)`` the ``System``; docs/command_line.md has the keys.
"""

from flexmbd.scene_file.reading import read_scene as read_scene
from flexmbd.scene_file.result_columns import plan_columns as plan_columns
from flexmbd.scene_file.result_columns import tabulate as tabulate
from flexmbd.scene_file.scene_builder import Built as Built
from flexmbd.scene_file.scene_builder import build as build
from flexmbd.scene_file.scene_description import SceneFile as SceneFile
from flexmbd.scene_file.scene_sweep import SceneSweep as SceneSweep
