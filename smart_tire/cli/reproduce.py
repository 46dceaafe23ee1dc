# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire reproduce``: figures and tables of both papers from models and simulation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._options import add_force, refuse_existing
from smart_tire.cli._progress import Progress
from smart_tire.errors import ParameterError

if TYPE_CHECKING:
    from smart_tire.reproduction.film_experiments import Laboratory

NAME = 'reproduce'
HELP = 'recompute the figures and tables of both papers; write PNG files and an HTML report'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('--out', type=Path, default=Path('reproduction'), metavar='DIR',
                        help='folder for the figures and report.html (default: %(default)s)')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Simulate the experiments and write figures and report; return the exit status."""
    refuse_existing([args.out / 'report.html', *sorted(args.out.glob('paper_*.png'))],
                    force=args.force)
    from smart_tire.reproduction.runner import reproduce
    try:
        with Progress(f'smart_tire {NAME}') as progress:
            report = reproduce(laboratory(), args.out, lambda done, total, what: progress.show(
                f'{done}/{total}  {what}'))
    except OSError as error:
        raise ParameterError(f'{args.out}: cannot be written ({error.strerror})') from error
    print(f'written to {report}')
    return 0


def laboratory() -> Laboratory:
    """Return the simulated test stand and robot."""
    from smart_tire.arrays import Array
    from smart_tire.estimation.film.files import FilmRecording
    from smart_tire.models.film.hysteresis import TABLE_I_GAIN
    from smart_tire.reproduction.film_experiments import Laboratory, Specimen
    from smart_tire.reproduction.film_test_stand import FilmTestStand
    from smart_tire.simulation.offline import simulate

    def bench(specimen: Specimen, deflection: Array, rate: float, seed: int) -> FilmRecording:
        # The amplifier range is set for the film; the noise is proportional to the range.
        share = specimen.gain / TABLE_I_GAIN
        return FilmTestStand(
            film=specimen.film, hysteresis=specimen.hysteresis, gain=specimen.gain, rate=rate,
            charge_noise=FilmTestStand.charge_noise * share,
            full_scale=FilmTestStand.full_scale * share).run(deflection, seed)
    return Laboratory(bench, simulate)
