"""What learns: the choices of a training, its worlds, experience, checkpoints, progress and card."""
