"""ROS 2 nodes: each wires links, codecs and estimators to topics and computes nothing itself."""
