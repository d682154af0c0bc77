"""Making episodes again from (config, seed, number). The simulator is imported only here, and only when it runs."""

import hashlib
from collections.abc import Sequence
from functools import cache, partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

from jenga_data.dataset.episode_origin import Origin, config_of
from jenga_data.dataset.manifest import Manifest


def make_again(manifest: Manifest, origins: Sequence[Origin], workers: int, out: Path) -> dict[Origin, Path]:
    """Simulate episodes and log them, each recipe in a folder of its own below `out`. Returns their logs.

    Those that the same code has logged there are kept, so a run that was stopped is gone on with.

    Raises:
        JengaError: one cannot be made again or had to be set aside, or `out` cannot be written.
    """
    from jenga_data.collect.config import episode_key
    from jenga_data.collect.set_aside import refuse_missing
    from jenga_data.collect.workers import run_episodes, run_one

    logs: dict[Origin, Path] = {}
    for (name, seed), group in groupby(sorted(origins), lambda origin: (origin.config, origin.seed)):
        members = list(group)
        configs = [config_of(manifest, origin) for origin in members]
        config, numbers = configs[0], [origin.number for origin in members]
        folder = out / f"{name}-s{seed}-{code_hash()[:8]}"
        rollout = partial(run_one, config)
        done = run_episodes(rollout, config, seed, numbers, workers, folder, label="making episodes again")
        refuse_missing(folder, done.set_aside)
        logs |= {o: folder / f"{episode_key(config, seed, o.number)}.mcap" for o in members}
    return logs


@cache
def code_hash() -> str:
    """Names the code that simulates, edits that nobody committed included: logs of other code must not be taken for
    its own."""
    package = Path(__file__).parents[1]
    parts = [f"{name} {version(name)}" for name in ("mujoco", "numpy", "scipy")]
    for path in sorted(package.rglob("*.py")):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        parts.append(f"{path.relative_to(package).as_posix()} {digest}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
