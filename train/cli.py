"""`warehouse COMMAND`: every command is a frozen dataclass of its options with a method `run`.

A new command is one line in COMMANDS. Its module is imported only when it is called, so that help is quick.
"""

from __future__ import annotations

import errno
import importlib
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple, Union

from warehouse_env.errors import ConfigError, LostError, MapWarning, WarehouseError, unknown_name

PROGRAM = "warehouse"
LOST = 3  # exit code where jobs were lost, or a broker
STOPPED, TERMINATED = 130, 143  # exit codes after Ctrl-C and SIGTERM, as shells use them
SHELLS = ("bash", "zsh", "fish")  # in which words can be completed


class Command(NamedTuple):
    """Where a command lives, module and dataclass in `train`, and what it does, in one line."""

    home: str  # as in "commands.demo:Demo"
    summary: str

    @property
    def module(self) -> str:
        """Name of the module."""
        return f"train.{self.home.partition(':')[0]}"

    @property
    def options(self) -> str:
        """Name of the dataclass."""
        return self.home.partition(":")[2]


_COMMANDS = {
    "demo": ("commands.demo:Demo", "compare the shipped policies in three minutes: table, pictures, video"),
    "plan": ("commands.plan:PlanCommand", "compare planners on the tasks of a map"),
    "tables papers": ("tables.runner:PapersTable", "reproduce the papers' tables, ours beside theirs, with verdicts"),
    "tables planners": ("tables.runner:PlannersTable", "plan the same pairs of cells on five floors by every planner"),
    "tables floors": ("tables.floors:FloorsTable", "drive policies and the rule on many floors, some drawn at random"),
    "layouts": ("commands.layouts:Layouts", "list, draw, check and convert maps"),
    "places": (
        "commands.places:PlacesCommand",
        "propose pick faces and stations of a hall, and draw them with numbers",
    ),
    "policies": ("commands.parts:Policies", "list the policies"),
    "planners": ("commands.parts:Planners", "list the planners"),
    "train reinforce": ("commands.training:TrainReinforce", "train our policy gradient"),
    "train ppo": ("commands.training:TrainPPO", "train PPO of stable-baselines3"),
    "train threaded_ppo": ("commands.training:TrainThreadedPPO", "train our own PPO, in threads"),
    "orders": ("commands.orders:Orders", "draw random orders for a floor, as a file for evaluate"),
    "evaluate": ("commands.evaluate:Evaluate", "drive policies over held-out episodes and count collisions"),
    "compare": ("commands.compare:Compare", "compare runs of evaluate by paired differences"),
    "benchmark": (
        "commands.benchmark:Benchmark",
        "drive policies through the fixed benchmark set, beside the shipped ones",
    ),
    "clmapf": ("commands.clmapf:Clmapf", "plan car-like robots on a public benchmark, and check any solution"),
    "advise": (
        "commands.advise:Advise",
        "estimate how many robots a floor supports, the bottlenecks, and what changes bring",
    ),
    "record": ("commands.replay:Record", "drive a policy through one episode and save it to a file"),
    "replay": ("commands.replay:ReplayCommand", "show recorded episodes: a page for the browser, a video, a window"),
    "fleet": (
        "commands.fleet:FleetCommand",
        "write an episode as VDA 5050 messages, check such a log, or judge a real fleet",
    ),
    "live": ("commands.live:Live", "run a simulation and steer it from a page in the browser"),
    "audit": ("commands.audit:AuditCommand", "check robots' motion at every instant: overlaps, limits, jumps"),
    "robust": (
        "commands.evaluate:Robust",
        "drive policies with other bodies, worse sensors and lost messages",
    ),
    "curves": ("commands.training:Curves", "draw the learning curves of several runs in one picture"),
    "compile": ("commands.compile:Compile", "compile all kernels ahead of time"),
    "bench": ("commands.bench:Bench", "measure the speed of the simulator, the planners and the trainers"),
}
COMMANDS = {name: Command(*line) for name, line in _COMMANDS.items()}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; return the exit code.

    0: success; 2: bad input, with one sentence on stderr; 3: a lost job or a missing broker; 130: Ctrl-C; 143: SIGTERM.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    warnings.formatwarning = _noted_once()
    try:
        with _terminable():
            return _run(arguments)
    except SystemExit as stop:  # tyro's own: 0 or None after --help and the like, 2 after a wrong option
        return stop.code if isinstance(stop.code, int) else 2 * (stop.code is not None)
    except KeyboardInterrupt as stop:
        print(f"{PROGRAM}: stopped" + "".join(f"; {text}" for text in stop.args), file=sys.stderr)
        return TERMINATED if isinstance(stop, _TerminationError) else STOPPED
    except WarehouseError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return LOST if isinstance(error, LostError) else 2
    except BrokenPipeError:  # the reader, say `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else "cannot print: " if error.errno == errno.ENOSPC else ""
        print(f"{PROGRAM}: {where}{error.strerror or error}", file=sys.stderr)
        return 2


