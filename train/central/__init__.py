"""Routes over pose and time for car-like robots, planned together."""
