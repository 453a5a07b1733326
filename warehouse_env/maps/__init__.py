"""Where it happens: the grid map, the named layouts, and the MovingAI file formats."""

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap

__all__ = ["MOVES", "Cell", "GridMap"]
