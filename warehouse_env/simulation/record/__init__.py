"""What is kept of an episode: metrics, recordings, the log of jams."""
