"""The film of paper A: elastica, buckled film, hysteresis and signal chain."""
