"""Where a dataset's episodes come from: recipes to make them again, taken from logs or carried over from parents."""

from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from itertools import chain

import msgspec

from jenga_data.dataset.episode_table import Table
from jenga_data.dataset.manifest import Manifest, Provenance, Recipe
from jenga_data.dataset.sources import Sources
from jenga_data.errors import JengaError

Numbers = dict[tuple[int, str, str], set[int]]
"""Numbers of episodes by seed, config and checkpoint."""

MOST_NUMBERS = 5_000_000
"""Recipes of more episodes are refused unread: a range of two numbers from elsewhere must not fill the memory."""


def provenance(sources: Sources) -> Provenance:
    """Of logs. Recipes name the invalid episodes too: they are found again when the recipe is followed."""
    numbers: Numbers = {}
    for log in sources.logs:
        numbers.setdefault((log.seed, log.config, log.checkpoint), set()).add(log.number)
    return Provenance(
        recipes=_recipes(numbers),
        configs=sources.configs,
        commits=sorted({s.commit for s in sources.logs if s.commit}),
        versions=_versions(s.versions for s in sources.logs),
        converter={package: version(package) for package in ("jenga", "numpy", "pyarrow")},
    )


def joined_provenance(parents: Sequence[Provenance]) -> Provenance:
    """Of everything that the parents come from, without anything twice."""
    numbers: Numbers = {}
    versions: dict[str, set[str]] = {}
    converter: dict[str, set[str]] = {}
    for parent in parents:
        for key, found in numbers_of(parent).items():
            numbers.setdefault(key, set()).update(found)
        for package, known in parent.versions.items():
            versions.setdefault(package, set()).update(known)
        for package, known in parent.converter.items():
            converter.setdefault(package, set()).update(known.split(", "))
    return Provenance(
        recipes=_recipes(numbers),
        configs=dict(sorted((k, v) for parent in parents for k, v in parent.configs.items())),
        commits=sorted({commit for parent in parents for commit in parent.commits}),
        versions={package: sorted(known) for package, known in versions.items()},
        converter={package: ", ".join(sorted(known)) for package, known in converter.items()},
    )


def remaining_provenance(parent: Provenance, before: Table, after: Table) -> Provenance:
    """Of the episodes that are left when a dataset with the table `before` keeps those in `after`.

    Its invalid episodes stay in the recipes. Which commits and versions wrote them nobody knows any more, so that
    those of the parent are kept if it has any.
    """
    invalid, kept = invalid_numbers(parent, before), _listed(after)
    numbers = {key: invalid.get(key, set()) | kept.get(key, set()) for key in numbers_of(parent)}
    recipes = _recipes({key: found for key, found in numbers.items() if found})
    used = {recipe.config for recipe in recipes}
    left = msgspec.structs.replace(
        parent, recipes=recipes, configs={k: v for k, v in parent.configs.items() if k in used}
    )
    if any(invalid.values()):
        return left
    commits = sorted({commit for commit in after["commit"].tolist() if commit})
    return msgspec.structs.replace(left, commits=commits, versions=_versions(after["versions"].tolist()))


def numbers_of(parent: Provenance) -> Numbers:
    """What the recipes say, number by number.

    Raises:
        JengaError: that would be absurdly many.
    """
    count = sum(max(last - first + 1, 0) for recipe in parent.recipes for first, last in recipe.numbers)
    if count > MOST_NUMBERS:
        raise JengaError(f"a manifest has recipes of {count} episodes; allowed: up to {MOST_NUMBERS}")
    return {
        (r.seed, r.config, r.checkpoint): set(chain.from_iterable(range(a, b + 1) for a, b in r.numbers))
        for r in parent.recipes
    }


def invalid_numbers(parent: Provenance, table: Table) -> Numbers:
    """Episodes of the recipes that are not in the table: those whose physics broke."""
    valid = _listed(table)
    return {key: found - valid.get(key, set()) for key, found in numbers_of(parent).items()}


def joined_invalid(parents: Sequence[tuple[Manifest, Table]]) -> int:
    """How many episodes with broken physics the parents have together, each counted once.

    Raises:
        JengaError: an episode is broken in one parent and whole in another.
    """
    union: Numbers = {}
    twice = 0
    for manifest, table in parents:
        for key, found in invalid_numbers(manifest.provenance, table).items():
            before = union.setdefault(key, set())
            twice += len(found & before)
            before |= found
    for manifest, table in parents:
        for key, found in _listed(table).items():
            if both := found & union.get(key, set()):
                raise JengaError(
                    f"number {min(both)} of seed {key[0]} is an episode of {manifest.identifier} and one with broken "
                    "physics of another parent: drop it from the first, or leave one parent out"
                )
    return max(sum(manifest.counts.invalid for manifest, _ in parents) - twice, 0)


def _listed(table: Table) -> Numbers:
    numbers: Numbers = {}
    for *key, number in zip(*(table[n].tolist() for n in ("seed", "config", "checkpoint", "number")), strict=True):
        numbers.setdefault((key[0], key[1], key[2]), set()).add(number)
    return numbers


def _recipes(numbers: Numbers) -> list[Recipe]:
    return [
        Recipe(config, seed, checkpoint, list(_ranges(sorted(found))))
        for (seed, config, checkpoint), found in sorted(numbers.items())
    ]


def _ranges(numbers: Sequence[int]) -> Iterator[tuple[int, int]]:
    """First and last number of every unbroken range."""
    starts = [n for i, n in enumerate(numbers) if i == 0 or numbers[i - 1] != n - 1]
    ends = [n for i, n in enumerate(numbers) if i == len(numbers) - 1 or numbers[i + 1] != n + 1]
    return zip(starts, ends, strict=True)


def _versions(found: Iterable[str]) -> dict[str, list[str]]:
    """Versions by package, of records that are JSON.

    Raises:
        JengaError: a record is none.
    """
    versions: dict[str, set[str]] = {}
    for text in set(found):
        try:
            record = msgspec.json.decode(text, type=dict[str, str])
        except msgspec.DecodeError as error:
            raise JengaError(f"an episode's versions are no mapping of texts in JSON: {error}") from error
        for package, number in record.items():
            versions.setdefault(package, set()).add(number)
    return {package: sorted(numbers) for package, numbers in versions.items()}
