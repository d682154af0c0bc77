"""`jenga`: finds the verb, prints what it says, and turns what a user can cause into one line and an exit code."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence

import msgspec
import tyro

from jenga_control.commands import demo, evaluate, replay
from jenga_data.command_line import Verb
from jenga_data.commands import collect, convert, dataset, log
from jenga_data.errors import JengaError
from jenga_models.commands import train

VERBS: Mapping[str, tuple[str, Callable[[Sequence[str]], Verb | dict[str, Verb]]]] = {
    "demo": ("the whole loop, small, in minutes", lambda _: demo),
    "collect": ("simulate rollouts and log them (selection, extraction)", lambda _: collect()),
    "convert": ("make a Parquet graph dataset from logs", lambda _: convert),
    "train": ("train a model (selection, dynamics)", train),
    "eval": ("evaluate a model on held-out towers (selection, dynamics, extraction)", lambda _: evaluate()),
    "replay": ("show an episode with models' predictions in rerun", lambda _: replay),
    "dataset": ("list, info, verify", lambda _: dataset()),
    "log": ("info, doctor, recover", lambda _: log()),
}


def _listing(usage: str, verbs: Mapping[str, str]) -> str:
    width = max(map(len, verbs))
    lines = [usage, "", *(f"  {name:{width}}  {what}" for name, what in verbs.items())]
    return "\n".join([*lines, "", "--help behind a verb explains it."])


def _first_line(verb: Verb) -> str:
    return (verb.__doc__ or "").strip().splitlines()[0]


def run(args: list[str]) -> int:
    """Parse and run one command line. Returns the exit code."""
    if not args or args[0] in ("-h", "--help"):
        print(_listing("usage: jenga VERB [OPTIONS]", {name: what for name, (what, _) in VERBS.items()}))
        return 0 if args else 2
    if args[0] not in VERBS:
        raise JengaError(f"unknown verb {args[0]!r}; allowed: {', '.join(VERBS)}")
    prog, rest = args[0], args[1:]
    verb = VERBS[prog][1](rest)
    if isinstance(verb, dict):
        if not rest or rest[0] in ("-h", "--help"):
            print(_listing(f"usage: jenga {prog} VERB [OPTIONS]", {n: _first_line(f) for n, f in verb.items()}))
            return 0 if rest else 2
        if rest[0] not in verb:
            raise JengaError(f"unknown verb {rest[0]!r} of jenga {prog}; allowed: {', '.join(verb)}")
        prog, verb, rest = f"{prog} {rest[0]}", verb[rest[0]], rest[1:]
    shown = tyro.cli(verb, prog=f"jenga {prog}", args=rest)
    print(msgspec.json.encode(shown.data).decode() if shown.json else shown.text)
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
    except KeyboardInterrupt:
        print("jenga: interrupted; what was finished is kept", file=sys.stderr)
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
