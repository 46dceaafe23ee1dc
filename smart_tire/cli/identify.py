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
``smart_tire identify KIND``: parameters from recordings, with standard errors.

All kinds but the film, whose data are a CSV file of a test stand, read bags; ``smart_tire
calibrate --only KIND`` calls them as well.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from smart_tire.cli._bags import bag_settings
from smart_tire.cli._identified import report
from smart_tire.cli._outputs import refuse_existing
from smart_tire.errors import ParameterError
from smart_tire.paths import bag_name


def run(args: argparse.Namespace) -> int:
    """Run the selected kind; return the exit status."""
    return run_film(args) if args.kind == 'film' else run_bags(args)


def run_bags(args: argparse.Namespace) -> int:
    """Identify from bags, print the result, and write parameters and figure."""
    out = args.out or Path(f'{bag_name(args.bags[0])}_{args.kind}.yaml')
    lifted = getattr(args, 'lifted', [])
    figure, bags = out.with_suffix('.png'), [*args.bags, *lifted]
    refuse_existing([out, figure], force=args.force, inputs=[*bags, *args.params])
    from smart_tire.identification.robot import known, TimeRange
    from smart_tire.identification.identify import Source
    used, names, _ = bag_settings(bags, args)
    return report(args.kind, Source(
        args.bags, known(used.params.robot, used.given), TimeRange(args.since, args.until),
        getattr(args, 'reference', 'none'), names, lifted), out, figure)


def run_film(args: argparse.Namespace) -> int:
    """Fit the model of a film, print the result, and write parameters and figure."""
    out = args.out or args.data.with_name(f'{args.data.stem}_film.yaml')
    figure = out.with_suffix('.png')
    refuse_existing([out, figure], force=args.force, inputs=[args.data])
    from smart_tire.identification.figures import fit_figure
    from smart_tire.analysis.drawing import save
    from smart_tire.papers.film_bench import identify_film, write_params
    from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
    from smart_tire.estimation.film.calibration import PRODUCTS
    from smart_tire.papers.film_files import (
        check_units, COLUMNS, MAX_CHARGE, MAX_STEP, read_recording)
    columns = args.columns.split(',') if args.columns else list(COLUMNS)
    recording = read_recording(args.data, columns)
    film = None if args.raw else BucklingFilm(
        length=args.length * 1e-3, width=FILMS['25x3'].width, thickness=FILMS['25x3'].thickness,
        convention=args.convention)
    if film is not None:
        try:
            check_units(columns, (recording.time, recording.input, recording.output),
                        {'s': MAX_STEP, 'm': film.length, 'C': MAX_CHARGE})
            film.stroke(max(float(recording.input.max()), 0.0))
        except ParameterError as error:
            raise ParameterError(f'{args.data}: {error}; correct file or --length, or give '
                                 '--raw to identify in the units of the file') from error
    params, fit, notes = identify_film(recording, film)
    write_params(out, params, fit, notes, None if args.gain is None else args.gain * 1e-9)
    save(fit_figure(figure.stem, recording.time, recording.input, recording.output, fit.fitted,
                    input_label=columns[1], output_label=columns[2]), figure)
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
