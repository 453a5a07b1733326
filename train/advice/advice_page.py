"""An advice as a page: the answer, the figures behind it, and the recommended floor as files."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from train.advice.answer import Advice, answer, effect_text, robots_text
from train.advice.changes import Effect
from train.advice.trials import BLOCK
from train.evaluation.pictures import file_name
from train.evaluation.rollout import summary_of
from train.reporting.page import Link, Page, PagePart, Shown, made_by
from train.reporting.report import Table, number, with_interval
from warehouse_env.errors import counted
from warehouse_env.files import companion
from warehouse_env.maps.halls import lif, places, route_graph
from warehouse_env.maps.halls.hall import Hall, parse
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.render import report_charts
from warehouse_env.render.heat_maps import SMALL, Panel, cell_kinds, hall_map, heat_maps

FOLDER = "floor"  # beside the page


def advice_page(advice: Advice, hall: Sequence[PagePart] = (), files: Sequence[Link] = ()) -> Page:
    """Return the page; hall: how a hall's map was understood. files: of the floor to take away."""
    grid = advice.plan.grid
    parts = [
        *hall,
        PagePart("How many robots", pictures=[_throughput(advice)], tables=[loads_table(advice)]),
        PagePart("Where the bottlenecks are", pictures=[_heat(advice)], tables=[places_table(advice)]),
        _of_change(advice),
        *([_to_take_away(advice, files)] if files else []),
        PagePart("What was run", facts=_facts(advice)),
    ]
    title = f"How many robots does {grid.name} support, and what delays them?"
    high, wide = (number(side * grid.cell_size) for side in grid.shape)
    subtitle = f"{wide} x {high} m, {len(grid.picks)} pick faces, {len(grid.stations)} stations"
    return Page(title, subtitle, answer(advice), parts)


def recommended(advice: Advice) -> Effect | None:
    """Return the measured change if it surely gains."""
    effect = advice.effect
    return effect if effect is not None and effect.significant and effect.gain.mean > 0 else None


def write_floor(advice: Advice, out: Path) -> list[Link]:
    """Write the recommended floor's files to OUT/floor; return links to them."""
    effect, folder = recommended(advice), out / FOLDER
    grid = advice.plan.grid if effect is None else effect.candidate.grid
    folder.mkdir(parents=True, exist_ok=True)
    stem = file_name(grid.name)
    floor, lanes, graph = (folder / f"{stem}{suffix}" for suffix in (".yaml", lif.SUFFIX, route_graph.SUFFIX))
    how = write_hall(grid, floor).removeprefix(str(floor))
    lif.write_lif(grid, lanes)
    route_graph.write_route_graph(grid, graph)
    text = "map_server, a pixel a cell, with pick faces, stations and arrows beside it; every command reads it as"
    return [
        Link(f"{FOLDER}/{path.name}", title, f"{path.name}: {what}")
        for path, title, what in (
            (floor, "Map", f"{text} --map {floor.name}{how}"),
            (lanes, "Lanes as LIF 1.0.0", "nodes, edges and stations, with one-way rules"),
            (graph, "Lanes for Nav2", "nodes, edges and stations, with one-way rules"),
        )
    ]


def _to_take_away(advice: Advice, files: Sequence[Link]) -> PagePart:
    """Return the files of the recommended floor."""
    effect, label = recommended(advice), "The floor to take away"
    if effect is None:
        return PagePart(label, "This is the floor as it is, since no change is known to gain anything.", links=files)
    one = effect.candidate
    drawing = heat_maps([Panel("", one.grid, opened=one.opened)], "", label)
    words = f"This is the floor with this change: {one.text}; on your own map these shelves still stand."
    return PagePart(label, words, [Shown(drawing, f"{label}, in green what is changed.")], links=files)


def _throughput(advice: Advice) -> Shown:
    capacity, noun = advice.capacity, advice.plan.aim.noun
    label = f"{noun.capitalize()} per hour of all robots together over their number"
    found = [report_charts.FloorLoad(load.robots, *load.goals[:3], load.jammed) for load in capacity.loads]
    named = report_charts.FloorLoad(capacity.goals.robots, *capacity.goals.goals[:3], False)
    caption = (
        f"{label}, in the second half of the episodes: means with 95% intervals. The large dot is the answer, on new "
        "seeds. The dashed line is the throughput if each robot were alone on the floor."
    )
    knee = capacity.knee[:3] if capacity.knee else None
    return Shown(report_charts.throughput(found, capacity.alone.mean, named, knee, label, noun), caption)


def loads_table(advice: Advice) -> Table:
    """Return a line for each number of robots, the answer on new seeds first."""
    capacity, noun = advice.capacity, advice.plan.aim.noun
    lines = [(f"{capacity.goals.robots}, new seeds", capacity.goals)]
    lines += [(str(load.robots), load) for load in capacity.loads]
    cells = [
        (
            name, str(load.episodes), with_interval(load.goals), with_interval(load.each),
            with_interval(load.waiting, 100), with_interval(load.stuck, 100),
            "jams" if load.jammed else "drives",
        )
        for name, load in lines
    ]  # fmt: skip
    header = ("robots", "episodes", f"{noun}/h, all", f"{noun}/robot-h", "waiting %", "stuck %", "")
    note = (
        f"{capacity.driven}The first line is the answer; the others are the episodes of the choice, fewer of them "
        "where a number looked worse. Stuck: robots without progress for over a minute at the end."
    )
    return Table(f"Robots under {capacity.team.policy}", header, tuple(cells), note)


