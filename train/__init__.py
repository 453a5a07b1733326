"""Experiments: training, evaluation, reports. Nothing in warehouse_env or agents imports this package."""
