# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Offsets between the clocks of this host and of nodes, by round trips to their services."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import starmap
import math
import time
from typing import Any

from rcl_interfaces.srv import GetParameterTypes

from smart_tire.findings import Finding, Level
from smart_tire.samples import NS_PER_S

MAX_OFFSET = 0.001     # s; messages are ordered by timestamps to 8 ms
ROUND_TRIPS = 20
TIMEOUT = 0.5          # s, for the service and for each response
POLL_PERIOD = 0.0001   # s between two looks for a response

Trip = tuple[int, int, int]  # ns: request, response by the other clock, reception
Bounds = tuple[float, float]  # s: least and greatest offset


def offset_bounds(trips: Iterable[Trip]) -> Bounds | None:
    """Return the least and the greatest offset [s] of the other clock; None without response."""
    found = list(trips)
    if not found:
        return None
    return (max(sent - received for _, sent, received in found) / NS_PER_S,
            min(sent - asked for asked, sent, _ in found) / NS_PER_S)


def clock_finding(names: Sequence[str], bounds: Bounds) -> Finding:
    """Return the finding on the clocks of nodes with these bounds of their offset [s]."""
    low, high = bounds
    where, clocks = (f'node {names[0]}', 'its clock is') if len(names) == 1 else (
        f'nodes {", ".join(names)}', 'their clocks are')
    found = f'{clocks} {1e3 * low:+.2f} to {1e3 * high:+.2f} ms from that of this host'
    if low > MAX_OFFSET or high < -MAX_OFFSET or low > high:
        return Finding(Level.WARNING, where, found, f'at most {1e3 * MAX_OFFSET:g} ms',
                       'synchronize the clocks (chrony)')
    certain = max(-low, high) <= MAX_OFFSET
    return Finding(Level.OK if certain else Level.INFO, where, found)


def merged(offsets: Mapping[str, Bounds]) -> Iterator[tuple[list[str], Bounds]]:
    """
    Yield the nodes of each level whose offsets may be that of one clock, and bounds for all.

    The nodes of one host have one clock, of which one finding is enough.
    """
    def order(name: str) -> tuple[Level, Bounds]:
        return clock_finding([name], offsets[name]).level, offsets[name]

    names, level, low, high = list[str](), Level.OK, 0.0, -math.inf
    for name in sorted(offsets, key=order):
        found, (least, greatest) = order(name)
        if names and (found != level or least > high):
            yield names, (low, high)
            names = []
        low, high = (min(low, least), max(high, greatest)) if names else (least, greatest)
        names, level = [*names, name], found
    if names:
        yield names, (low, high)


def clock_findings(node: Any, names: Iterable[str]) -> Iterator[Finding]:
    """
    Yield the findings on the clocks of the nodes with fully qualified ``names``.

    A response carries the time at which it was sent, by the clock of the node that serves. The
    offset of this clock is between this time minus that of the reception and minus that of the
    request, both by the own clock. All round trips hold, so the bounds are those of their
    intersection.
    """
    offsets = {name: bounds for name in names
               if (bounds := offset_bounds(_trips(node, name))) is not None}
    yield from starmap(clock_finding, merged(offsets))


def _trips(node: Any, name: str) -> Iterator[Trip]:
    """Yield round trips to the parameter service of a node, which all nodes of ROS have."""
    client = node.create_client(GetParameterTypes, f'{name}/get_parameter_types')
    try:
        if not client.wait_for_service(TIMEOUT):
            return
        for _ in range(ROUND_TRIPS):
            asked = time.time_ns()
            number = client.handle.send_request(GetParameterTypes.Request())
            sent = _response(client, number, time.monotonic() + TIMEOUT)
            if not sent:
                return
            yield asked, sent, time.time_ns()
    finally:
        node.destroy_client(client)


def _response(client: Any, number: int, end: float) -> int:
    """Return when the response to a request was sent [ns]; 0 if it is late or has no time."""
    while time.monotonic() < end:
        info, _ = client.handle.take_response(GetParameterTypes.Response) or (None, None)
        if info is not None and info.request_id.sequence_number == number:
            return int(info.source_timestamp)
        time.sleep(POLL_PERIOD)
    return 0
