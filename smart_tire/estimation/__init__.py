"""Samples in, estimates out: slip, pose, contacts and friction, on message time alone."""
