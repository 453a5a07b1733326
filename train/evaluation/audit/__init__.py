"""An independent check of what robots drove, at every instant, in float64 and in other words than the engine's.

Nothing here is taken from the simulation's geometry, contact, motion or field: only what its state and config say.
"""
