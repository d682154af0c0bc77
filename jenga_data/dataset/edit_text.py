"""What the verbs that make datasets say of what they made."""

from pathlib import Path

from jenga_data.command_line import Shown
from jenga_data.dataset.manifest import Manifest
from jenga_data.dataset.parents import Edited
from jenga_data.outcome import Outcome

_SHOWN = 5
"""Towers that are named."""


def edited_shown(edited: Edited, out: Path, json: bool) -> Shown:
    """A new version: what it holds, and what of it is new."""
    counts = edited.manifest.counts
    lines = [
        f"{edited.manifest.identifier} in {out}",
        f"  {counts.rows:,} rows of {counts.episodes:,} episodes of {counts.towers:,} towers",
        *edit_lines(edited),
    ]
    return Shown(json, edited.as_dict() | {"out": str(out)}, "\n".join(lines))


def edit_lines(edited: Edited) -> list[str]:
    """Where its files come from, and whose rows may now be tested on although a parent trained on them."""
    parents = ", ".join(f"{p.name}@{p.version}" for p in edited.manifest.parents)
    lines = [f"  {edited.taken} files of rows as they are in {parents}, {edited.written} written"]
    if edited.copies:
        lines.append(f"  {edited.copies:,} episodes were there already and count once")
    if edited.moved:
        moved = [f"{tower} {before} -> {now}" for tower, (before, now) in sorted(edited.moved.items())]
        more = f", and {len(moved) - _SHOWN} more" if len(moved) > _SHOWN else ""
        lines.append(
            f"  {len(moved)} towers are on another side than in a parent, so do not test a model of the parent here: "
            f"{', '.join(moved[:_SHOWN])}{more}"
        )
    return lines


def conversion_text(manifest: Manifest, rounds: dict[int, dict[str, int]]) -> str:
    """What became of the episodes: a table with a line a round and a column an outcome."""
    counts = manifest.counts
    names = [o.value for o in Outcome if o.value in counts.outcome]
    table = [["round", *names, "episodes"]]
    table += [[str(r), *(str(of.get(n, 0)) for n in names), str(sum(of.values()))] for r, of in rounds.items()]
    table.append(["all", *(str(counts.outcome[n]) for n in names), str(counts.episodes)])
    lines = ["  " + "  ".join(f"{cell:>9}" for cell in row) for row in table]
    rest = {"rows": counts.rows, "towers": counts.towers, "invalid": counts.invalid, "dragged": counts.dragged}
    rest |= {f"cause {cause}": number for cause, number in counts.cause.items()}
    return "\n".join([*lines, "  " + ", ".join(f"{number:,} {what}" for what, number in rest.items())])
