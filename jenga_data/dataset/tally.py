"""What a manifest says about its logs: how many of what, and how to make them again."""

from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from itertools import groupby

import msgspec

from jenga_data.dataset.manifest import Counts, Provenance, Recipe
from jenga_data.dataset.sources import Source, Sources


def counts(sources: Sources, rows: int) -> Counts:
    """Episodes by outcome, round and cause."""
    valid = sources.valid
    return Counts(
        rows=rows,
        episodes=len(valid),
        towers=len({s.tower for s in valid}),
        invalid=len(sources.logs) - len(valid),
        dragged=sum(s.dragged for s in valid),
        outcome=dict(Counter(s.outcome for s in valid)),
        round=dict(Counter(str(s.round) for s in valid)),
        cause=dict(Counter(s.cause for s in valid if s.cause)),
    )


def provenance(sources: Sources) -> Provenance:
    """Recipes of all episodes, the invalid ones too: they are found again when the recipe is followed."""
    versions: dict[str, set[str]] = {}
    for found in {s.versions for s in sources.logs}:
        for package, number in msgspec.json.decode(found).items():
            versions.setdefault(package, set()).add(number)
    return Provenance(
        recipes=list(_recipes(sources.logs)),
        configs=sources.configs,
        commits=sorted({s.commit for s in sources.logs if s.commit}),
        versions={package: sorted(numbers) for package, numbers in versions.items()},
        converter={package: version(package) for package in ("jenga", "numpy", "pyarrow")},
    )


def _recipes(logs: Sequence[Source]) -> Iterator[Recipe]:
    for (seed, config, checkpoint), group in groupby(logs, lambda s: (s.seed, s.config, s.checkpoint)):
        ranges: list[tuple[int, int]] = []
        for number in sorted({s.number for s in group}):
            if ranges and ranges[-1][1] == number - 1:
                ranges[-1] = (ranges[-1][0], number)
            else:
                ranges.append((number, number))
        yield Recipe(config, seed, checkpoint, ranges)
