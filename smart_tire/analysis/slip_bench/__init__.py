"""How well slip and localization are told: estimates, rivals, scores and figures of a run."""
