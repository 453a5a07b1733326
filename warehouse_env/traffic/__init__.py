"""Routes of several robots: conflicts and their cost, joint planning, and alternatives."""
