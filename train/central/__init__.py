"""Planners that know the state of all robots."""
