"""The bodies that the tests of formats write: real parts, reduced once a process."""

from functools import cache

import numpy as np


@cache
def soft_bar():
    """A bar of 1 m along x, soft enough to bend by a tenth of its length under its weight.

    "x_min" and "x_max" are its ends. Bricks of degree 2, both interfaces rigid, eight fixed-interface modes, no
    damping, with the modes at the nodes.
    """
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import Keep, craig_bampton

    rubber = solid_linear.Parameters(E=4.4e7, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.04, 0.06, divisions=(10, 1, 1))
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, rubber, degree=2, interfaces=ends)
    return craig_bampton(model, modes=8, frame="x_min", keep=Keep(modes=True, surface=True))


@cache
def damped_rod():
    """A connecting rod of steel whose body frame is turned against its mesh, damped, without modes at the nodes."""
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import ModalDamping, craig_bampton

    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    turn = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [-0.4, 1.0, 0.5], [0.1, -0.3, 1.0]]))[0]
    turn *= np.linalg.det(turn)
    ends = [Interface("big_end", axes=turn), Interface("small_end")]
    model = ContinuumModel(meshes.connecting_rod(length=0.3, h=20e-3), solid_linear, steel, degree=2, interfaces=ends)
    return craig_bampton(model, modes=5, frame="big_end", damping=ModalDamping(0.01))


@cache
def floating_bar():
    """The soft bar, damped, floating on its mean axis, its end "x_max" averaged."""
    import flexmbd as fm
    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import ModalDamping, craig_bampton

    rubber = solid_linear.Parameters(E=4.4e7, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.04, 0.06, divisions=(10, 1, 1))
    ends = [Interface("x_min"), Interface("x_max", coupling=fm.Coupling.AVERAGED)]
    model = ContinuumModel(mesh, solid_linear, rubber, degree=2, interfaces=ends)
    return craig_bampton(model, modes=8, frame=None, damping=ModalDamping(0.01))


@cache
def small_body():
    """A body of two modes and one interface, its frame, the damped rod's lowest, so that a file of it is short."""
    from dataclasses import replace

    import flexmbd as fm

    rod, n = damped_rod(), 2
    base = rod.interface("big_end")
    return fm.ReducedBody(
        gram=rod.gram[: 4 + 3 * n, : 4 + 3 * n],
        stiffness=rod.stiffness[:n],
        damping=rod.damping[:n, :n],
        interfaces=(replace(base, modes=base.modes[:, :n]),),
        frame="big_end",
        partition=np.eye(n),
        partition_names=("fixed-interface 1", "fixed-interface 2"),
    )
