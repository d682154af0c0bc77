"""An episode in words, as Markdown: how it ended and why, what it was, and where it came from."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from jenga_data.episode import Episode, EpisodeHeader, Prediction
from jenga_data.replay.measures import MM, error_scale, has_chances, metres_per_newton, model_labels, seconds
from jenga_data.replay.plans import Plans
from jenga_data.tower import CENTRE

_SHORT = 12
"""So many digits of a hash tell it from all others, and fit a narrow panel."""


def outcome_words(episode: Episode) -> str:
    """How the episode ended and, where something went wrong on the robot's side, why."""
    if episode.result is None:
        return "unknown: the log ends before its outcome"
    words = str(episode.result.verdict.outcome)
    if episode.result.verdict.dragged:
        words += ", others dragged"
    return f"{words} ({episode.result.cause})" if episode.result.cause else words


def target_words(header: EpisodeHeader) -> str:
    """Which block is pulled, and where it lies."""
    place = header.layout.place(header.target)
    side = "centre" if place.slot == CENTRE else "side"
    return f"block {header.target}: level {place.level}, slot {place.slot} ({side})"


def summary(
    episode: Episode, predictions: Sequence[Prediction], plans: Plans | None = None, notes: Sequence[str] = ()
) -> str:
    """The whole text, for a viewer that shows Markdown; `notes` say what is not shown, and why."""
    header, time = episode.header, seconds(episode)
    facts = [
        ("episode", f"{header.kind} {header.number}, seed {header.seed}"),
        ("target", target_words(header)),
        ("round", str(header.round)),
        ("turn", f"{90 * (header.turn % 4)}°, pulled at its {'-x' if header.face == 0 else '+x'} end"),
        ("length", f"{time[-1]:.2f} s, {len(time)} frames"),
    ]
    if episode.result is not None:
        verdict = episode.result.verdict
        facts.append(("others moved", f"{verdict.moved * MM:.1f} mm at most"))
        clear = "never" if verdict.clear_frame < 0 else f"at {time[verdict.clear_frame]:.2f} s"
        facts.append(("target clear", clear))
    facts += chances(header.target, predictions)
    if plans is not None and plans.note:
        facts.append(("plans", plans.note))
    facts += [("note", note) for note in notes]
    provenance = [("key", header.key), ("tower", header.blocks.tower)]
    if header.checkpoint:
        provenance.append(("acting model", header.checkpoint[:_SHORT]))
    provenance += [(f"model {p.name}, {p.kind.replace('_', ' ')}", p.checkpoint[:_SHORT]) for p in predictions]
    provenance += [(name.replace("_", " "), _shortened(value)) for name, value in sorted(header.provenance.items())]
    parts = [("Colours", _colours(episode, predictions, plans)), ("Provenance", provenance)]
    lines = [f"# {outcome_words(episode)}", "", *_list(facts)]
    for title, rows in parts:
        lines += ["", f"## {title}", "", *_list(rows)]
    return "\n".join(lines)


def _colours(episode: Episode, predictions: Sequence[Prediction], plans: Plans | None) -> list[tuple[str, str]]:
    """What the colours and lengths of the drawing mean."""
    rows = [("target", "blue")]
    for label, prediction in zip(model_labels(predictions), predictions, strict=True):
        if len(prediction.frame):
            rows.append((label, f"error from white (0) to dark red ({error_scale(episode, prediction) * MM:g} mm)"))
    if any(has_chances(p) for p in predictions):
        rows.append(("chance to fail", "blue (0) over white to red (1), grey: no legal target"))
    forces = np.concatenate([contacts.force for contacts in episode.contacts])
    if len(forces):
        rows.append(
            ("arrows", f"1 cm is {0.01 / metres_per_newton(forces):g} N; red: on the target, yellow: elsewhere")
        )
    if plans is not None and len(plans.frame):
        rows.append(("plans", "blue: sampled, orange: the one decided on"))
    return rows


def chances(target: int, predictions: Sequence[Prediction]) -> Iterable[tuple[str, str]]:
    """What each selector gave the target, once a model."""
    chance = {p.name: float(p.failure_probability[target]) for p in predictions}
    return [(f"failure, says {name}", f"{100 * p:.0f} %") for name, p in chance.items() if np.isfinite(p)]


def _list(rows: Sequence[tuple[str, str]]) -> Iterable[str]:
    return [f"- **{name}** {value}" for name, value in rows]


def _shortened(value: str) -> str:
    """A commit or another hash cut short, with what stands behind it; anything else as it is."""
    return re.sub(r"[0-9a-f]{32,}", lambda found: found.group()[:_SHORT], value)
