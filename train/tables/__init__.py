"""The comparison tables of the papers, from fixed seeds: `warehouse tables`."""
