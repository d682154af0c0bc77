"""Logs that were spoiled in every way: one line each, in bounded time and memory. $JENGA_FUZZ_INPUTS sets how many."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mutations import ABSURD, edits, fuzz, peak_mib, refused, spoiled
from synthetic_log import make_script, write

from jenga_data.log import profile
from jenga_data.log.output import Output
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.records import Damage, open_log, walk
from jenga_data.log.recover import recover
from jenga_data.log.report import doctor, inspect


@pytest.fixture(scope="module", autouse=True)
def as_in_production() -> Iterator[None]:
    """Shapes unchecked, and little memory used in all."""
    jaxtyping.config.update("jaxtyping_disable", True)
    before = peak_mib()
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
    assert peak_mib() - before < 700


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("spoiled")


class Whole(list[bytes]):
    """Logs that hypothesis prints in few words: it warns of long ones, and hides with that what it found."""

    def __repr__(self) -> str:
        return f"{len(self)} logs"


@pytest.fixture(scope="module")
def logs(folder: Path) -> Whole:
    """Whole logs of an extraction, with and without a gripper."""
    scripts = [make_script(frames=3, state=5), make_script(frames=2, state=2, gripper=False)]
    return Whole(write(folder / f"whole{i}.mcap", script).read_bytes() for i, script in enumerate(scripts))


def read_all(path: Path) -> list[str]:
    """What each reader says against a file."""
    out = path.with_name("saved.mcap")
    out.unlink(missing_ok=True)
    readers: list[Callable[[], object]] = [
        lambda: read_episode(path),
        lambda: read_header(path),
        lambda: inspect(path),
        lambda: doctor(path),
        lambda: recover(path, out),
    ]
    said = [refused(read) for read in readers]
    if out.exists():
        assert not refused(lambda: inspect(out)), "what recover saves can be read"
    assert {p.name for p in path.parent.iterdir()} <= {path.name, out.name, "whole0.mcap", "whole1.mcap"}
    return said


@fuzz(0.45)
@given(which=st.integers(0, 1), how=edits())
def test_spoiled_bytes(folder, logs, which, how):
    path = folder / "spoiled.mcap"
    bad = spoiled(logs[which], how)
    path.write_bytes(bad)
    episode, *_ = read_all(path)
    assert episode or bad == logs[which], "every byte stands under some checksum"


@fuzz(0.05)
@given(garbage=st.binary(max_size=300), start=st.integers(0, 9))
def test_garbage_behind_a_magic(folder, garbage, start):
    path = folder / "spoiled.mcap"
    path.write_bytes(b"\x89MCAP0\r\n"[:start] + garbage)
    assert all(said for said in read_all(path)[:1])


# --- forged: whole files with right checksums that say absurd things -----------------------------------------------

_VALUES = st.one_of(
    st.text(max_size=30), st.sampled_from([str(n) for n in ABSURD] + ["-1", "1e9", "../../x", "/etc/x", "9" * 5000])
)
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


def records_of(path: Path) -> list[McapRecord]:
    with open_log(path) as stream:
        return [record for record in walk(stream) if not isinstance(record, Damage)]


def forge(
    path: Path,
    records: list[McapRecord],
    message: Callable[[int, str, bytes], bytes] = lambda i, topic, data: data,
    time: Callable[[int, int], int] = lambda i, time: time,
    metadata: dict[str, str] | None = None,
    config: bytes | None = None,
) -> None:
    """Write the records anew, messages, metadata and config.json changed, every checksum right."""
    path.unlink(missing_ok=True)
    out = Output(path, profile.PROFILE)
    channels = {record.id: record for record in records if isinstance(record, Channel)}
    schemas = {record.id: record for record in records if isinstance(record, Schema)}
    numbers = {i: out.channel(channel, schemas.get(channel.schema_id)) for i, channel in channels.items()}
    for i, record in enumerate(records):
        match record:
            case Metadata():
                changed = metadata if record.name == profile.EPISODE_METADATA and metadata else {}
                out.metadata(record.name, record.metadata | changed)
            case Attachment():
                data = config if record.name == profile.CONFIG and config is not None else record.data
                out.attachment(record.name, record.media_type, data)
            case Message():
                topic = channels[record.channel_id].topic
                out.raw(numbers[record.channel_id], message(i, topic, record.data), time(i, record.log_time))
    out.commit()


@fuzz(0.2)
@given(which=st.integers(0, 1), how=edits(2), every=st.integers(1, 9), late=st.sampled_from((0, *ABSURD)))
def test_forged_messages(folder, logs, which, how, every, late):
    records = records_of(folder / f"whole{which}.mcap")
    path = folder / "spoiled.mcap"
    forge(
        path,
        records,
        lambda i, topic, data: spoiled(data, how) if i % every == 0 else data,
        lambda i, time: late if late and i % every == 0 else time,
    )
    read_all(path)


@fuzz(0.1)
@given(
    name=st.sampled_from(
        ["key", "kind", "seed", "number", "version", "control_step_ns", "round", "tower", "checkpoint"]
    ),
    value=_VALUES,
    config=st.one_of(_JSON.map(lambda value: json.dumps(value).encode()), st.binary(max_size=50)),
)
def test_forged_metadata_and_config(folder, logs, name, value, config):
    path = folder / "spoiled.mcap"
    forge(path, records_of(folder / "whole0.mcap"), metadata={name: value}, config=config)
    read_all(path)
    said = refused(lambda: read_header(path))
    if not said:
        key = read_header(path)[0].key
        assert (path.parent / f"{key}.rrd").parent == path.parent, "a key names no place elsewhere"
