# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Node ``film_simulator``: a film with its charge amplifier on a pseudo-terminal."""

from __future__ import annotations

import sys

from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import LinkError, ParameterError
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.runner import run
from smart_tire.parameters.film import FilmSimulatorParams
from smart_tire.paths import port_url, SIMULATED
from smart_tire.samples import FilmDeflection, FilmTemperature, NS_PER_S
from smart_tire.simulation.film import SimulatedFilm
from smart_tire.simulation.pseudo_terminal import PtyPort
from smart_tire.uncertain import Uncertain

PERIOD = 0.01             # s between writes to the port
TEMPERATURE_SIGMA = 0.02  # K, reported
PUBLISHED = {FilmTemperature: ('film_temperature', NS_PER_S // 10),  # topic, period [ns]
             FilmDeflection: ('ground_truth/film_deflection', NS_PER_S // 100)}
MAX_LAG_NS = NS_PER_S     # beyond it the film goes on from now, as after a step of the clock


class FilmSimulator(SmartTireNode[FilmSimulatorParams]):
    """
    Simulated film in real time.

    Publishes ``film_temperature``, ``ground_truth/film_deflection`` and ``/diagnostics``.
    Parameters: ``port``, ``seed``, ``rate``, ``length``, ``stroke``, ``frequency``, ``rest``,
    ``warming``, ``pyroelectric_coefficient``, ``loss``, and those of the robot.
    """

    def __init__(self) -> None:
        super().__init__('film_simulator', FilmSimulatorParams)
        try:
            self._port = PtyPort(port_url(
                self.params.port, self.get_namespace(), 'film').removeprefix(SIMULATED))
        except LinkError as error:
            raise ParameterError(f'port: {error}') from error
        self._film = SimulatedFilm(self.params)
        self._next = self._film.next_instant()
        self._epoch_ns = SYSTEM.time_ns()
        self._publish = {name: self.make_publisher(name) for name, _ in PUBLISHED.values()}
        self._due_ns = dict.fromkeys(self._publish, 0)
        self.call_every(PERIOD, self._advance)

    def stop(self) -> None:
        """Remove the port."""
        self._port.close()

    def _advance(self) -> None:
        """Send what is due."""
        now_ns = SYSTEM.time_ns()
        if abs(now_ns - self._epoch_ns - self._next.time_ns) > MAX_LAG_NS:
            self._epoch_ns = now_ns - self._next.time_ns
        while (stamp_ns := self._epoch_ns + self._next.time_ns) <= now_ns:
            self._port.write(self._next.frame)
            for sample in (FilmTemperature(stamp_ns, self._next.temperature, TEMPERATURE_SIGMA),
                           FilmDeflection(stamp_ns, Uncertain(self._next.deflection, 0.0))):
                name, period_ns = PUBLISHED[type(sample)]
                if self._next.time_ns >= self._due_ns[name]:
                    self._due_ns[name] += period_ns
                    self._publish[name](sample)
            self._next = self._film.next_instant()

    def fill_status(self, status: Status) -> None:
        """Add bytes that no driver has taken."""
        status.values['bytes_not_taken'] = self._port.lost_bytes


def main() -> int:
    """Run the node."""
    return run(FilmSimulator)


if __name__ == '__main__':
    sys.exit(main())
