"""When vehicles of a fleet were silent: after a last will, or for long without a message."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.received import GONE, HeardVehicle, Key
from warehouse_env.errors import counted

SILENCE = 30.0  # [s] after which a vehicle should have said something
_NAMED = 10  # in notes


class Silence(NamedTuple):
    """A time without a message, though the vehicle did not go offline; seconds since the episode began."""

    begin: float  # the last message
    until: float  # the next one, inf if there is none
    broken: bool  # the broker sent its last will


def silences_of(vehicle: HeardVehicle, begin: float, end: float) -> list[Silence]:
    """Return when a vehicle was silent; begin, end: of the episode [s] since 1970."""
    heard = np.unique(np.concatenate([vehicle.reports[:, 0], [told.seconds for told in vehicle.told]]))
    until = np.append(heard[1:], np.inf)

    def marked(state: str) -> NDArray[np.bool_]:
        """Return bool[K]: after which messages the connection was in a state."""
        moments = np.array([moment for moment, other in vehicle.connected if other == state and moment >= heard[0]])
        found = np.zeros(len(heard), np.bool_)
        found[np.searchsorted(heard, moments, "right") - 1] = True
        return found

    quiet = np.minimum(until, max(end, heard[-1])) - heard > SILENCE + 1
    offline, broken = map(marked, GONE)
    chosen = np.flatnonzero(broken | (quiet & ~offline))
    return [Silence(float(heard[k]) - begin, float(until[k]) - begin, bool(broken[k])) for k in chosen]


def within(silences: list[Silence], times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return bool[F]: which moments [s] lie in a silence."""
    found = np.zeros(len(times), np.bool_)
    for one in silences:
        found |= (times > one.begin) & (times < one.until)
    return found


def silences_notes(silences: dict[Key, list[Silence]]) -> list[str]:
    """Return a note on each silence, and on the number of those that are too many."""
    notes = []
    for key, found in silences.items():
        for one in found:
            until = f"to {one.until:.1f} s" if one.until < np.inf else "on"
            why = "its connection broke" if one.broken else "no message"
            notes.append(f"{'/'.join(key)} is silent from {one.begin:.1f} s {until}: {why}")
    more = len(notes) - _NAMED
    return [*notes[:_NAMED], *([f"{counted(more, 'more silence')} of vehicles"] if more > 0 else [])]
