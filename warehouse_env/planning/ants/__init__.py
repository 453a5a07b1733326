"""Ant colonies: one loop (colony.py), one base (aco.py), and a file for each system that fills the slots."""
