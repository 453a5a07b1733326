"""Advice on a floor: how many robots it bears, where they wait, and what a change of it would bring."""
