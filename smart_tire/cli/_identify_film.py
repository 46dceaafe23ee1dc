# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``smart_tire identify film``: parameters of a film from a test stand recording."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._options import add_force, positive, refuse_existing
from smart_tire.errors import ParameterError

if TYPE_CHECKING:
    from smart_tire.estimation.film.files import FilmRecording
    from smart_tire.models.film.buckling_film import BucklingFilm

NAME = 'film'
HELP = 'elastica and Duhem hysteresis of a film, from a CSV recording of a test stand'
DEFAULT_LENGTH = 25.0  # mm, film of paper A, Table I


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    parser.add_argument('data', type=Path, metavar='DATA.csv',
                        help='CSV file with the columns time_s,deflection_m,charge_C')
    parser.add_argument('--columns', metavar='T,IN,OUT',
                        help='names of time, input and output columns, if different')
    parser.add_argument('--out', type=Path, metavar='FILE',
                        help='parameter file to write; a figure with the same name is written '
                             'next to it (default: DATA_film.yaml)')
    parser.add_argument('--length', type=positive, default=DEFAULT_LENGTH, metavar='MM',
                        help='length of the film between its clamps (default: %(default)s)')
    parser.add_argument('--convention', choices=('exact', 'printed'), default='exact',
                        help='normalization of the stroke: delta = Delta / 2L (exact) or as '
                             'printed in paper A (default: %(default)s)')
    parser.add_argument('--raw', action='store_true',
                        help='use the input column directly as hysteresis input; automatic if '
                             '--columns are given and no film of this length has such deflections')
    parser.add_argument('--gain', type=positive, metavar='NC',
                        help='gain K in nC for which alpha, a and b are also written')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Fit the model, print the result, and write parameters and figure."""
    out = args.out or args.data.with_name(f'{args.data.stem}_film.yaml')
    figure = out.with_suffix('.png')
    refuse_existing([out, figure], force=args.force, inputs=[args.data])
    from smart_tire.analysis.calibration_figures import write_fit
    from smart_tire.calibration.film_bench import identify_film, write_params
    from smart_tire.estimation.film.files import COLUMNS, PRODUCTS, read_recording
    columns = args.columns.split(',') if args.columns else list(COLUMNS)
    recording = read_recording(args.data, columns)
    film = _film(args, recording)
    params, fit, notes = identify_film(recording, film)
    if film is None:
        notes.insert(0, f'{columns[1]} is used directly as input of the hysteresis')
    write_params(out, params, fit, notes, None if args.gain is None else args.gain * 1e-9)
    write_fit(figure, recording.time, recording.input, recording.output, fit.fitted,
              input_label=columns[1], output_label=columns[2])
    for name in PRODUCTS:
        estimate = getattr(fit, name)
        print(f'{name:11}{estimate.value:12.5g} ± {estimate.sigma:.2g}'
              + ('' if estimate.determined else '  not observable'))
    if math.isfinite(fit.low_corner.sigma):
        print(f'low_corner {fit.low_corner.value:12.5g} ± {fit.low_corner.sigma:.2g} Hz')
    print(f'residual   {fit.rms:12.5g} rms, {fit.share:.2%} of half the range')
    for note in notes:
        print(f'note: {note}')
    print(f'written to {out} and {figure}')
    return 0


def _film(args: argparse.Namespace, recording: FilmRecording) -> BucklingFilm | None:
    """Return the film on the test stand; None if the input is not a deflection."""
    from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
    if args.raw:
        return None
    film = BucklingFilm(length=args.length * 1e-3, width=FILMS['25x3'].width,
                        thickness=FILMS['25x3'].thickness, convention=args.convention)
    largest = float(recording.input.max())
    try:
        film.stroke(max(largest, 0.0))
    except ParameterError as error:
        if args.columns:
            return None
        raise ParameterError(f'deflection of {largest} m: {error}') from error
    return film
