"""The tables of the five papers as data: maps, systems, printed figures, claims."""
