# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire measure film``: deflection of a film from its recorded charge."""

from __future__ import annotations

import argparse

from smart_tire.cli._outputs import refuse_existing
from smart_tire.errors import ParameterError

REQUIRED_COLUMNS, REFERENCE_COLUMN = ['time_s', 'charge_C'], 'deflection_m'


def run(args: argparse.Namespace) -> int:
    """Compute the deflections, print a summary, and write values and figure."""
    out = args.out or args.data.with_name(f'{args.data.stem}_measured.csv')
    figure = out.with_suffix('.png')
    refuse_existing([out, figure], force=args.force, inputs=[args.data, args.params])
    import numpy as np
    from smart_tire.identification.figures import measurement_figure
    from smart_tire.analysis.drawing import save
    from smart_tire.estimation.film.calibration import read_params
    from smart_tire.papers.film_files import (
        check_series, check_units, MAX_CHARGE, MAX_STEP, read_columns, write_columns)
    from smart_tire.papers.film_measurement import measure
    params, columns = read_params(args.params), _columns(args)
    time, charge, *rest = read_columns(args.data, columns, only=False)
    try:
        check_series(time, charge=charge)
        if params.film is not None:
            check_units(columns, (time, charge, *rest), {
                's': MAX_STEP, 'C': MAX_CHARGE, 'm': params.film.length})
        result = measure(time, charge, params, used=args.used)
    except ParameterError as error:
        raise ParameterError(f'{args.data}: {error}') from error
    quantity = ('input', 'sigma') if params.film is None else ('deflection_m', 'sigma_m')
    write_columns(out, ('time_s', *quantity), (result.time, result.value, result.sigma))
    save(measurement_figure(figure.stem, result.time, result.value, result.sigma,
                            rest[0] if rest else None, label=quantity[0]), figure)
    known = np.isfinite(result.value)
    print(f'{result.valid_count} of {known.size} samples measured')
    if result.valid_count:
        print(f'{quantity[0]} {result.value[known].min():.4g} to {result.value[known].max():.4g}, '
              f'sigma {np.median(result.sigma[known]):.2g} (median)')
    if 2 * result.valid_count < known.size:
        tension = params.film is not None and np.median(charge - charge[0]) > 0.0
        print('most of the charge is ' + (
            'above that of the first sample, that of a film under tension: is its sign reversed, '
            'or was the film not flat at the start?' if tension else
            f'beyond the calibration, which has at most {params.max_charge:.3g}'))
    if rest and result.valid_count:
        errors = result.value[known] - rest[0][known]
        inside = np.mean(np.abs(errors) <= 2.0 * result.sigma[known])
        print(f'error against {columns[2]}: {np.sqrt(np.mean(errors**2)):.2g} rms, '
              f'{inside:.1%} within two sigma')
    print(f'written to {out} and {figure}')
    return 0


def _columns(args: argparse.Namespace) -> list[str]:
    from smart_tire.papers.film_files import header_of
    if args.columns is None:
        return REQUIRED_COLUMNS + [REFERENCE_COLUMN] * (REFERENCE_COLUMN in header_of(args.data))
    columns: list[str] = args.columns.split(',')
    if len(columns) not in (2, 3):
        raise ParameterError(f'--columns {args.columns}: expected two or three names')
    return columns
