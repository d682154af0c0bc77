import errno
import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import pytest
from filelock import FileLock
from short_tower import EXTRACTION, SELECTION, run_short

from jenga_data.collect.config import Actor, CollectConfig, SelectionConfig, config_from_dict, episode_key
from jenga_data.collect.recording import Recorder
from jenga_data.collect.rollout import OpenLog
from jenga_data.collect.set_aside import FOLDER, GIVE_UP, SetAside
from jenga_data.collect.workers import RECIPE, CollectSummary, collect, run_episodes
from jenga_data.episode import EpisodeHeader, Result
from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import read_header
from jenga_data.pool import Failure, Lost

SEED = 3
QUICK: SelectionConfig = replace(SELECTION, pull_seconds=0.1)


def run(
    out: Path, episodes: int = 2, workers: int = 1, seed: int = SEED, config: CollectConfig = QUICK
) -> CollectSummary:
    return run_episodes(partial(run_short, config), config, seed, range(episodes), workers, out)


def logs(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.mcap")}


def refused(call: Callable[[], object]) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(JengaError) as error:
        call()
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes by one worker. Read only."""
    out = tmp_path_factory.mktemp("one worker") / "out"
    run(out)
    return out


@pytest.fixture
def folder(collected: Path, tmp_path: Path) -> Path:
    """A copy of the two episodes, to be changed."""
    out = tmp_path / "copy"
    out.mkdir()
    for path in collected.iterdir():
        if path.is_file() and path.name != ".lock":
            (out / path.name).write_bytes(path.read_bytes())
    return out


# --- what is collected ---------------------------------------------------------------------------------------------


def test_one_worker_and_two_write_the_same_bytes(collected, tmp_path):
    summary = run(tmp_path / "two", workers=2)
    assert logs(tmp_path / "two") == logs(collected)
    assert summary.episodes == 2
    assert (tmp_path / "two" / RECIPE).read_bytes() == (collected / RECIPE).read_bytes()


def test_episodes_are_named_by_their_keys_and_nothing_else_is_left(collected):
    expected = {f"{episode_key(QUICK, SEED, number)}.mcap" for number in range(2)}
    assert {path.name for path in collected.iterdir()} - {".lock"} == expected | {RECIPE}


def test_the_recipe_says_what_was_collected(collected):
    found = msgspec.json.decode((collected / RECIPE).read_bytes())
    assert config_from_dict(found["config"]) == QUICK
    assert (found["seed"], found["checkpoint"]) == (SEED, "")


def test_a_longer_run_begins_with_the_same_episodes(collected, tmp_path):
    run(tmp_path / "one", episodes=1)
    assert logs(tmp_path / "one").items() <= logs(collected).items()


def test_chosen_numbers_are_episodes_of_the_whole_collection(collected, tmp_path):
    summary = run_episodes(partial(run_short, QUICK), QUICK, SEED, [1], 1, tmp_path / "one")
    key = episode_key(QUICK, SEED, 1)
    assert logs(tmp_path / "one") == {f"{key}.mcap": logs(collected)[f"{key}.mcap"]}
    assert (summary.episodes, summary.resumed) == (1, 0)


def test_a_summary_counts_outcomes_and_causes(tmp_path):
    config = replace(EXTRACTION, gripper=replace(EXTRACTION.gripper, grip_force=0.01))
    summary = run(tmp_path / "out", episodes=1, config=config)
    results = [read_header(path)[1] for path in (tmp_path / "out").glob("*.mcap")]
    assert sum(summary.outcomes.values()) == summary.episodes == 1
    assert list(summary.outcomes) == ["invalid", "collapsed", "extracted", "stuck"]
    for name, count in summary.outcomes.items():
        assert count == sum(r is not None and r.verdict.outcome == name for r in results)
    assert summary.causes == {"grasp_missed": 1}
    assert summary.resumed == 0
    assert summary.out == str(tmp_path / "out")


# --- going on ------------------------------------------------------------------------------------------------------


def test_resuming_keeps_what_is_there_and_makes_what_is_missing(folder, collected):
    kept, lost = (folder / f"{episode_key(QUICK, SEED, number)}.mcap" for number in range(2))
    lost.unlink()
    os.utime(kept, ns=(1, 1))
    summary = run(folder)
    assert kept.stat().st_mtime_ns == 1
    assert logs(folder) == logs(collected)
    assert (summary.episodes, summary.resumed) == (2, 1)
    assert sum(summary.outcomes.values()) == 2


def test_a_finished_run_simulates_nothing(folder):
    def never(seed: int, number: int, open_log: OpenLog) -> Result:
        raise AssertionError("there was nothing to do")

    summary = run_episodes(never, QUICK, SEED, range(2), 1, folder)
    assert (summary.episodes, summary.resumed) == (2, 2)


def test_a_log_that_was_cut_off_is_written_anew(folder, collected):
    path = next(folder.glob("*.mcap"))
    whole = path.read_bytes()
    path.unlink()
    path.with_name(path.name + ".partial").write_bytes(whole[: len(whole) // 2])
    assert run(folder).resumed == 1
    assert logs(folder) == logs(collected)
    assert not list(folder.glob("*.partial"))


def interrupted_at_1(seed: int, number: int, open_log: OpenLog) -> Result:
    if number == 1:
        raise KeyboardInterrupt
    return run_short(QUICK, seed, number, open_log)


def test_an_interrupt_leaves_what_was_finished(tmp_path, collected):
    with pytest.raises(KeyboardInterrupt):
        run_episodes(interrupted_at_1, QUICK, SEED, range(2), 1, tmp_path / "out")
    assert len(logs(tmp_path / "out")) == 1
    assert run(tmp_path / "out").resumed == 1
    assert logs(tmp_path / "out") == logs(collected)


# --- a folder that is not for this collection ----------------------------------------------------------------------


def test_another_configuration_or_seed_is_refused(folder):
    before = logs(folder)
    for other in (
        lambda: run(folder, seed=SEED + 1),
        lambda: run(folder, config=replace(QUICK, speed=0.2)),
        lambda: run_episodes(partial(run_short, QUICK), QUICK, SEED, range(2), 1, folder, Actor({"horizon": 5}, "abc")),
    ):
        assert refused(other) == (
            f"{folder} holds episodes of another configuration or seed (see {RECIPE}); choose another --out"
        )
    assert logs(folder) == before


def test_a_folder_with_other_things_in_it_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("my work")
    message = refused(lambda: run(tmp_path))
    assert message == f"{tmp_path} exists and is no collection (it holds thesis.tex); choose another --out"
    assert {p.name for p in tmp_path.iterdir()} - {".lock"} == {"thesis.tex"}


def test_a_folder_in_which_the_recipe_was_being_written_when_the_run_was_stopped_can_be_gone_on_with(tmp_path):
    (tmp_path / "collection.json.partial").write_bytes(b'{"conf')
    run(tmp_path)
    assert (tmp_path / RECIPE).exists()
    assert not (tmp_path / "collection.json.partial").exists()


@pytest.mark.parametrize(
    "content", [b"{", b"[]", b"{}", b'{"config": 3}', b'{"config": {"kind": "selection", "x": 1}}']
)
def test_a_recipe_that_is_none_is_refused(folder, content):
    (folder / RECIPE).write_bytes(content)
    assert str(folder) in refused(lambda: run(folder))
    assert (folder / RECIPE).read_bytes() == content


def test_two_collectors_do_not_share_a_folder(folder):
    with FileLock(folder / ".lock"):
        message = refused(lambda: run(folder))
    assert message == f"another process collects into {folder}; wait for it or choose another --out"
    assert run(folder).resumed == 2


@pytest.mark.parametrize("name", ["file", "file/below"])
def test_a_place_that_cannot_be_a_folder_is_refused(tmp_path, name):
    """Stands in for a folder without permission, which does not stop root."""
    (tmp_path / "file").write_text("")
    message = refused(lambda: run(tmp_path / name))
    assert message.startswith(f"cannot write to {tmp_path / name}: ")


def full_disk(seed: int, number: int, open_log: OpenLog) -> Result:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_told_in_one_line(tmp_path):
    message = refused(lambda: run_episodes(full_disk, QUICK, SEED, range(2), 1, tmp_path / "out"))
    assert message == f"cannot write to {tmp_path / 'out'}: the disk is full; finished episodes are kept"


# --- wishes that cannot be granted ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [-1, 900_000, 900_001])
def test_seeds_of_evaluations_are_refused(tmp_path, seed):
    message = refused(lambda: collect(QUICK, seed, range(1), 1, tmp_path / "out"))
    assert message == f"seed is {seed}; allowed: 0 to 899999 (higher ones are reserved for evaluation)"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("episodes", "workers"), [(0, 1), (1, 0)])
def test_no_episodes_or_no_workers_are_refused(tmp_path, episodes, workers):
    message = refused(lambda: collect(QUICK, 0, range(episodes), workers, tmp_path / "out"))
    assert message == f"episodes is {episodes} and workers is {workers}; both must be at least 1"
    assert not (tmp_path / "out").exists()


# --- workers that fail ---------------------------------------------------------------------------------------------


FAILURES = {
    "died": "its worker process died (SIGKILL: out of memory, or killed)",
    "bug": "ZeroDivisionError: by nothing",
}


def fails_at_1(how: str, seed: int, number: int, open_log: OpenLog) -> Result:
    """A short rollout, but in the middle of the log of number 1 something happens."""

    def open_and_fail(header: EpisodeHeader, scene_xml: str) -> AbstractContextManager[Recorder]:
        log = open_log(header, scene_xml)
        if number == 1 and how == "bug":
            with log:
                raise ZeroDivisionError("by nothing")
        if number == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return log

    return run_short(QUICK, seed, number, open_and_fail)


def no_tower(seed: int, number: int, open_log: OpenLog) -> Result:
    raise JengaError(f"number {number}: no tower stood")


@pytest.mark.parametrize("how", FAILURES)
def test_an_episode_that_cannot_be_made_is_set_aside_and_the_others_are_made(tmp_path, collected, how):
    out = tmp_path / "out"
    key = episode_key(QUICK, SEED, 1)
    summary = run_episodes(partial(fails_at_1, how), QUICK, SEED, range(3), 2, out)
    (found,) = summary.set_aside
    assert (found.number, found.seed, found.episode, found.reason) == (1, SEED, key, FAILURES[how])
    assert [failure.reason for failure in found.tries] == ([] if how == "bug" else [FAILURES[how]] * 2)
    assert ("ZeroDivisionError: by nothing" in found.traceback) == (how == "bug")
    assert ("open_and_fail" in found.traceback) == (how == "bug")
    assert (summary.episodes, sum(summary.outcomes.values())) == (2, 2)
    assert found.file == str(out / FOLDER / f"{key}.json")
    assert msgspec.json.decode(Path(found.file).read_bytes(), type=SetAside) == found

    made = logs(out)
    assert len(made) == 2
    assert f"{key}.mcap" not in made
    assert logs(collected).items() - made.items() == {(f"{key}.mcap", logs(collected)[f"{key}.mcap"])}
    assert not list(out.glob("*.partial"))  # which would keep `jenga convert` from the others
    assert (out / FOLDER / f"{key}.partial").exists()

    again = run(out, episodes=3)
    assert (again.episodes, again.resumed, again.set_aside) == (3, 2, ())
    assert logs(out).items() >= logs(collected).items()
    assert not (out / FOLDER).exists()


def test_an_episode_that_hangs_is_set_aside(tmp_path, collected, monkeypatch):
    """As the pool tells of it; tests/core/test_pool.py has a process that hangs."""

    def one_hangs(work, items, workers, timeout):
        failure = Failure(f"no end after {timeout:g} s", timeout)
        yield from ((n, work(n) if n == 0 else Lost((failure, failure))) for n in items)

    monkeypatch.setattr("jenga_data.collect.workers.run_all", one_hangs)
    out = tmp_path / "out"
    summary = run_episodes(partial(run_short, QUICK), QUICK, SEED, range(2), 2, out, timeout=60.0)
    assert [(found.number, found.reason, len(found.tries)) for found in summary.set_aside] == [
        (1, "no end after 60 s", 2)
    ]
    assert logs(out).items() < logs(collected).items()


def test_a_bug_is_set_aside_by_a_single_worker_too(tmp_path):
    summary = run_episodes(partial(fails_at_1, "bug"), QUICK, SEED, range(2), 1, tmp_path / "out")
    assert [found.reason for found in summary.set_aside] == [FAILURES["bug"]]


def always_a_bug(seed: int, number: int, open_log: OpenLog) -> Result:
    raise ZeroDivisionError("by nothing")


def test_a_run_in_which_everything_fails_is_ended(tmp_path):
    with pytest.raises(CheckFailed) as error:
        run_episodes(always_a_bug, QUICK, SEED, range(1000), 1, tmp_path / "out")
    assert str(error.value) == (
        f"stopped after {GIVE_UP} failures in a row: {GIVE_UP} of the episodes set aside in "
        f"{tmp_path / 'out' / FOLDER}: "
        f"number 0 (ZeroDivisionError: by nothing) and {GIVE_UP - 1} more; the same command tries them again"
    )
    assert len(list((tmp_path / "out" / FOLDER).glob("*.json"))) == GIVE_UP


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan")])
def test_no_time_for_an_episode_is_refused(tmp_path, timeout):
    message = refused(lambda: collect(QUICK, SEED, range(1), 1, tmp_path / "out", timeout))
    assert message == f"the time for one episode is {timeout:g} s; allowed: more than 0, such as 600"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_worker_refuses_is_refused(tmp_path, workers):
    message = refused(lambda: run_episodes(no_tower, QUICK, SEED, range(2), workers, tmp_path / "out"))
    assert message.endswith("no tower stood")
