"""From wanted motion to duties; time is an argument."""
