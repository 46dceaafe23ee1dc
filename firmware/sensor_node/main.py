# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Sensor node of a tire: two films at 400 Hz, in batches of 16 samples to the XBee module.

For a Raspberry Pi Pico (RP2040) with MicroPython whose ``machine.Timer`` has ``hard``. Copy this
file and ``packet.py`` to the board; ``README.md`` has wiring and settings.

The interrupt of a timer fills one of two buffers, without allocating memory, while the main loop
sends the other one. A batch that cannot be sent, because the module holds CTS or the line is busy,
is left out, and its number with it: the host counts the gap.
"""

from array import array
import time

from machine import ADC, Pin, Timer, UART
from packet import payload, transmit_request

FILMS = (26, 27)      # pins of the converter, film 1 first
BATTERY = 28          # pin of the converter, behind a divider
BATTERY_DIVIDER = 2   # voltage of the battery over that of its pin
TX, RX, CTS = 0, 1, 2  # pins of UART 0 and of CTS of the module; CTS is high when it is full
BAUD_RATE = 115200
RATE = 400            # Hz
BATCH = 16            # samples: 78 bytes of payload, a ZigBee packet has at most 84
FULL_SCALE_MV = 3300
FRAME_BYTES = 256     # more than a frame with all bytes escaped


class Sampler:
    """Two buffers that an interrupt fills in turn."""

    def __init__(self, converters, batch):
        self._converters = converters
        self._size = batch * len(converters)
        self._buffers = array('H', bytes(2 * self._size)), array('H', bytes(2 * self._size))
        self._ticks = array('i', (0, 0))  # us, of the first sample of each buffer
        self._filling = 0
        self._index = 0
        self._count = 0  # batches that are complete, modulo 2^16

    def sample(self, _):
        """Read all converters; called by the interrupt of the timer."""
        i, filling = self._index, self._filling
        if i == 0:
            self._ticks[filling] = time.ticks_us()
        buffer = self._buffers[filling]
        for converter in self._converters:
            buffer[i] = converter.read_u16() >> 6  # 10 bits
            i += 1
        if i == self._size:
            i = 0
            self._filling = 1 - filling
            self._count = (self._count + 1) & 0xFFFF
        self._index = i

    def latest(self):
        """
        Return count of the batches, and ticks [us] and codes of the latest one.

        The codes are valid until the next batch is complete.
        """
        while True:
            count, full = self._count, 1 - self._filling
            if count == self._count:  # no interrupt between the two
                return count, self._ticks[full], self._buffers[full]


class Node:
    """Sends each batch of a sampler as soon as it is complete."""

    def __init__(self, sampler, uart, cts, battery, period_us, channels):
        self._sampler, self._uart, self._cts, self._battery = sampler, uart, cts, battery
        self._period_us, self._channels = period_us, channels
        self._sent = 0   # count of the batches at the latest one
        self._ticks = 0  # us, of its first sample
        self._timer = 0  # us, the same in 32 bits: ticks wrap earlier

    def step(self):
        """Send the latest batch, if there is a new one."""
        count, ticks, codes = self._sampler.latest()
        if count == self._sent:
            return
        self._timer = (self._timer + time.ticks_diff(ticks, self._ticks)) & 0xFFFFFFFF
        self._sent, self._ticks = count, ticks
        if self._cts.value() or not self._uart.txdone():
            return
        millivolts = self._battery.read_u16() * FULL_SCALE_MV * BATTERY_DIVIDER // 0xFFFF
        self._uart.write(transmit_request(payload(
            count - 1, self._timer, self._period_us, self._channels, codes, millivolts)))


def main():
    """Sample and send until the power is off."""
    sampler = Sampler([ADC(pin) for pin in FILMS], BATCH)
    node = Node(sampler, UART(0, BAUD_RATE, tx=Pin(TX), rx=Pin(RX), txbuf=FRAME_BYTES),
                Pin(CTS, Pin.IN), ADC(BATTERY), 1000000 // RATE, len(FILMS))
    Timer(freq=RATE, mode=Timer.PERIODIC, callback=sampler.sample, hard=True)
    while True:
        node.step()


if __name__ == '__main__':
    main()
