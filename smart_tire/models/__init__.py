"""Physics in closed form: pure, vectorized functions of numpy arrays."""
