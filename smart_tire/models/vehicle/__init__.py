"""The skid-steer vehicle: kinematics and wheel loads."""
