"""The layout in docs/ shows what is in a log: every topic and every field that it names is there."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pool
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.records import Schema
from synthetic_log import make_script, with_robot, write

LAYOUT = json.loads((Path(__file__).parents[2] / "docs" / "foxglove-layout.json").read_text())
PATH = re.compile(r"(?P<topic>/[a-z_/]+)(?P<fields>(\.\w+|\[[^\]]*\]|\{[^}]*\})*)")


def strings(value: Any) -> Iterator[str]:
    """Every string in the layout, keys included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, below in value.items():
            yield key
            yield from strings(below)
    elif isinstance(value, list):
        for below in value:
            yield from strings(below)


MESSAGE_PATHS = sorted({text for text in strings(LAYOUT) if text.startswith("/")})


@pytest.fixture(scope="module")
def schemas(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Schema]:
    """By topic, of a log with a gripper alone and of one with a robot."""
    folder = tmp_path_factory.mktemp("logs")
    found: dict[str, Schema] = {}
    for name, script in (("gripper", make_script()), ("robot", with_robot(make_script()))):
        with write(folder / f"{name}.mcap", script).open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        found |= {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    return found


def test_the_layout_shows_the_tower_its_forces_and_its_phases():
    topics = {match["topic"] for text in MESSAGE_PATHS if (match := PATH.fullmatch(text))}
    assert topics >= {"/tf", "/robot_description", "/gripper", "/action", "/phase", "/outcome", "/log"}


@pytest.mark.parametrize("text", MESSAGE_PATHS)
def test_what_the_layout_names_is_in_a_log(schemas, text):
    match = PATH.fullmatch(text)
    assert match, f"{text} is no message path"
    schema = schemas[match["topic"]]
    fields = re.findall(r"\.(\w+)", re.sub(r"\{[^}]*\}", "", match["fields"]))
    conditions = re.findall(r"\{(\w+)==", match["fields"])
    if schema.encoding != "protobuf":
        assert not fields
        return
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    message = pool.FindMessageTypeByName(schema.name)
    for name in fields:
        field = message.fields_by_name[name]
        message = field.message_type or message
        assert all(condition in message.fields_by_name for condition in conditions if field.is_repeated)


def test_every_panel_has_its_place_and_every_place_its_panel():
    def panels(place: str | dict[str, Any]) -> list[str]:
        return [place] if isinstance(place, str) else panels(place["first"]) + panels(place["second"])

    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_variables_that_paths_use_have_a_value(schemas):
    used = {name for text in MESSAGE_PATHS for name in re.findall(r"\$(\w+)", text)}
    assert used == LAYOUT["globalVariables"].keys() == {"target"}
