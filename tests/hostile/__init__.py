"""Hostile inputs over all readers and constructors: each works, or one sentence says what is wrong."""
