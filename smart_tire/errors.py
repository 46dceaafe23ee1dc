# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exceptions of this package, derived from built-in ones."""

MAX_REASON = 200  # characters


class SmartTireError(Exception):
    """Base of all exceptions that this package raises."""


class FrameError(SmartTireError, ValueError):
    """Received bytes are not a valid frame."""


class LinkError(SmartTireError, OSError):
    """A port is absent, busy or lost."""


class ParameterError(SmartTireError, ValueError):
    """A parameter is unknown, of the wrong type, or outside its range."""


class RejectedError(SmartTireError, ValueError):
    """
    A message is rejected; the middle of a long reason is left out.

    What strangers send is part of the reason, which gets into logs and diagnostics.
    """

    def __init__(self, reason: str) -> None:
        half = MAX_REASON // 2 - 3
        super().__init__(reason if len(reason) <= MAX_REASON
                         else f'{reason[:half]} ... {reason[-half:]}')


class MessageError(RejectedError):
    """A message has wrong names, wrong lengths or an impossible value."""


class CommandError(RejectedError):
    """A command is outdated or from a second publisher."""


class LateCommandError(CommandError):
    """The timestamp or the arrival of a command is too old, or in the future."""


class EstimatorError(SmartTireError, ArithmeticError):
    """An estimator received invalid input, or its state is invalid."""


class BagError(SmartTireError, OSError):
    """A bag cannot be read or written."""
