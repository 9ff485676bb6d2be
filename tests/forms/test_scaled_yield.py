"""The tangent of unloading needs the yield limit, which a form tells by `scaled_yield` and by no parameter's name."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import forms, meshes
from flexmbd.continuum import NonlinearModel
from flexmbd.continuum.contract.formulation import load_form
from flexmbd.continuum.contract_suite.history_checks import unloading
from flexmbd.continuum.contract_suite.history_trial import history_trials
from flexmbd.errors import FormulationError

J2 = forms.j2_plasticity

# J2 plasticity with the yield stress called sigma_y.
RENAMED = '''
from dataclasses import dataclass, replace
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms.j2_plasticity import CELLS, ORDER, REFERENCE, element, kinetic_energy, rigid_motion

@dataclass(frozen=True)
class Parameters:
    E: float
    nu: float
    rho: float
    sigma_y: float
    H: float

class _Own:
    def __init__(self, p):
        self.E, self.nu, self.rho, self.yield_stress, self.kinematic_modulus = p.E, p.nu, p.rho, p.sigma_y, 0.0
        self.hardening = object.__new__(j2.LinearHardening)
        object.__setattr__(self.hardening, "modulus", p.H)

def state(p): return j2.state(_Own(p))
def residual(u, v, state, p): return j2.residual(u, v, state, _Own(p))
def update(u, state, p): return j2.update(u, state, _Own(p))
def stress(u, state, p): return j2.stress(u, state, _Own(p))

@dataclass(frozen=True)
class Reference:
    parameters: Parameters
    yielding = (Parameters(2e9, 0.3, 7800.0, 1e7, 1e8),)
    def displacement(self, x): return j2.reference().displacement(x)
    def body_force(self, x): return j2.reference().body_force(x)

def reference():
    r = j2.reference().parameters
    return Reference(Parameters(r.E, r.nu, r.rho, r.yield_stress, 1e9))
'''
RAISED = "\ndef scaled_yield(p, factor): return replace(p, sigma_y=factor * p.sigma_y)\n"


def dense(matrix):
    return matrix.getValues(range(matrix.getSize()[0]), range(matrix.getSize()[1]))


def pulled(form, parameters):
    """A cube that has yielded in a pull: the elastic stiffness before, and the body."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF, cell="hexahedron", degree=1)
    body = NonlinearModel(mesh, form, parameters, degree=1, cell_means=False)
    elastic = dense(body.tangent(np.zeros(body.layout.n_local)))
    u = np.zeros(body.layout.n_local)
    for axis, strain in enumerate((0.02, -0.008, -0.008)):
        u[body.displacement_dofs[:, axis]] = strain * body.layout.node_x[:, axis]
    body.force(u)
    body.commit(u)
    return body, elastic


def own_form(tmp_path: Path, text: str) -> ModuleType:
    path = tmp_path / f"renamed_{abs(hash(text))}.py"
    path.write_text(text)
    return load_form(path)  # type: ignore[return-value]


@pytest.mark.parametrize(
    "hardening",
    [
        J2.LinearHardening(1e8),
        J2.VoceHardening(1e7, 50.0, 1e7),
        J2.TabulatedHardening((0.0, 0.01, 0.1), (1e7, 1.2e7, 1.5e7)),
    ],
    ids=["linear", "Voce", "table"],
)
def test_what_has_yielded_unloads_elastically(hardening):
    """Of small strains the tangent is that of the unstrained cube, and the material is the same as before."""
    parameters = J2.Parameters(E=2e9, nu=0.3, rho=7800.0, yield_stress=1e7, hardening=hardening)
    body, elastic = pulled(J2, parameters)
    loading = dense(body.tangent(1e-3 * body.displacement))
    assert abs(loading - elastic).max() > 0.01 * abs(elastic).max()
    np.testing.assert_allclose(dense(body.unloading_tangent()), elastic, atol=1e-12 * abs(elastic).max())
    np.testing.assert_array_equal(dense(body.tangent(1e-3 * body.displacement)), loading)


def test_a_yield_limit_by_any_name(tmp_path):
    form = own_form(tmp_path, RENAMED + RAISED)
    body, elastic = pulled(form, form.Parameters(2e9, 0.3, 7800.0, 1e7, 1e8))
    np.testing.assert_allclose(dense(body.unloading_tangent()), elastic, atol=1e-12 * abs(elastic).max())


def test_a_form_that_does_not_tell_its_limit_is_refused_where_it_is_needed(tmp_path):
    form = own_form(tmp_path, RENAMED)
    body, _ = pulled(form, form.Parameters(2e9, 0.3, 7800.0, 1e7, 1e8))
    with pytest.raises(FormulationError, match=r"does not give its yield limit, .*; give it scaled_yield\(p, factor\)"):
        body.unloading_tangent()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("def scaled_yield(p): return p\n", "scaled_yield must take 2 positional arguments"),
        ("def scaled_yield(p, factor): return factor\n", "scaled_yield: must return an instance of Parameters"),
        ("def scaled_yield(p, factor): return p.nothing\n", "scaled_yield: AttributeError"),
    ],
)
def test_the_contract_knows_it(tmp_path, text, fault):
    with pytest.raises(FormulationError, match=fault):
        own_form(tmp_path, RENAMED + text)


def test_it_goes_with_a_history(tmp_path):
    text = "from flexmbd.forms.solid_linear import *\nfrom flexmbd.forms.j2_plasticity import scaled_yield\n"
    with pytest.raises(FormulationError, match="scaled_yield goes with state, which is missing: it speaks of"):
        own_form(tmp_path, text)


@pytest.mark.parametrize(
    ("law", "yielding"),
    [
        ("replace(p, sigma_y=factor * p.sigma_y)", True),
        ("p", False),
        ("replace(p, sigma_y=factor * p.sigma_y, E=1.01 * p.E)", False),
    ],
    ids=["right", "raises nothing", "stiffer"],
)
def test_the_suite_tries_it(tmp_path, law, yielding):
    form = own_form(tmp_path, f"{RENAMED}\ndef scaled_yield(p, factor): return {law}\n")
    (trial,) = history_trials(form, "hexahedron", 1)
    outcome = unloading(trial)
    assert (isinstance(outcome, list) and all(figure.value <= figure.limit for figure in outcome)) is yielding
