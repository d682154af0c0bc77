"""`jenga`: finds the verb, prints what it says, and turns what a user can cause into one line and an exit code."""

import errno
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr
from functools import partial, wraps
from io import StringIO
from typing import Any

import msgspec
import tyro

from jenga_control.commands import bench as bench_control
from jenga_control.commands import demo, evaluate, replay
from jenga_control.commands import report as report_models
from jenga_data.calibrate.commands import calibrate
from jenga_data.command_line import Shown, Verb
from jenga_data.commands import bench, collect, convert, log
from jenga_data.commands import report as report_logs
from jenga_data.dataset.commands import dataset
from jenga_data.errors import JengaError
from jenga_models.commands import bench as bench_models
from jenga_models.commands import train

VERBS: Mapping[str, tuple[str, Callable[[Sequence[str]], Verb | dict[str, Verb]]]] = {
    "demo": ("the whole loop, small, in minutes", lambda _: demo),
    "collect": ("simulate rollouts and log them (selection, extraction)", lambda _: collect()),
    "convert": ("make a Parquet graph dataset from logs", lambda _: convert),
    "train": ("train a model (selection, dynamics)", train),
    "eval": ("held-out towers (selection, dynamics, extraction, and the simulator as a model)", lambda _: evaluate()),
    "replay": ("show an episode with models' predictions in rerun", lambda _: replay),
    "calibrate": (
        "how the simulated tower behaves (movable, contacts, ceiling, speed, rounds, turntable, sleep)",
        lambda _: calibrate(),
    ),
    "dataset": (
        "list, info, verify, trace, rebuild, merge, drop, diff, migrate, push, pull, export",
        lambda _: dataset(),
    ),
    "log": ("info, doctor, recover", lambda _: log()),
    "bench": (
        "how fast the parts are (sim, robot, log, loader, convert, control, replay)",
        lambda _: bench() | bench_models() | bench_control(),
    ),
    "report": (
        "what logs and models show (touch, selection, extraction, figures, page)",
        lambda _: report_logs() | report_models(),
    ),
}


_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM)
"""What a system says that has no room left, or none for this user."""
_FRAME = re.compile(r"\x1b\[[0-9;]*m|[╭╮╰╯│]")
_RULE = re.compile(r" *[─-]{4,} *")


def _listing(usage: str, verbs: Mapping[str, str]) -> str:
    width = max(map(len, verbs))
    lines = [usage, "", *(f"  {name:{width}}  {what}" for name, what in verbs.items())]
    return "\n".join([*lines, "", "--help behind a verb explains it."])


def _first_line(verb: Verb) -> str:
    return (verb.__doc__ or "").strip().splitlines()[0]


def _parse(verb: Verb, prog: str, args: Sequence[str]) -> Callable[[], Shown]:
    """The call that a command line asks for.

    Raises:
        JengaError: it asks for none; tyro explains that in a box of many lines.
        SystemExit: it asked for help, and got it.
    """

    @wraps(verb)
    def later(*values: Any, **named: Any) -> Callable[[], Shown]:
        return partial(verb, *values, **named)

    said = StringIO()
    try:
        with redirect_stderr(said):
            return tyro.cli(later, prog=prog, args=args)
    except SystemExit as stop:
        if not stop.code:
            raise
    raise JengaError(f"{_in_one_line(said.getvalue())}; see {prog} --help")


def _in_one_line(box: str) -> str:
    """What tyro says in a box: its sections without the title, the help of single options and where to find more."""
    sections: list[list[str]] = [[]]
    for line in _FRAME.sub("", box).splitlines()[1:]:
        if _RULE.fullmatch(line):
            sections.append([])
        elif not line.startswith(" " * 8):
            sections[-1].append(line.strip())
    told = [" ".join(lines).rstrip(". ") for lines in sections]
    told = [text for text in told if text and not text.startswith(("Argument helptext", "For full helptext"))]
    return "; ".join(text[0].lower() + text[1:] for text in told) or "this is no command"


def run(args: list[str]) -> int:
    """Parse and run one command line. Returns the exit code."""
    if not args or args[0] in ("-h", "--help"):
        listing = _listing("usage: jenga VERB [OPTIONS]", {name: what for name, (what, _) in VERBS.items()})
        print(listing, file=sys.stdout if args else sys.stderr)
        return 0 if args else 2
    if args[0] not in VERBS:
        raise JengaError(f"unknown verb {args[0]!r}; allowed: {', '.join(VERBS)}")
    prog, rest = args[0], args[1:]
    verb = VERBS[prog][1](rest)
    if isinstance(verb, dict):
        if not rest or rest[0] in ("-h", "--help"):
            listing = _listing(f"usage: jenga {prog} VERB [OPTIONS]", {n: _first_line(f) for n, f in verb.items()})
            print(listing, file=sys.stdout if rest else sys.stderr)
            return 0 if rest else 2
        if rest[0] not in verb:
            raise JengaError(f"unknown verb {rest[0]!r} of jenga {prog}; allowed: {', '.join(verb)}")
        prog, verb, rest = f"{prog} {rest[0]}", verb[rest[0]], rest[1:]
    shown = _parse(verb, f"jenga {prog}", rest)()
    print(msgspec.json.encode(shown.data).decode() if shown.json else shown.text, flush=True)
    return 0 if shown.ok else 1


def main() -> None:
    """The entry point: one line and an exit code for whatever a user can cause."""
    # Idle threads of torch shall sleep, not spin: on busy cores spinning makes training ten times slower.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        code = run(sys.argv[1:])
    except JengaError as error:
        print(f"jenga: {error}", file=sys.stderr)
        code = error.exit_code
    except BrokenPipeError:  # the reader, such as head, has seen enough
        sys.stdout = None
        code = 0
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        where = f" ({error.filename})" if error.filename else ""
        print(f"jenga: {error.strerror}{where}; make room, or choose another folder", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        print("jenga: interrupted; what was finished is kept", file=sys.stderr)
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
