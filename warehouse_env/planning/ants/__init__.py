"""Ant colonies: one loop (colony.py), one base (system.py), and a file for each system that fills the slots."""
