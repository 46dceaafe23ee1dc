"""The simulated robot: plant and sensors, and the devices that speak their bytes."""
