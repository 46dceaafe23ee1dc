# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What was identified from bags: printed, and written as parameter file and figure."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.paths import write_text

if TYPE_CHECKING:
    from smart_tire.identification.identify import Identification, Source

IDENTIFIED, NOT_IDENTIFIED = 0, 1  # exit statuses
NAME_WIDTH = 32


def report(kind: str, source: Source, out: Path, figure: Path) -> int:
    """Print what ``source`` shows, write parameter file and figure; return the exit status."""
    from smart_tire.identification.identify import identify
    return written(identify(kind, source), (*source.bags, *source.lifted), out, figure)


def written(made: Identification, bags: Iterable[Path], out: Path, figure: Path) -> int:
    """Print what was identified, write file and figure; return the exit status."""
    from smart_tire.analysis.drawing import save
    from smart_tire.parameters.calibration_file import identified_text
    for item in made.found.quantities:
        value, sigma = item.estimate
        print(f'{item.name:{NAME_WIDTH}}{value:12.6g} ± {sigma:<8.2g} {item.unit:9}{item.note}')
    for reasons, text in ((made.found.refused, 'not observable'),
                          (made.found.kept, 'not written')):
        for name, why in reasons.items():
            print(f'{name:{NAME_WIDTH}}{text}: {why}')
    for note in made.found.notes:
        print(f'note: {note}')
    if not made.parameters:
        print('nothing could be identified from these recordings')
        return NOT_IDENTIFIED
    names = ', '.join(map(str, bags))
    write_text(out, identified_text([f'Identified from {names}.'], made.parameters))
    if made.figure is not None:
        save(made.figure, figure)
    print(f'written to {out}' + ('' if made.figure is None else f' and {figure}'))
    return IDENTIFIED
