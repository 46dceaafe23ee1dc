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

"""Latency of tire samples from the last byte of a radio batch to the topic."""

from __future__ import annotations

from collections import deque
import os
import select
import threading
import time
from types import TracebackType

from smart_tire.protocol.tire_payload import decode_batch, volts
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer
from smart_tire.samples import NS_PER_S, TireSample
from smart_tire.simulation.pseudo_terminal import PtyPort

MAX_READ = 4096      # bytes
POLL_PERIOD = 0.1    # s
OPEN_TIMEOUT = 10.0  # s until the port of the radio must exist
KEY_LENGTH = 8       # samples at the end of a batch whose noise identifies it

Key = tuple[tuple[float, ...], ...]


class RadioTap:
    """
    Forwards bytes from the simulated radio at ``source`` to a receiver that opens ``link``.

    ``add_sample`` takes the samples published by the receiver. ``latencies`` [s] are measured
    from forwarding the last byte of a batch to the call with its last sample.
    """

    def __init__(self, source: str, link: str) -> None:
        self.latencies: list[float] = []
        self._source = source
        self._port = PtyPort(link)
        self._deframer = XBeeDeframer()
        self._sent_ns: dict[Key, int] = {}
        self._newest: deque[tuple[float, ...]] = deque(maxlen=KEY_LENGTH)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._forward_bytes, name='radio_tap', daemon=True)

    def __enter__(self) -> RadioTap:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stopping.set()
        self._thread.join()
        self._port.close()

    def add_sample(self, sample: TireSample) -> None:
        """Add a sample published by the receiver, in order."""
        now_ns = time.monotonic_ns()
        self._newest.append(sample.volts)
        sent_ns = self._sent_ns.pop(tuple(self._newest), None)
        if sent_ns is not None:
            self.latencies.append((now_ns - sent_ns) / NS_PER_S)

    def _forward_bytes(self) -> None:
        source = self._open()
        if source is None:
            return
        try:
            while not self._stopping.is_set():
                if select.select([source], [], [], POLL_PERIOD)[0]:
                    self._forward(os.read(source, MAX_READ))
        except OSError:  # EIO: the simulator has exited
            pass
        finally:
            os.close(source)

    def _open(self) -> int | None:
        """Return the open port; None if it does not appear within ``OPEN_TIMEOUT``."""
        deadline = time.monotonic() + OPEN_TIMEOUT
        while not self._stopping.wait(POLL_PERIOD) and time.monotonic() < deadline:
            if os.path.exists(self._source):
                return os.open(self._source, os.O_RDONLY | os.O_NOCTTY)
        return None

    def _forward(self, chunk: bytes) -> None:
        keys = [self._key(body) for body in self._deframer.extract(chunk)]
        self._sent_ns.update(dict.fromkeys(keys, time.monotonic_ns()))
        self._port.write(chunk)

    @staticmethod
    def _key(body: bytes) -> Key:
        batch = decode_batch(decode_receive_packet(body).data)
        return tuple(tuple(map(volts, codes)) for codes in batch.codes[-KEY_LENGTH:])
