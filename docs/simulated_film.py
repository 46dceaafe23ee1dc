# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""
Calibrates the simulated film from a recording of the simulated test stand.

``python docs/simulated_film.py FILE`` writes what ``smart_tire identify film`` would.
"""

from pathlib import Path
import sys

from smart_tire.models.film.buckling_film import FILMS
from smart_tire.papers.film_bench import identify_film, write_params
from smart_tire.papers.film_experiments import record
from smart_tire.simulation.film import FilmTestStand

SEED = 11  # of the noise of the recording


def write(path: Path) -> None:
    """Write the calibration."""
    write_params(path, *identify_film(record(FilmTestStand(), SEED), FILMS['25x3']))


if __name__ == '__main__':
    write(Path(sys.argv[1]))
