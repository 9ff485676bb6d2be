"""A reduced body in a system of Exudyn, with its frames as markers, its weight and its damping.

Exudyn is imported when this is called, and by nothing else in flexmbd.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import ExportError
from flexmbd.export.exudyn_files.exudyn_file import exudyn_arrays
from flexmbd.export.exudyn_files.exudyn_reader import read_exudyn
from flexmbd.files.archive import write_archive
from flexmbd.given import checked, shaped_numbers, shown
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import check_rotation


@dataclass(frozen=True)
class ExudynBody:
    """The items of a body in a system of Exudyn, by Exudyn's indices.

    Attributes:
        object: the ObjectFFRFreducedOrder.
        frame_node: node of the body frame B.
        modal_node: node of the modal coordinates, those of the record.
        markers: a rigid marker a frame, by its name; their axes are those of B, turned as the frame turns.
        centre: position marker at the centre of mass of the deformed body.
        weight: the load, or None without gravity.
    """

    object: Any
    frame_node: Any
    modal_node: Any
    markers: dict[str, Any]
    centre: Any
    weight: Any


@checked(error=ExportError)
def add_to_exudyn(
    mbs: Any,
    body: ReducedBody | str | Path,
    *,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    position: Sequence[float] = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    angular_velocity: Sequence[float] = (0.0, 0.0, 0.0),
    name: str = "",
) -> ExudynBody:
    """Add a reduced body to a MainSystem of Exudyn, before its Assemble().

    Weight acts at the centre of mass of the deformed body; Exudyn's own argument `gravity` of such bodies takes the
    moment of the undeformed one.  The whole damping matrix acts.

    Args:
        mbs: exudyn.MainSystem.
        body: the body, or a file that `exudyn` wrote.
        gravity: m/s^2, in the axes of the world.
        position: m, of B's origin.
        rotation: (3, 3) from B's axes to the world's; the unit matrix by default.
        velocity: m/s, of B's origin.
        angular_velocity: rad/s, of B, in the axes of the world.
        name: of the object.

    Returns:
        Exudyn's indices of the added items.

    Raises:
        ExportError: Exudyn is not installed; the body cannot be written for it, or the file not be read; ``mbs`` is no
            MainSystem.
        SceneError: a vector is not of three numbers, or ``rotation`` none.
    """
    try:
        import exudyn
        from exudyn import itemInterface as item
        from exudyn.FEM import ObjectFFRFreducedOrderInterface
    except ImportError as error:
        raise ExportError(f"Exudyn cannot be imported ({error}): pip install exudyn") from error
    if not isinstance(mbs, exudyn.MainSystem):
        raise ExportError(f"mbs must be an exudyn.MainSystem, as SystemContainer().AddSystem() gives, got {shown(mbs)}")
    vectors = {"gravity": gravity, "position": position, "velocity": velocity, "angular_velocity": angular_velocity}
    for what, value in vectors.items():
        shaped_numbers(value, (3,), what)
    turned = np.eye(3) if rotation is None else check_rotation(rotation, "rotation")
    record = body if isinstance(body, ReducedBody) else read_exudyn(body)
    arrays = exudyn_arrays(record)
    reduced = ObjectFFRFreducedOrderInterface()
    with tempfile.TemporaryDirectory() as folder:
        reduced.LoadFromFile(str(write_archive(Path(folder) / "body.npz", arrays)))
    added = reduced.AddObjectFFRFreducedOrder(
        mbs,
        positionRef=list(position),
        rotationMatrixRef=turned,
        initialVelocity=list(velocity),
        initialAngularVelocity=list(angular_velocity),
        name=name,
    )
    number = added["oFFRFreducedOrder"]
    if np.any(record.damping):
        damping = exudyn.MatrixContainer()
        damping.SetWithDenseMatrix(record.damping, useDenseMatrix=True)
        mbs.SetObjectParameter(number, "dampingMatrixReduced", damping)
    centre = mbs.AddMarker(
        item.MarkerSuperElementPosition(
            bodyNumber=number, meshNodeNumbers=[int(arrays["flexmbd centre"])], weightingFactors=[1.0]
        )
    )
    weight = None
    if np.any(gravity):
        force = record.mass * np.asarray(gravity, dtype=np.float64)
        weight = mbs.AddLoad(item.LoadForceVector(markerNumber=centre, loadVector=force))
    markers = _add_markers(mbs, record, arrays["flexmbd interface nodes"].tolist(), added)
    return ExudynBody(number, added["nRigidBody"], added["nGenericODE2"], markers, centre, weight)


def _add_markers(mbs: Any, record: ReducedBody, nodes: list[list[int]], added: dict[str, Any]) -> dict[str, Any]:
    """A rigid marker a frame, by its name."""
    from exudyn import itemInterface as item

    markers = {}
    for frame, four in zip(record.interfaces, nodes, strict=True):
        if frame.name == record.frame and not frame.modes.any():
            # the same motion at a fraction of the time
            marker: Any = item.MarkerNodeRigid(nodeNumber=added["nRigidBody"])
        else:
            marker = item.MarkerSuperElementRigid(
                bodyNumber=added["oFFRFreducedOrder"], meshNodeNumbers=four, weightingFactors=[0.25] * 4
            )
        markers[frame.name] = mbs.AddMarker(marker)
    return markers
