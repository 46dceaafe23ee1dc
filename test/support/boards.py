"""Two motor boards that do as they are told by a test, on a port."""

from __future__ import annotations

import threading

from smart_tire.protocol import roboclaw
from support.pty_port import PtyPort


class Boards:
    """A thread that answers requests like RoboClaws at ``addresses``; a context."""

    def __init__(self, port: PtyPort, addresses: tuple[int, ...] = (128, 129)) -> None:
        self._port = port
        self.counts = dict.fromkeys(addresses, (0, 0))
        self.duty: dict[int, tuple[int, ...]] = {}  # of those that have been told one
        self.timeout = dict.fromkeys(addresses, 0)
        self.answering = set(addresses)
        self.damaged = 0  # that many replies get a wrong CRC
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Boards:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def _serve(self) -> None:
        deframer = roboclaw.RequestDeframer()
        while not self._ending.is_set():
            for request in deframer.feed(self._port.read(0.02)):
                if request.address in self.answering:
                    self._port.write(self._answer(request))

    def _answer(self, request: roboclaw.Request) -> bytes:
        values: tuple[int, ...] = ()
        if request.command == roboclaw.READ_ENCODERS:
            values = self.counts[request.address]
        elif request.command == roboclaw.SET_DUTY:
            self.duty[request.address] = request.values
        elif request.command == roboclaw.SET_TIMEOUT:
            (self.timeout[request.address],) = request.values
        reply = roboclaw.encode_reply(request.address, request.command, *values)
        if values and self.damaged:
            self.damaged -= 1
            return reply[:-1] + bytes((reply[-1] ^ 1,))
        return reply
