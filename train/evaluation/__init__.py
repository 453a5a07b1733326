"""What drives, plans and counts: episodes and planning runs as rows, side by side in processes, and their pictures."""
