"""Routes of several robots: tasks drawn for them, and their conflicts."""
