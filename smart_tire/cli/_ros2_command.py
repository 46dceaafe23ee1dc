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

"""The command ``ros2 smart_tire VERB ...``, an entry point ``ros2cli.command`` of ros2cli."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
import sys

from smart_tire.cli.main import COMPLETING, execute, fill_parser


class SmartTireCommand:
    """
    Wheel slip, localization and tire-road friction from sensors in the tires.

    The interface is that of ``ros2cli.command.CommandExtension``, which is not imported: the
    package also runs without ros2cli.
    """

    NAME = 'smart_tire'

    def add_arguments(self, parser: argparse.ArgumentParser, cli_name: str, *,
                      argv: Sequence[str] | None = None) -> None:
        """Add the verbs, with the arguments of the one on the command line."""
        words = os.environ['COMP_LINE'].split() if COMPLETING in os.environ else \
            list(sys.argv if argv is None else argv)
        after = words[words.index(self.NAME) + 1:] if self.NAME in words else []
        fill_parser(parser, after[0] if after else None)

    def main(self, *, parser: argparse.ArgumentParser, args: argparse.Namespace) -> int:
        """Run the verb; return the exit status."""
        return execute(args)
