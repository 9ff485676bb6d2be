"""Meshed parts with two interfaces as records of reduced bodies, each reduced once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.reduction import ModalDamping, craig_bampton


def _bar(s):
    return meshes.block(0.75 * s, 0.0625 * s, 0.03125 * s, divisions=(6, 1, 1))


def _plate(s):
    return meshes.block(0.5 * s, 0.25 * s, 0.03125 * s, divisions=(4, 2, 1))


def _rod(s):
    widths = {"shank_width_big": 0.08 * s, "shank_width_small": 0.05 * s, "shank_thickness": 0.03 * s}
    bores = {"big_bore": 0.1 * s, "small_bore": 0.06 * s, "big_wall": 0.025 * s, "small_wall": 0.02 * s}
    return meshes.connecting_rod(length=0.5 * s, h=0.05 * s, thickness=0.05 * s, degree=1, **widths, **bores)


#: Meshes of a size (m) of order 1, and their facets "a" and "b".
SHAPES = {"bar": (_bar, "x_min", "x_max"), "plate": (_plate, "x_min", "x_max"), "rod": (_rod, "big_end", "small_end")}


@dataclass(frozen=True)
class Meshed:
    """A part of solid elements between "a" and "b", its body frame on "a", on "b" or on the mean axis (None)."""

    shape: str
    scale: float
    E: float
    rho: float
    modes: int
    damping: float
    frame: str | None

    def build(self):
        return fm.FlexibleBody(self.record())

    def record(self):
        return _record(self)

    def interface(self, name):
        """p, R of an interface in the body frame."""
        found = self.record().interface(name)
        return np.array(found.p_BI_B), np.array(found.R_BI)

    def in_units(self, u):
        E, rho = self.E * u.force / u.length**2, self.rho * u.mass / u.length**3
        return replace(self, scale=self.scale * u.length, E=E, rho=rho)


@cache
def _record(part):
    mesh, *facets = SHAPES[part.shape]
    model = ContinuumModel(
        mesh(part.scale),
        forms.solid_linear,
        forms.solid_linear.Parameters(E=part.E, nu=0.25, rho=part.rho),
        degree=2,
        interfaces=[Interface(name) for name in facets],
    )
    names = dict(zip(facets, "ab", strict=True))
    frame = next((facet for facet, name in names.items() if name == part.frame), None)
    damping = ModalDamping(part.damping) if part.damping else None
    record = craig_bampton(model, modes=part.modes, frame=frame, damping=damping)
    interfaces = tuple(replace(one, name=names[one.name]) for one in record.interfaces)
    return replace(record, interfaces=interfaces, frame=part.frame)