def _heat(advice: Advice) -> Shown:
    grid = advice.plan.grid
    places = [tuple(grid.centre(place.cell).tolist()) for place in advice.bottlenecks]
    panels = [
        Panel("waiting [s per hour and cell]", grid, advice.floor.waiting, numbers=places),
        Panel("trips that pass [%]", grid, 100 * advice.visits),
    ]
    label = f"Where {advice.team.robots} robots wait, and where trips lead"
    caption = (
        f"{label}. Left: waiting time on each cell; the numbers are the worst places. Right: the share of random trips "
        "whose shortest route visits a cell. Blue squares are stations."
    )
    return Shown(heat_maps(panels, "", label, shared=False), caption)


def places_table(advice: Advice) -> Table:
    """Return a line for each bottleneck."""
    cells = [
        (
            str(k), f"{place.x:g}", f"{place.y:g}", f"{place.waiting:.0f}", f"{100 * place.share:.1f}",
            f"{100 * place.trips:.1f}",
        )
        for k, place in enumerate(advice.bottlenecks, start=1)
    ]  # fmt: skip
    header = ("place", "x [m]", "y [m]", "waiting [s per hour]", "of all waiting [%]", "trips that pass [%]")
    return Table(
        "Bottlenecks", header, tuple(cells), f"{advice.capacity.driven}Within two cells of the place's middle."
    )


def _of_change(advice: Advice) -> PagePart:
    """Return where the measured change lies and what it gains, or why none was driven."""
    aim, title, effect = advice.plan.aim, "What a change gains", advice.effect
    if effect is None:
        return PagePart(title, "None was driven: there was no time, or nothing can be changed.")
    one, label = effect.candidate, "The change that was measured"
    panel = Panel("", advice.plan.grid, advice.floor.waiting, opened=one.opened)
    caption = (
        f"{label}, in green, over where robots wait without it [s per hour]. **{one.text}**: "
        f"{effect_text(effect, aim)}."
    )
    drawing = heat_maps([panel], "standing [s per hour]", label)
    return PagePart(title, pictures=[Shown(drawing, caption)])


def _facts(advice: Advice) -> dict[str, str]:
    plan = advice.plan
    return made_by(**{
        "Policies": ", ".join(f"`{policy}`: {summary_of(policy)}" for policy in plan.policies),
        "Robots": robots_text(plan),
        "Episodes": f"of {plan.seconds:g} s, seeds from {plan.seed} on, {BLOCK} for each use",
        "Rows": "`rows.jsonl` beside this page holds every episode",
    })  # fmt: skip


_SIGNS = ("aisles close", "by unknown pixels", "lies beside")  # of doubtful lines in a hall's report


def hall_parts(hall: Hall, name: str) -> list[PagePart]:
    """Return two parts: the map with the floor over it, and what is doubtful; name: as it was typed."""
    label = f"The map of {hall.grid.name}, and the floor that robots drive on"
    caption = (
        f"{label}, in metres. Robots drive on whole cells of {hall.grid.cell_size:g} m; what is sand-coloured is floor "
        "on the map, and none here."
    )
    read = [_sentence(line) for line in hall.report if not any(sign in line for sign in _SIGNS)]
    doubtful = [_sentence(line) for line in doubts(hall, name)]
    shown = [Shown(hall_map(hall, label), caption)]
    heading = "What is doubtful about it, and what settles it"
    parts = [PagePart("The hall as it was understood", pictures=shown, points=read), PagePart(heading, points=doubtful)]
    return [part for part in parts if part.points]


def doubts(hall: Hall, name: str) -> Iterator[str]:
    """Yield what may be wrong and how to settle it, one sentence each, the gravest first."""
    path, how = parse(name)
    if not companion(path, places.SUFFIX).exists() and how.lanes is None:
        picks, stations = len(hall.places["picks"]), len(hall.places["stations"])
        yield (
            f"pick faces and stations are guessed: {counted(picks, 'pick face')} beside straight obstacles, "
            f"{counted(stations, 'station')} along the rim; all figures here depend on them; "
            f"`warehouse places {path.name}` draws them with numbers and writes a file to correct them"
        )
    small = int((cell_kinds(hall) == SMALL).sum())
    if small:
        yield (
            f"{counted(small, 'cell')} that robots drive on hold something small, as table legs, kerbs, or specks of "
            f"the scanner; `{with_parameter(name, 'share=0')}` closes them"
        )
    yield from hall.notes
    yield from (line for line in hall.report if any(sign in line for sign in _SIGNS))


def with_parameter(name: str, parameter: str) -> str:
    """Return a hall's name without its folders, with one more parameter."""
    path, colon, given = name.partition(":")
    kept = [one for one in given.split(",") if colon and one.partition("=")[0] != parameter.partition("=")[0]]
    return f"{Path(path).name}:{','.join([*kept, parameter])}"


def _sentence(text: str) -> str:
    plain = text.partition(" ")[0].islower() and "." not in text.partition(" ")[0]  # and no file's name
    return f"{text[0].upper() if plain else text[0]}{text[1:]}."
