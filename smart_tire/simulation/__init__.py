"""Simulated robot: plant, sensors, device emulators on pseudo-terminals, and ground truth."""
