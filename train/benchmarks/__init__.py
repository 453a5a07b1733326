"""What is measured for speed: the simulator, the environments, the trainers, the planners, the ants against C."""
