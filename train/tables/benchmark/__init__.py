"""The benchmark beyond the papers: every planner on the same pairs of cells of five floors, and public peers."""
