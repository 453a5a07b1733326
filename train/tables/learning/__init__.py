"""What learning adds: trainings of several seeds, driven under every combination of options -> one table a floor."""
