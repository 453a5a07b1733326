"""What a colony can do that A* cannot, with several robots: the study behind `warehouse tables traffic`."""
