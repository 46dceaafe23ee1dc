# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Node ``film_driver``: reads the charge amplifier of a film and publishes ``film_charge``."""

from __future__ import annotations

import sys

from smart_tire.drivers.sample_stream import FILM_CHARGE
from smart_tire.nodes.driver import SampleDriver
from smart_tire.nodes.runner import run
from smart_tire.parameters.film import FilmDriverParams


class FilmDriver(SampleDriver[FilmDriverParams]):
    """
    Publishes each conversion of the amplifier, stamped by its clock.

    Publishes ``film_charge`` and ``/diagnostics``. Parameters: ``port``, ``baud_rate``,
    ``latency``, and those of the robot.
    """

    device = 'film'

    def __init__(self) -> None:
        super().__init__('film_driver', FilmDriverParams, 'film_charge', lambda _: FILM_CHARGE)


def main() -> int:
    """Run the node."""
    return run(FilmDriver)


if __name__ == '__main__':
    sys.exit(main())
