"""Halls as their own software draws them: a robot's map, keepout and speed masks, places, lanes."""
