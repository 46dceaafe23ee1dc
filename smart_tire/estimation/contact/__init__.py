"""Film samples to patch crossings: segment, detect, predict, associate."""
