"""Advice on a floor: how many robots it supports, where they wait, and what a change of the floor gains."""
