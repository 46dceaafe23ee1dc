# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paced publishing: a subscription of default depth 10 receives every sample of a batch."""

from __future__ import annotations

from itertools import count
from pathlib import Path
import time

import pytest
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from support import keep_last
from support.graph import Process
from support.waiting import PATIENCE

pytestmark = [pytest.mark.processes, pytest.mark.long]

BATCH_PERIOD = 0.04  # s, 16 samples at 400 Hz
COMPLETE_BATCHES = 5  # in a row; without pacing each loses about 5 of its 16 samples
UNITS = {0x0013A20040A1B2C2: 'front_left', 0x0013A20040A1B2C3: 'front_right'}


def packet(number, address):
    """Return the bytes of a sensor node's batch ``number``."""
    batch = TireBatch(flags=0, sequence=number, timer_us=40_000 * number, period_us=2500,
                      codes=((500, 512),) * 16, battery_mv=3700)
    return encode_frame(encode_receive_packet(
        ReceivePacket(address, 0xFFFE, 1, encode_batch(batch))))


def test_a_subscription_of_depth_10_in_another_process_receives_all_samples(graph, port, tmp_path):
    port.plug_in()
    text = '[' + ', '.join(f'"{unit:016X}={wheel}"' for unit, wheel in UNITS.items()) + ']'
    listener = [str(Path(keep_last.__file__)), str(16 * COMPLETE_BATCHES)]
    with graph.start('tire_receiver', port=port.path, units=text) as node, \
            Process(listener, tmp_path / 'listener.log') as subscriber:
        graph.until(lambda: graph.value('tire_receiver', 'port_opened') == '1')
        begin = time.monotonic()
        for number in count():
            if subscriber.popen.poll() is not None:
                break
            assert time.monotonic() - begin < PATIENCE, 'every batch lost samples'
            port.write(b''.join(packet(number, unit) for unit in UNITS))
            # The radio sends batches at a fixed rate, whether or not they are received.
            time.sleep(max(0.0, begin + (number + 1) * BATCH_PERIOD - time.monotonic()))
        assert subscriber.ended() == 0, subscriber.output
        assert node.end() == 0
