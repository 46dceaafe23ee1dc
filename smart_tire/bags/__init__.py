"""Reading, crash-safe writing and recovery of rosbag2 bags, without ROS."""

from smart_tire.bags.metadata import Qos
from smart_tire.bags.reader import Bag, BagTopic
from smart_tire.bags.recover import recover, Recovery
from smart_tire.bags.storage import Channel
from smart_tire.bags.writer import BagWriter, channel_of

__all__ = ['Bag', 'BagTopic', 'BagWriter', 'Channel', 'channel_of', 'Qos', 'recover', 'Recovery']
