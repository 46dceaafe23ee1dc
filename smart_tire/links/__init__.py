"""Ports and clocks: bytes with the host's time on them, and the device's time told by it."""
