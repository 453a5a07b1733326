"""Swarms over way-points: one code of points and its decoding (waypoints.py), and a file for each swarm."""
