"""Physics in closed form: pure, vectorised functions of numpy arrays."""
