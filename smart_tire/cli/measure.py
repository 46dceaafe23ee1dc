"""``smart_tire measure film``: the deflection behind a recorded charge."""

from __future__ import annotations

import argparse
from pathlib import Path

from smart_tire.cli._overwrite import add_force, refuse_existing
from smart_tire.errors import ParameterError

NAME = 'measure'
HELP = 'turn the signal of a calibrated sensor into what it has felt'
NEEDED, REFERENCE = ['time_s', 'charge_C'], 'deflection_m'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this verb."""
    kinds = parser.add_subparsers(dest='kind', metavar='KIND', required=True)
    film = kinds.add_parser('film', help='buckled film: its deflection from its charge')
    film.add_argument('data', type=Path, metavar='DATA.csv',
                      help='recording that begins with the film flat and at rest; columns '
                           'time_s,charge_C, and deflection_m to compare with, if there is one')
    film.add_argument('--params', type=Path, required=True, metavar='FILE',
                      help='parameter file of "smart_tire identify film"')
    film.add_argument('--columns', metavar='T,OUT[,REF]', help='names of other columns to read')
    film.add_argument('--used', action='store_true',
                      help='the film was moved before: its hysteresis is not at rest')
    film.add_argument('--out', type=Path, metavar='FILE',
                      help='CSV file to write, and a figure of its name beside it (default: '
                           'DATA_measured.csv)')
    add_force(film)


def run(args: argparse.Namespace) -> int:
    """Measure, print, and write values and figure."""
    out = args.out or args.data.with_name(f'{args.data.stem}_measured.csv')
    figure = out.with_suffix('.png')
    refuse_existing([out, figure], force=args.force, inputs=[args.data, args.params])
    import numpy as np
    from smart_tire.analysis.film_figures import write_measurement
    from smart_tire.estimation.film.film_file import read_params
    from smart_tire.estimation.film.measure import measure
    from smart_tire.estimation.film.recording import read_columns, write_columns
    params = read_params(args.params)
    time, charge, *rest = read_columns(args.data, _columns(args), only=False)
    try:
        result = measure(time, charge, params, used=args.used)
    except ParameterError as error:
        raise ParameterError(f'{args.data}: {error}') from error
    quantity = ('input', 'sigma') if params.film is None else ('deflection_m', 'sigma_m')
    write_columns(out, ('time_s', *quantity), (result.time, result.value, result.sigma))
    write_measurement(figure, result.time, result.value, result.sigma,
                      rest[0] if rest else None, label=quantity[0])
    told = np.isfinite(result.value)
    print(f'{result.valid_count} of {told.size} samples measured')
    if result.valid_count:
        print(f'{quantity[0]} {result.value[told].min():.4g} to {result.value[told].max():.4g}, '
              f'sigma {np.median(result.sigma[told]):.2g} (median)')
    if rest and result.valid_count:
        away = result.value[told] - rest[0][told]
        inside = np.mean(np.abs(away) <= 2.0 * result.sigma[told])
        print(f'against {_columns(args)[2]}: {np.sqrt(np.mean(away**2)):.2g} rms, '
              f'{inside:.1%} within two sigma')
    print(f'written to {out} and {figure}')
    return 0


def _columns(args: argparse.Namespace) -> list[str]:
    from smart_tire.estimation.film.recording import header_of
    if args.columns is None:
        return NEEDED + [REFERENCE] * (REFERENCE in header_of(args.data))
    columns: list[str] = args.columns.split(',')
    if len(columns) not in (2, 3):
        raise ParameterError(f'--columns {args.columns}: expected two names, or three')
    return columns
