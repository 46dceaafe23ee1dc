# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exceptions of this package, derived from built-in ones, and parts of their texts."""

from collections.abc import Iterable

MAX_TEXT = 500    # characters of an error, assumed: a few lines of a terminal
MAX_REASON = 200  # characters of the reason why a message is rejected


def printable(text: str, limit: int = MAX_TEXT) -> str:
    """
    Return ``text`` as one line, without control characters, which terminals would obey.

    The middle is left out of more than ``limit`` characters.
    """
    line = _shortened(text, limit)
    if not line.isprintable():
        line = _shortened(''.join(letter if letter.isprintable() else ascii(letter)[1:-1]
                                  for letter in ' '.join(line.splitlines())), limit)
    return line


def did_you_mean(name: str, known: Iterable[str], otherwise: str = '') -> str:
    """Return the most similar of ``known`` as the end of a sentence, or ``otherwise``."""
    from difflib import get_close_matches  # nodes start without
    near = get_close_matches(name, list(known), n=1)
    return f', did you mean {near[0]}?' if near else otherwise


def _shortened(text: str, limit: int) -> str:
    half = limit // 2 - 3
    return text if len(text) <= limit else f'{text[:half]} ... {text[-half:]}'


class SmartTireError(Exception):
    """Base of all exceptions that this package raises."""


class FrameError(SmartTireError, ValueError):
    """Received bytes are not a valid frame."""


class LinkError(SmartTireError, OSError):
    """A port is absent, busy or lost."""


class ForeignDataError(SmartTireError):
    """
    Base of the exceptions with texts from files, bags and messages of others.

    The text is one line of printable characters, of which the middle is left out if it is long.
    """

    max_text = MAX_TEXT

    def __str__(self) -> str:
        return printable(super().__str__(), self.max_text)


class ParameterError(ForeignDataError, ValueError):
    """A parameter is unknown, of the wrong type, or outside its range."""


class OutputError(ParameterError):
    """What many inputs write to cannot be written, which ends all of them."""


class RejectedError(ForeignDataError, ValueError):
    """A message is rejected, for a reason that gets into logs and diagnostics."""

    max_text = MAX_REASON


class MessageError(RejectedError):
    """A message has wrong names, wrong lengths or an impossible value."""


class CommandError(RejectedError):
    """A command is outdated or from a second publisher."""


class LateCommandError(CommandError):
    """The timestamp or the arrival of a command is too old, or in the future."""


class EstimatorError(SmartTireError, ArithmeticError):
    """An estimator received invalid input, or its state is invalid."""


class BagError(ForeignDataError, OSError):
    """A bag cannot be read or written."""
