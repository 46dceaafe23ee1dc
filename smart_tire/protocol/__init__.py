"""Bytes to samples and back: no port, no clock, no log; encoder and decoder side by side."""
