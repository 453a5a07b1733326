"""CL-MAPF, a public benchmark of car-like robots: its files, an exact check of solutions, rows and the table."""
