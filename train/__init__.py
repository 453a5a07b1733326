"""Experiments: training, evaluation, reports. Nothing in warehouse_env or agents imports this package."""

from warehouse_env.start import stranger

if _said := stranger("agents"):
    raise ImportError(_said)
