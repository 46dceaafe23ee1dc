"""Device protocols: encoders, decoders and deframers, without ports, clocks or logging."""
