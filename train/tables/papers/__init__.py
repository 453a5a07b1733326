"""The floors of the papers' tables, and the experiments that are no single plan."""
