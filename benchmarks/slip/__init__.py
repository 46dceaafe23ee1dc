"""Accuracy of slip and pose compared with other methods, in simulation and on recordings."""
