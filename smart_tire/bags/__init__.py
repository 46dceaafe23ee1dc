# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reading, crash-safe writing and recovery of rosbag2 bags, without ROS."""

from smart_tire.bags.cdr import Decoder, SampleDecoder
from smart_tire.bags.input_check import check_inputs, contents
from smart_tire.bags.metadata import Channel, Qos
from smart_tire.bags.reader import Bag, BagTopic, PARAMETERS_KEY, report_losses
from smart_tire.bags.topic_names import match_by_name, STANDARD_NAMES, TopicNames
from smart_tire.bags.writer import BagWriter, channel_of, recover, Recovery

__all__ = [
    'Bag', 'BagTopic', 'BagWriter', 'Channel', 'channel_of', 'check_inputs', 'contents',
    'Decoder', 'match_by_name', 'PARAMETERS_KEY', 'Qos', 'recover', 'Recovery', 'report_losses',
    'SampleDecoder', 'STANDARD_NAMES', 'TopicNames']
