"""The tire of paper B: brush model, tread strain and the waveform of a patch crossing."""
