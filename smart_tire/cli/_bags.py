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

"""Options of all verbs that read bags, and the function that opens a bag with them."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.errors import ParameterError

if TYPE_CHECKING:
    from smart_tire.analysis.bag_params import BagParams
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.bags import Bag, TopicNames

REQUIRED = ('imu/data', 'wheel_states')  # inputs without which nothing is estimated


def add_bag_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--params`` and ``--remap``."""
    parser.add_argument('--params', type=Path, action='append', default=[], metavar='FILE',
                        help='ROS parameter file, in place of the parameters in the bag; may be '
                             'repeated, later files override earlier ones')
    add_remap(parser)


def add_remap(parser: argparse.ArgumentParser) -> None:
    """Add ``--remap``."""
    parser.add_argument('--remap', action='append', default=[], metavar='STANDARD:=NAME',
                        help='a topic with another name in the bag, for example '
                             'imu/data:=/mti30/imu; may be repeated')


def check_options(args: argparse.Namespace) -> None:
    """Raise ParameterError if an option of ``add_bag_options`` is invalid for any bag."""
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.bags import TopicNames
    EstimatorParams.load(args.params)
    TopicNames.parse(args.remap)


@dataclass(frozen=True)
class BagSettings:
    """How a bag is read."""

    source: BagParams   # parameters, and where they are from
    names: TopicNames

    @property
    def params(self) -> EstimatorParams:
        """Return the parameters of the estimators."""
        return self.source.params


@contextmanager
def open_bag(path: Path, args: argparse.Namespace, *, required: Collection[str] = REQUIRED,
             prefix: str = '') -> Iterator[tuple[Bag, BagSettings]]:
    """
    Open a bag with the options of ``add_bag_options``; yield it and its settings.

    Prints the source of the parameters, and the topics and joints that were recognized, with
    ``prefix`` before each line. Raises BagError if one of the ``required`` topics has to be
    selected with an option, ParameterError if an option or a parameter is invalid.
    """
    from smart_tire.analysis.bag_params import bag_params
    from smart_tire.bags import Bag, check_inputs, TopicNames
    names = TopicNames.parse(args.remap)
    with Bag(path, names) as bag:
        source = bag_params(bag, args.params)
        bag.joints = source.params.robot.joints
        check_inputs(bag, required)
        for line in (*source.lines(), *bag.notes):
            print(prefix + line)
        yield bag, BagSettings(source, names)


def bag_settings(paths: Iterable[Path], args: argparse.Namespace, *,
                 required: Collection[str] = REQUIRED) -> BagSettings:
    """
    Return the settings for bags of one robot; print as ``open_bag`` does.

    Raises ParameterError if the bags carry different parameters of the robot.
    """
    found: BagSettings | None = None
    paths = list(paths)
    for path in paths:
        with open_bag(path, args, required=required,
                      prefix=f'{path}: ' if len(paths) > 1 else '') as (_, settings):
            if found is not None and settings.params.robot != found.params.robot:
                raise ParameterError(f'{paths[0]} and {path} carry different parameters of the '
                                     'robot: select one set with --params')
            found = found or settings
    assert found is not None  # argparse requires one bag
    return found
