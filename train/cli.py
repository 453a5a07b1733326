"""`warehouse COMMAND`: every command is a frozen dataclass of its options with a method `run`.

A new command is one line in COMMANDS. Its module is imported only when it is called, so that help is quick.
"""

import errno
import importlib
import inspect
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple, NoReturn

from warehouse_env.errors import ConfigError, LostError, MapWarning, WarehouseError, unknown_name
from warehouse_env.old_names import POLICIES

PROGRAM = "warehouse"
LOST = 3  # exit code where jobs were lost, or a broker
STOPPED, TERMINATED = 130, 143  # exit codes after Ctrl-C and SIGTERM, as shells use them


class Command(NamedTuple):
    """Where the dataclass of a command's options lives below `train`, and what the command does, in one line."""

    home: str  # as in "commands.demo:Demo"
    summary: str


COMMANDS = {
    "demo": Command("commands.demo:Demo", "compare the shipped policies in three minutes: table, pictures, video"),
    "plan": Command("commands.plan:PlanCommand", "compare planners on the tasks of a map"),
    "tables papers": Command("tables.runner:PapersTable", "reproduce the papers' tables and judge their claims"),
    "tables planners": Command("tables.runner:PlannersTable", "plan the same pairs of cells by every planner"),
    "tables floors": Command("tables.floors:FloorsTable", "drive policies and the rule on many floors"),
    "layouts": Command("commands.layouts:Layouts", "list, draw, check and convert maps"),
    "places": Command("commands.layouts:PlacesCommand", "propose pick faces and stations of a hall, and draw them"),
    "policies": Command("commands.layouts:Policies", "list the policies"),
    "planners": Command("commands.layouts:Planners", "list the planners"),
    "train reinforce": Command("commands.training:Train", "train by our REINFORCE, with live routes"),
    "train ppo": Command("commands.training:Train", "train by PPO of stable-baselines3, with live routes"),
    "train shielded": Command("commands.training:Train", "train by our PPO, from busy on, under the shield"),
    "train unshielded": Command("commands.training:Train", "train by our PPO, with live routes, for few contacts"),
    "train careful": Command("commands.training:Train", "train by our PPO, from unshielded on, for fewer contacts"),
    "train fixed_routes": Command("commands.training:Train", "train by our PPO, as in papers: fixed routes, no shield"),
    "train fixed_routes_reinforce": Command("commands.training:Train", "train so by our REINFORCE"),
    "train fixed_routes_ppo": Command("commands.training:Train", "train so by PPO of stable-baselines3"),
    "train busy": Command("commands.training:Train", "train careful on in thousands of worlds on a GPU"),
    "train patient": Command("commands.training:Train", "train careful on so, with fixed routes"),
    "evaluate": Command("commands.evaluate:Evaluate", "drive policies over held-out episodes and count collisions"),
    "compare": Command("commands.compare:Compare", "compare runs of evaluate by paired differences"),
    "benchmark": Command("commands.evaluate:Benchmark", "drive policies through the fixed benchmark set"),
    "execute": Command("commands.execute:Execute", "drive the plan of a grid planner (MAPF) with real bodies"),
    "clmapf": Command("commands.clmapf:Clmapf", "plan car-like robots on a public benchmark, and check any solution"),
    "advise": Command("commands.advise:Advise", "estimate how many robots a floor supports, and what would help"),
    "record": Command("commands.replay:Record", "drive a policy through one episode and save it to a file"),
    "replay": Command("commands.replay:ReplayCommand", "show recorded episodes as a page for the browser or a video"),
    "fleet": Command("commands.fleet:FleetCommand", "write or check VDA 5050 messages, or judge a real fleet"),
    "live": Command("commands.live:Live", "run a simulation and steer it from a page in the browser"),
    "audit": Command("commands.audit:AuditCommand", "check robots' motion at every instant: overlaps, limits, jumps"),
    "robust": Command("commands.evaluate:Robust", "drive policies with other bodies, worse sensors and lost messages"),
    "export": Command("commands.export:Export", "write a trained policy as an ONNX model"),
    "compile": Command("commands.compile:Compile", "compile all kernels ahead of time"),
    "bench": Command("commands.bench:Bench", "measure the speed of the simulator and the trainers"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; return the exit code.

    0: success; 2: bad input, with one sentence on stderr; 3: a lost job or a missing broker; 130: Ctrl-C; 143: SIGTERM.
    """
    return _ended(partial(_run, list(sys.argv[1:] if argv is None else argv)))


def run_script(options: Any, work: Callable[[Any], None]) -> NoReturn:
    """Run a script by the dataclass of its options, one of them the file or folder `out`; it ends as `main` does."""
    from warehouse_env.files import check_writable

    def run() -> None:
        chosen = _options(options, sys.argv[0], sys.argv[1:])
        check_writable(chosen.out if chosen.out.suffix else chosen.out / "config.json")
        work(chosen)

    sys.exit(_ended(run))


def _ended(work: Callable[[], int | None]) -> int:
    """Return the exit code of `work`, whose errors are one sentence on stderr."""
    _open_streams()
    warnings.formatwarning = _notes()
    try:
        with _terminable():
            return work() or 0
    except SystemExit as stop:  # tyro's own: 0 or None after --help and the like, 2 after a wrong option
        return stop.code if isinstance(stop.code, int) else 2 * (stop.code is not None)
    except KeyboardInterrupt as stop:
        print(f"{PROGRAM}: stopped" + "".join(f"; {text}" for text in stop.args), file=sys.stderr)
        return TERMINATED if isinstance(stop, _TerminationError) else STOPPED
    except WarehouseError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return LOST if isinstance(error, LostError) else 2
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
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


_USUAL = warnings.formatwarning


def _notes() -> Callable[..., str]:
    """Return a formatter of warnings that shows a MapWarning as one sentence, once however many simulators give it."""
    said = set[str]()

    def formatted(message: Warning | str, category: type[Warning], *where: Any) -> str:
        if not issubclass(category, MapWarning):
            return _USUAL(message, category, *where)
        text = f"{PROGRAM}: note: {message}\n"
        again = text in said
        said.add(text)
        return "" if again else text

    return formatted


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
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_help(""))
        return 0
    if arguments[0] == "train":
        arguments = ["train", *(POLICIES.get(word, word) for word in arguments[1:2]), *arguments[2:]]
    name = next((name for name in COMMANDS if name.split() == arguments[: len(name.split())]), None)
    if name is None:
        return _no_command(arguments)
    options = _options(options_of(name), f"{PROGRAM} {name}", arguments[len(name.split()) :])
    if name not in _NAME_ROWS:
        _load_own(options)
    from train.job_files import checked

    with checked(options):
        options.run()
    return 0


_NAME_ROWS = ("compare",)  # commands whose --policy chooses among rows
_PARTS = {kind: kind for kind in ("policy", "planner", "layout", "sensor", "tasks", "grid_planner")}
_PARTS |= {"layouts": "layout", "draw": "layout"}


def _load_own(options: Any) -> None:
    """Load the user's own code that options name. Only typed names may run code, never those in files."""
    given = {**vars(options), **vars(getattr(options, "config", None) or SimpleNamespace())}
    values = {name: value if isinstance(value, tuple) else (value,) for name, value in given.items() if name in _PARTS}
    typed = [(_PARTS[name], text) for name, texts in values.items() for text in texts if ":" in str(text)]
    if typed:
        from train.job_files import take_in

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
    described = options
    if hasattr(options, "defaults_for"):  # the last word of the command sets the defaults
        usual = options.defaults_for(program.split()[-1])
        made.__defaults__, described = (usual,), type(usual.config)
    if {"-h", "--help"}.intersection(arguments):
        for one in {options, described}:
            _join_lines(one)
    return tyro.cli(made, prog=program, description=inspect.getdoc(described), args=arguments)


def _join_lines(options: Any) -> None:
    """Give each option its docstring as one line, since tyro would keep its line breaks."""
    from docstring_parser import parse_from_object

    for one in options.__mro__[-2::-1]:
        for said in parse_from_object(one).params:
            options.__dataclass_fields__[said.arg_name].metadata = {"help": " ".join((said.description or "").split())}


def options_of(name: str) -> Any:
    """Return the dataclass of a command's options; help lists its own before those that it shares with others."""
    module, _, options = COMMANDS[name].home.partition(":")
    made = getattr(importlib.import_module(f"train.{module}"), options)
    homes = {name: one.__module__ for one in made.__mro__[::-1] for name in vars(one).get("__annotations__", ())}
    fields = sorted(made.__dataclass_fields__.items(), key=lambda field: homes[field[0]] != made.__module__)
    made.__dataclass_fields__ = dict(fields)
    return made


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
    below = f"`{PROGRAM} COMMAND --help` lists a command's options; `{PROGRAM} --version` prints the version."
    return "\n".join([above, "", *lines, "", below])


if __name__ == "__main__":
    sys.exit(main())
