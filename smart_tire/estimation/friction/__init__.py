"""Patch crossings to friction: waveform fit, brush inversion, Bayes filter over crossings."""
