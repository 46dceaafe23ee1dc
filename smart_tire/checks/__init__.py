# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of a recording: each function ``check_*`` of these modules yields findings."""

from collections.abc import Callable, Iterable, Iterator

from smart_tire.checks import causes, films, messages, motion, sensors
from smart_tire.checks.recording import CheckedRecording
from smart_tire.findings import Finding

Check = Callable[[CheckedRecording], Iterable[Finding]]


def _checks(*modules: object) -> tuple[Check, ...]:
    return tuple(check for module in modules for name, check in vars(module).items()
                 if name.startswith('check_'))


AS_RECORDED, MENDED = _checks(messages), _checks(sensors, motion, films)
CHECKS = (*AS_RECORDED, causes.check_causes, *MENDED)
# of the messages, those that a node does not make itself of each message or each second
LIVE = (messages.check_completed, messages.check_stamps, messages.check_publishers,
        messages.check_delays)


def findings(recording: CheckedRecording, as_recorded: Iterable[Check] = AS_RECORDED
             ) -> Iterator[Finding]:
    """
    Yield the findings of all checks, without consequences of errors that were found.

    Of the checks of the messages, ``as_recorded`` are made.
    """
    for check in as_recorded:
        yield from check(recording)
    for mend in (causes.mended, motion.mended_radius):
        found, recording = mend(recording)
        yield from found
    for check in MENDED:
        if check is not motion.check_radius:
            yield from check(recording)
