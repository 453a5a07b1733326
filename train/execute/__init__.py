"""Plans of grid planners, driven by real bodies: readers, motions, the order of robots, the drive."""
