"""The robots' work, as parts of EnvConfig: service times, orders, batteries."""

from dataclasses import dataclass
from typing import ClassVar

from warehouse_env.checked import CheckedPart

_DAY = 86_400.0  # [s]


@dataclass(frozen=True)
class ServiceSpec(CheckedPart):
    """How long a robot stands to be loaded or unloaded, and what it carries if there are no orders."""

    pick: float = 30.0  # [s] at a pick face, in the mean
    station: float = 30.0  # [s] at a station, in the mean
    variation: float = 0.0  # standard deviation over mean of a gamma distribution; 0: constant
    load: float = 0.0  # [kg] from a pick face to a station; with orders, theirs
    ranges: ClassVar = {"pick": (0.0, _DAY), "station": (0.0, _DAY), "variation": (0.0, 10.0), "load": (0.0, 1e9)}


@dataclass(frozen=True)
class OrderSpec(CheckedPart):
    """Where orders come from (a file or random draws), and who gets them (simulation/tasks/orders.py)."""

    file: str | None = None  # orders as CSV; None: drawn by the next fields
    per_hour: float = 240.0  # mean rate of a Poisson process
    # shares of classes A, B, C, ... among the orders, and among the pick faces
    demand: tuple[float, ...] = (0.8, 0.15, 0.05)
    faces: tuple[float, ...] = (0.2, 0.3, 0.5)
    picks: int = 1  # an order visits 1 to this many pick faces
    weight: float = 250.0  # [kg] mean of an order, uniform from 0 to twice this, at most RobotSpec.payload
    due: float = 900.0  # [s] after its release
    wave: float = 0.0  # [s] between releases of all orders that have come; 0: each at once
    allocation: str = "nearest"  # rule that assigns orders: a name of ALLOCATORS (simulation/tasks/orders.py)
    ranges: ClassVar = {
        "per_hour": (1e-3, 1e6), "picks": (1, 1000), "weight": (0.0, 1e9), "due": (0.0, 1e9), "wave": (0.0, _DAY),
        "demand": (0.0, 1.0), "faces": (0.0, 1.0),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("demand", "faces"):
            whole = abs(sum(getattr(self, name)) - 1.0) < 1e-6
            self._require(whole and len(self.demand) == len(self.faces), name, "shares that make 1, one for each class")
        sold = all(wanted == 0 or there > 0 for wanted, there in zip(self.demand, self.faces, strict=True))
        self._require(sold, "faces", "above 0 for every class in demand")


@dataclass(frozen=True)
class BatterySpec(CheckedPart):
    """Energy use and charging (simulation/tasks/duty.py)."""

    capacity: float = 1000.0  # [Wh]
    resistance: float = 0.03  # driving force over weight of robot and load: rolling and drive losses
    standing: float = 50.0  # [W] of computer, scanners and radio at all times
    chargers: int = 4  # charging places, each for one robot
    power: float = 1000.0  # [W] of a charger
    low: float = 0.3  # share of the capacity below which a robot charges next
    full: float = 0.9  # share up to which it charges
    ranges: ClassVar = {
        "capacity": (1e-3, 1e9), "resistance": (0.0, 10.0), "standing": (0.0, 1e6), "chargers": (1, 10_000),
        "power": (1e-3, 1e9), "low": (0.0, 1.0), "full": (0.0, 1.0),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(self.low < self.full, "low", "less than full")
        self._require(self.power > self.standing, "power", "more than a standing robot uses")
