"""Bodies with history over a machine's rows: energies, outer forces, ports, wrenches on their frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.results.port_series import PortSeries
from flexmbd.run.recording import BodyRecording
from flexmbd.run.series.motion_series import MotionSeries

FloatArray = NDArray[np.float64]


class InteriorSeries(MotionSeries):
    """Questions to a `Trajectory` about its bodies with history.

    Attributes:
        interior_rows, recordings: as there.
    """

    interior_rows: tuple[InteriorRecord, ...]
    recordings: tuple[BodyRecording, ...]

    def energies(self, body: ContinuumBody) -> dict[str, FloatArray]:
        """Energies (J) of a body's interior by name, each (nt,): kinetic, elastic, plastic, ...; see ``Interior``.

        Those of its frames, which are rigid bodies of the machine, are in ``energy()``.

        Raises:
            SceneError: the body is not in this trajectory.
        """
        k = self._interior(body)
        told = [row.energies[k] for row in self.interior_rows]
        return {name: np.array([energies[name] for energies in told]) for name in told[0]}

    def outer_forces(self, body: ContinuumBody) -> dict[str, FloatArray]:
        """Forces (N) of contacts, planes and loads on a body with history by name, each (nt, 3), in inertial axes.

        Raises:
            SceneError: the body is not in this trajectory.
        """
        k = self._interior(body)
        told = [row.outer_forces[k] for row in self.interior_rows]
        return {name: np.array([forces[name] for forces in told]) for name in told[0]}

    def interior_wrench(self, body: ContinuumBody, interface: str) -> FloatArray:
        """(nt, 6) force (N) and moment (N m) that a body with history exerts on the frame of one of its interfaces.

        In inertial axes, about the frame's origin.  What its joints pass on to the frame tells ``reaction``.

        Raises:
            SceneError: the body is not in this trajectory.
            InterfaceError: it has no such interface.
        """
        k = self._interior(body)
        body.frame(interface)
        placed = () if self.scene.interiors is None else self.scene.interiors.placed
        first = sum(len(other.rows) for other in placed[:k])
        row = first + [frame.name for frame in body.interior.frames].index(interface)
        return np.array([one.wrenches[row] for one in self.interior_rows])

    def ports(self, body: ContinuumBody) -> dict[str, PortSeries]:
        """Voltage, charge and work of the ports of a body with history, by name; those of its electrodes.

        Of a reduced body see ``port``.

        Raises:
            SceneError: the body is not in this trajectory.
        """
        k = self._interior(body)
        told = [row.ports[k] for row in self.interior_rows]
        series = {name: np.array([ports[name] for ports in told]) for name in told[0]}
        return {name: PortSeries(self.t.copy(), part[:, 0], part[:, 1]) for name, part in series.items()}

    def recorded(self, body: ContinuumBody) -> BodyRecording:
        """The fields of a body with history over time: nodes' motion, stress, its form's history.

        Raises:
            SceneError: the body is not in this trajectory, or the simulation had no recording.
        """
        self._interior(body)
        for one in self.recordings:
            if one.body is body:
                return one
        raise SceneError(
            f"the fields of body {body.name!r} were not kept; simulate with recording=fm.Recording(path, every=...)"
        )

    def _interior(self, body: ContinuumBody) -> int:
        """Which of the interiors is the body's."""
        bodies = () if self.scene.interiors is None else self.scene.interiors.bodies
        for k, other in enumerate(bodies):
            if other is body:
                return k
        what = f"body {body.name!r}" if isinstance(body, ContinuumBody) else f"{body!r:.100}"
        raise SceneError(f"{what} has no interior in this trajectory")
