"""A tap on the simulated radio: how long a batch takes from its last byte to its topic."""

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
from smart_tire.simulation.pty import PtyPort

CHUNK = 4096    # bytes per read
POLL = 0.1      # s between two looks at whether to stop
PATIENCE = 10.0  # s until the radio's port must be there
KEY = 8         # samples at the end of a batch that tell it from others, thanks to their noise

Key = tuple[tuple[float, ...], ...]


class RadioTap:
    """
    Stands between the simulated radio at ``source`` and a receiver that opens ``link``.

    ``heard`` takes the receiver's samples; ``latencies`` [s] are from the moment at which the
    last byte of a batch was handed over to that at which its last sample was heard.
    """

    def __init__(self, source: str, link: str) -> None:
        self.latencies: list[float] = []
        self._source = source
        self._port = PtyPort(link)
        self._deframer = XBeeDeframer()
        self._sent_ns: dict[Key, int] = {}
        self._newest: deque[tuple[float, ...]] = deque(maxlen=KEY)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._pass_on, name='tap', daemon=True)

    def __enter__(self) -> RadioTap:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stopping.set()
        self._thread.join()
        self._port.close()

    def heard(self, sample: TireSample) -> None:
        """Take a sample that the receiver has published, in order."""
        now_ns = time.monotonic_ns()
        self._newest.append(sample.volts)
        sent_ns = self._sent_ns.pop(tuple(self._newest), None)
        if sent_ns is not None:
            self.latencies.append((now_ns - sent_ns) / NS_PER_S)

    def _pass_on(self) -> None:
        source = self._open()
        if source is None:
            return
        try:
            while not self._stopping.is_set():
                if select.select([source], [], [], POLL)[0]:
                    self._take(os.read(source, CHUNK))
        except OSError:  # EIO: the simulator has gone
            pass
        finally:
            os.close(source)

    def _open(self) -> int | None:
        """Return the open port; None if it never appears. Starting a simulator takes a while."""
        deadline = time.monotonic() + PATIENCE
        while not self._stopping.wait(POLL) and time.monotonic() < deadline:
            if os.path.exists(self._source):
                return os.open(self._source, os.O_RDONLY | os.O_NOCTTY)
        return None

    def _take(self, chunk: bytes) -> None:
        keys = [self._key(body) for body in self._deframer.feed(chunk)]
        self._sent_ns.update(dict.fromkeys(keys, time.monotonic_ns()))
        self._port.write(chunk)

    @staticmethod
    def _key(body: bytes) -> Key:
        batch = decode_batch(decode_receive_packet(body).data)
        return tuple(tuple(map(volts, codes)) for codes in batch.codes[-KEY:])