def _open_streams() -> None:
    """Replace closed output streams by the null device, and characters that an encoding lacks by "?"."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _noted_once() -> Callable[..., str]:
    """Return a formatter like `_noted` that shows each note once, however many simulators give it."""
    said = set[str]()

    def shown(message: Warning | str, category: type[Warning], *where: Any) -> str:
        text = _noted(message, category, *where)
        again = text in said and issubclass(category, MapWarning)
        said.add(text)
        return "" if again else text

    return shown


def _noted(message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None) -> str:
    """Return a warning as it is shown: a MapWarning as one sentence."""
    if issubclass(category, MapWarning):
        return f"{PROGRAM}: note: {message}\n"
    return _USUAL(message, category, filename, lineno, line)


_USUAL = warnings.formatwarning


class _TerminationError(KeyboardInterrupt):
    """SIGTERM, by which a shutdown or a queue ends a command: it stops as after Ctrl-C."""


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM stop the command; only the main thread receives signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise _TerminationError

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _run(arguments: list[str]) -> int:
    if arguments[:1] == ["--version"]:
        from warehouse_env import __version__

        print(__version__)
        return 0
    if arguments[:1] == ["--print-completion"]:
        _print_completion(arguments[1:])
        return 0
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_help(""))
        return 0
    name = next((name for name in COMMANDS if name.split() == arguments[: len(name.split())]), None)
    if name is None:
        return _no_command(arguments)
    options = _options(_options_of(name), f"{PROGRAM} {name}", arguments[len(name.split()) :])
    if name not in _NAME_ROWS:
        _load_own(options)
    from train.doors import checked

    with checked(options):
        options.run()
    return 0


_NAME_ROWS = ("compare",)  # commands whose --policy chooses among rows
_PARTS = {"policy": "policy", "planner": "planner", "layout": "layout", "layouts": "layout", "draw": "layout"}


def _load_own(options: Any) -> None:
    """Load the user's own code that options name. Only typed names may run code, never those in files."""
    given = {**vars(options), **vars(getattr(options, "config", None) or SimpleNamespace())}
    values = {name: value if isinstance(value, tuple) else (value,) for name, value in given.items() if name in _PARTS}
    typed = [(_PARTS[name], text) for name, texts in values.items() for text in texts if text and ":" in text]
    if typed:
        from train.own import take_in

        take_in(typed)


def _options(options: Any, program: str, arguments: list[str]) -> Any:
    """Return the options made from a command line; errors of the dataclass are raised as they are.

    tyro passes on the errors of a function, but would frame those of a class.
    """
    import tyro

    if {"--layout", "--map"} <= {word.partition("=")[0] for word in arguments}:  # tyro would take the last
        raise ConfigError("--map is another name of --layout: give all floors behind one of them")

    def made(chosen: Any) -> Any:
        return chosen

    made.__annotations__["chosen"] = Annotated[options, tyro.conf.arg(name="")]
    if hasattr(options, "defaults_for"):  # one option sets the defaults of the others
        made.__defaults__ = (options.defaults_for(arguments),)
    return tyro.cli(made, prog=program, description=options.__doc__, args=arguments)


def _print_completion(shells: list[str]) -> None:
    """Print a script that completes commands and options in a shell; this imports every command."""
    from tyro.extras import subcommand_cli_from_dict

    if len(shells) != 1 or shells[0] not in SHELLS:
        raise WarehouseError(f"--print-completion needs the name of a shell: {', '.join(SHELLS)}")
    tree: dict[str, Any] = {}
    for name in dict.fromkeys(name.split()[0] for name in COMMANDS):
        tree[name] = _options_of(name) if name in COMMANDS else _group(name)
    subcommand_cli_from_dict(tree, prog=PROGRAM, args=["--tyro-print-completion", shells[0]])


def _options_of(name: str) -> Any:
    command = COMMANDS[name]
    return getattr(importlib.import_module(command.module), command.options)


def _group(name: str) -> Any:
    """Return a function whose argument is the options of one of the commands that start with a word."""
    from tyro.conf import arg, subcommand

    def chosen(options: Any) -> None: ...

    kinds = [
        Annotated[_options_of(one), subcommand(one.split()[1], prefix_name=False)]
        for one in COMMANDS
        if one.split()[0] == name
    ]
    chosen.__annotations__["options"] = Annotated[Union[tuple(kinds)], arg(name="")]  # noqa: UP007
    return chosen


def _no_command(arguments: list[str]) -> int:
    """Print help for the first word of a longer command (`warehouse train`), or raise for an unknown command."""
    group = arguments[0]
    inner = [name.split()[1] for name in COMMANDS if name.split()[0] == group]
    if not inner:
        raise unknown_name("command", group, {name.split()[0] for name in COMMANDS})
    if len(arguments) == 1 or arguments[1] in ("-h", "--help"):
        print(_help(f"{group} "))
        return 0
    raise unknown_name(f"{group} command", arguments[1], inner)


def _help(prefix: str) -> str:
    """Return the list of the commands that begin with `prefix`."""
    chosen = {name: command for name, command in COMMANDS.items() if name.startswith(prefix)}
    width = max(map(len, chosen))
    lines = [f"  {PROGRAM} {name:{width}}  {command.summary}" for name, command in chosen.items()]
    above = "Many robots in one warehouse: plan their routes, train how they avoid each other, and measure it."
    below = (
        f"`{PROGRAM} COMMAND --help` lists a command's options; `{PROGRAM} --version` prints the version;\n"
        f"`source <({PROGRAM} --print-completion bash)` lets the shell complete both (zsh and fish alike)."
    )
    return "\n".join([above, "", *lines, "", below])


if __name__ == "__main__":
    sys.exit(main())
