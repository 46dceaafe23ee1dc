"""The skid-steered vehicle: kinematics and wheel loads."""
