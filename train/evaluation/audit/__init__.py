"""An independent check of robots' motion at every instant, in float64.

It uses only the simulation's state and config, none of its geometry, contact, motion or shield.
"""
