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

"""Output that several verbs share: message counts, warnings and parameter files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import output_path
from smart_tire.cli._overwrite import refuse_existing

if TYPE_CHECKING:
    from smart_tire.parameters.calibration_file import Identified

IDENTIFIED, NOT_IDENTIFIED = 0, 1  # exit statuses


def check_output(args: argparse.Namespace, kind: str) -> None:
    """Raise ParameterError if an output file of ``write_parameters`` exists."""
    out = output_path(args, kind)
    refuse_existing([out, out.with_suffix('.png')], force=args.force,
                    inputs=[*args.bags, *args.params])


def write_parameters(args: argparse.Namespace, kind: str, identified: Sequence[Identified],
                     draw: Callable[[Path], bool | None]) -> int:
    """
    Write a parameter file and its figure, print their paths and return the exit status.

    ``draw`` writes the figure; it returns False if there is nothing to draw.
    """
    from smart_tire.parameters.calibration_file import identified_text, write_text
    if not identified:
        print('nothing could be identified from these recordings')
        return NOT_IDENTIFIED
    out = output_path(args, kind)
    write_text(out, identified_text(
        [f'Identified from {", ".join(map(str, args.bags))}.'], identified))
    figure = out.with_suffix('.png')
    drawn = draw(figure) is not False
    print(f'written to {out}' + (f' and {figure}' if drawn else ''))
    return IDENTIFIED


def print_counts(counts: Mapping[str, int]) -> None:
    """Print the message count of each topic."""
    width = max((len(str(count)) for count in counts.values()), default=1)
    for topic, count in sorted(counts.items()):
        print(f'  {count:{width}} {topic}')


def print_warnings(warnings: Iterable[str]) -> None:
    """Print the warnings of a bag reader."""
    for warning in warnings:
        print(f'warning: {warning}')
