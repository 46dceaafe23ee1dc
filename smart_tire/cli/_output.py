"""Output that several verbs share: message counts, losses, and calibration files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import out_beside
from smart_tire.cli._overwrite import refuse_existing

if TYPE_CHECKING:
    from smart_tire.parameters.calibration_file import Identified

FOUND, NOTHING = 0, 1  # exit statuses


def check_out(args: argparse.Namespace, kind: str) -> None:
    """Raise ParameterError if a file that ``put_out`` would write exists."""
    out = out_beside(args, kind)
    refuse_existing([out, out.with_suffix('.png')], force=args.force,
                    inputs=[*args.bags, *args.params])


def put_out(args: argparse.Namespace, kind: str, told: Sequence[Identified],
            draw: Callable[[Path], bool | None]) -> int:
    """
    Write parameters and, beside them, a figure, and say where; return the exit status.

    ``draw`` writes the figure and returns False where there was nothing to draw.
    """
    from smart_tire.parameters.calibration_file import identified_text, write_text
    if not told:
        print('nothing can be told')
        return NOTHING
    out = out_beside(args, kind)
    write_text(out, identified_text([f'Identified from {", ".join(map(str, args.bags))}.'], told))
    figure = out.with_suffix('.png')
    drawn = draw(figure) is not False
    print(f'written to {out}' + (f' and {figure}' if drawn else ''))
    return FOUND


def print_counts(counts: Mapping[str, int]) -> None:
    """Print the number of messages by topic."""
    width = max((len(str(count)) for count in counts.values()), default=1)
    for topic, count in sorted(counts.items()):
        print(f'  {count:{width}} {topic}')


def print_losses(losses: Iterable[str]) -> None:
    """Print what could not be read."""
    for loss in losses:
        print(f'lost: {loss}')
