"""Accuracy of slip and pose against reference methods, simulated and on recordings."""
