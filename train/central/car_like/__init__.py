"""Routes of car-like robots from pose to pose at unit speed, planned together, by arcs and straight lines."""
