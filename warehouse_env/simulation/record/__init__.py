"""Records of an episode: metrics, recordings, who waited for whom."""
