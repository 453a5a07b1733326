"""The benchmark that others can enter: a fixed set of episodes, an entry's file, and the board of entries."""
