"""Identification of a film from a recording on a test stand (paper A)."""
