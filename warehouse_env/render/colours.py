"""Colours that colour-blind readers can tell apart too (after Okabe and Ito, 2008); each thing always has its own."""

import zlib
from collections.abc import Iterable
from functools import lru_cache

RGB = tuple[int, int, int]

BLUE: RGB = (0, 114, 178)
ORANGE: RGB = (230, 159, 0)
GREEN: RGB = (0, 158, 115)
PURPLE: RGB = (204, 121, 167)
SKY: RGB = (86, 180, 233)
VERMILION: RGB = (213, 94, 0)
INDIGO: RGB = (74, 63, 153)
OLIVE: RGB = (140, 134, 40)
GREY: RGB = (128, 132, 138)
CONTACT: RGB = (222, 22, 32)
WAITING: RGB = (255, 214, 0)  # light, DEADLOCK dark: distinct in grey, too
DEADLOCK: RGB = (106, 0, 150)

_ROBOTS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, INDIGO, OLIVE)
_SPARE = (PURPLE, SKY, INDIGO, OLIVE, VERMILION, GREEN, ORANGE, BLUE)

# fixed colours: a policy or planner has the same colour in every picture
_NAMED: dict[str, RGB] = {
    "follow": GREY, "brake": ORANGE, "reinforce": GREEN, "ppo": BLUE, "dijkstra": GREY, "astar": SKY,
    "astar_turns": PURPLE, "aco": ORANGE, "pf_aco": BLUE,
}  # fmt: skip


@lru_cache(maxsize=1024)
def mix(colour: RGB, other: RGB, share: float) -> RGB:
    """Return `colour` with a share in [0, 1] of `other`."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(colour, other, strict=True))
    return red, green, blue


def robot_colour(index: int) -> RGB:
    """Return robot `index`'s colour: eight hues, then the same darker, then lighter."""
    hue = _ROBOTS[index % len(_ROBOTS)]
    cycle = index // len(_ROBOTS) % 3
    return (hue, mix(hue, (0, 0, 0), 0.35), mix(hue, (255, 255, 255), 0.45))[cycle]


def name_colours(names: Iterable[str]) -> dict[str, RGB]:
    """Return a colour for every policy or planner: a fixed one if known, otherwise a free one chosen by its name."""
    known = list(dict.fromkeys(names))
    colours = {name: _NAMED[name] for name in known if name in _NAMED}
    for name in known:
        if name not in colours:
            first = zlib.crc32(name.encode())
            hues = [_SPARE[(first + k) % len(_SPARE)] for k in range(len(_SPARE))]
            order = [
                *hues,
                *(mix(hue, (0, 0, 0), 0.4) for hue in hues),
                *(mix(hue, (255, 255, 255), 0.4) for hue in hues),
            ]
            colours[name] = next((c for c in order if c not in colours.values()), order[0])
    return {name: colours[name] for name in known}
