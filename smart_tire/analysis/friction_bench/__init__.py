"""How well friction is told: synthesised passages, whole runs, rivals, scores and figures."""
