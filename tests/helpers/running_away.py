"""A form whose equations at a quadrature point make whole Newton steps run away."""

import types

import ufl

from flexmbd.forms import j2_plasticity as j2


def running_away():
    """z is the shear du_x/dy, as the zero of an arc tangent: whole Newton steps from 0 run away beyond 0.7 %."""
    module = types.ModuleType("running_away")
    vars(module).update({name: value for name, value in vars(j2).items() if name[:2] not in ("__", "lo")})

    def residual(u, v, state, p, *, z):
        return [(p.E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) + p.E * z[0] * v.dx(1)[0], j2.rule(u))]

    module.state = lambda p: ufl.as_vector([0.0])  # type: ignore[attr-defined]
    module.local_unknowns = lambda p: ufl.as_vector([0.0])  # type: ignore[attr-defined]
    module.local_residual = lambda z, u, state, p: (  # type: ignore[attr-defined]
        ufl.as_vector([ufl.atan(200 * (z[0] - u.dx(1)[0]))])
    )
    module.update = lambda u, state, p, *, z: ufl.as_vector([z[0]])  # type: ignore[attr-defined]
    module.residual = residual  # type: ignore[attr-defined]
    module.stress = lambda u, state, p, *, z: p.E * ufl.sym(ufl.grad(u))  # type: ignore[attr-defined]
    del module.energies, module.state_names, module.cell_mean, module.scaled_yield
    return module
