"""What the verbs of the command line have in common. Light to import: every --help answers at once."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Optional

import tyro

Json = Annotated[bool, tyro.conf.arg(name="json", help="print one JSON object and nothing else")]
Inline = tyro.conf.arg(name="")
"""Fields of a configuration stand beside the verb's own options."""
# For `X | None` tyro imports a type checker, half of the time that a --help takes; for this form it needs none.
MaybePath = Optional[Path]  # noqa: UP045
MaybeText = Optional[str]  # noqa: UP045
MaybeInt = Optional[int]  # noqa: UP045
MaybeFloat = Optional[float]  # noqa: UP045


@dataclass(frozen=True)
class Shown:
    """What a verb has to say: `data` with --json, else `text`; `ok` decides between exit codes 0 and 1."""

    json: bool
    data: Any
    text: str
    ok: bool = True


Verb = Callable[..., Shown]
