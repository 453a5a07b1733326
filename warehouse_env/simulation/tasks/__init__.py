"""What there is to do: tasks, their dispatch, and where robots stand at first."""
