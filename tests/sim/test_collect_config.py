from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import msgspec
import numpy as np
import pytest

from jenga_data.collect.config import (
    NOBODY,
    Actor,
    CollectConfig,
    ExtractionConfig,
    RobotConfig,
    SelectionConfig,
    SpawnConfig,
    config_dict,
    config_from_dict,
    episode_key,
    recipe,
)
from jenga_data.collect.draws import episode_rng
from jenga_data.errors import JengaError
from jenga_data.sim.physics import GripperConfig, PhysicsConfig

CONFIGS: list[CollectConfig] = [SelectionConfig(), ExtractionConfig()]

OTHER: dict[str, Any] = {
    "timestep_ns": 1_000_000,
    "integrator": "discrete",
    "pull": 1,
    "distribution": "nominal",
    "first_round": 2,
    "last_round": 14,
    "impedance": 0.99,
    "wedge": True,
    "sticks_out": 0.015,
    "body": "gripper",
}
"""Another allowed value where a number cannot simply be made a little smaller."""


def other(name: str, value: Any) -> Any:
    if name in OTHER:
        return OTHER[name]
    if isinstance(value, tuple):
        return (value[0] * 0.9, *value[1:])
    return value - 1 if isinstance(value, int) else value * 0.9


def neighbours(config: Any) -> Iterator[tuple[str, Any]]:
    """The configuration with one field changed, for each field at any depth."""
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            for path, changed in neighbours(value):
                yield f"{field.name}.{path}", replace(config, **{field.name: changed})
        else:
            yield field.name, replace(config, **{field.name: other(field.name, value)})


# --- to plain values and back --------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", CONFIGS, ids=["selection", "extraction"])
def test_a_configuration_comes_back_from_its_plain_values(config):
    for _, changed in [("", config), *neighbours(config)]:
        assert config_from_dict(config_dict(changed)) == changed
        assert config_from_dict(msgspec.json.decode(msgspec.json.encode(config_dict(changed)))) == changed
        assert config_from_dict(recipe(changed, Actor({"horizon": 5}, "abc"))) == changed


def test_plain_values_say_which_kind_they_are():
    assert [config_dict(config)["kind"] for config in CONFIGS] == ["selection", "extraction"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "chess"}, "unknown kind of collection 'chess'; allowed: selection, extraction"),
        ({"kind": None}, "unknown kind of collection None"),
        ({"kind": ["selection"]}, "unknown kind of collection"),
        ({"sped": 1.0}, r"fields that this jenga does not know: sped$"),
        ({"physics": {"frction": 0.1}, "colour": "red"}, r"does not know: colour, physics\.frction$"),
        ({"speed": "fast"}, r"cannot be read: Expected `float`, got `str` - at `\$\.speed`"),
        ({"physics": 3}, r"cannot be read: Expected `object`"),
        ({"speed": -1.0}, "must be positive"),
    ],
)
def test_values_that_are_no_configuration_are_refused(change, message):
    with pytest.raises(JengaError, match=message) as refused:
        config_from_dict(config_dict(SelectionConfig()) | change)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SpawnConfig(first_round=0), "rounds 0-15; allowed: first <= last, both from 1 to 15"),
        (lambda: SpawnConfig(last_round=16), "rounds 1-16"),
        (lambda: SpawnConfig(first_round=9, last_round=8), "rounds 9-8"),
        (lambda: SelectionConfig(force_limit=0), "must be positive"),
        (lambda: SelectionConfig(pull_seconds=0), "must be positive"),
        (lambda: ExtractionConfig(slowest=0), "slowest 0, fastest 0.017; allowed: 0 < slowest <= fastest <= 0.02"),
        (lambda: ExtractionConfig(fastest=0.021), "fastest 0.021"),
        (lambda: ExtractionConfig(slowest=0.01, fastest=0.009), "slowest 0.01, fastest 0.009"),
        (lambda: ExtractionConfig(body="hand"), "body is 'hand'; allowed: robot, gripper"),
        (lambda: RobotConfig(push_speed=0), "speeds, acceleration and push-force must be positive"),
        (lambda: RobotConfig(push_force=-1), "push-force must be positive"),
        (lambda: RobotConfig(push_distance=0.04), "push-distance 0.04, push-tolerance 0.003; allowed: 0 < "),
        (lambda: RobotConfig(push_tolerance=0.02), "push-tolerance 0.02; allowed: .* push-distance <= 0.03"),
    ],
)
def test_configurations_that_cannot_be_are_refused(make, message):
    with pytest.raises(JengaError, match=message):
        make()


# --- the key of an episode -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", CONFIGS, ids=["selection", "extraction"])
def test_any_field_makes_another_episode(config):
    keys = {path: episode_key(changed, 1, 2) for path, changed in [("", config), *neighbours(config)]}
    assert len(keys) > 25
    assert len(set(keys.values())) == len(keys)


def test_seed_number_kind_and_actor_make_another_episode():
    selection, extraction = CONFIGS
    keys = [
        episode_key(selection, 1, 2),
        episode_key(selection, 2, 1),
        episode_key(selection, 1, 3),
        episode_key(selection, 12, 2),
        episode_key(extraction, 1, 2),
        episode_key(selection, 1, 2, Actor({"horizon": 5})),
        episode_key(selection, 1, 2, Actor({"horizon": 6})),
        episode_key(selection, 1, 2, Actor({"horizon": 5}, "abc")),
    ]
    assert len(set(keys)) == len(keys)


def test_equal_configurations_make_the_same_episode():
    assert episode_key(SelectionConfig(), 1, 2) == episode_key(
        SelectionConfig(spawn=SpawnConfig(), physics=PhysicsConfig()), 1, 2, NOBODY
    )
    assert episode_key(ExtractionConfig(), 1, 2) == episode_key(ExtractionConfig(gripper=GripperConfig()), 1, 2)


def test_a_key_is_a_file_name():
    key = episode_key(SelectionConfig(), 1, 2)
    assert len(key) == 20
    assert set(key) <= set("0123456789abcdef")


# --- random numbers ------------------------------------------------------------------------------------------------


def test_draws_of_one_stream_do_not_depend_on_another():
    alone = episode_rng(1, 2, "tower").normal(size=5)
    first, second = episode_rng(1, 2, "target"), episode_rng(1, 2, "tower")
    first.normal(size=1000)
    np.testing.assert_array_equal(second.normal(size=5), alone)


def test_each_episode_and_stream_has_draws_of_its_own():
    streams = [(1, 2, "tower"), (2, 1, "tower"), (1, 3, "tower"), (1, 2, "target"), (1, 2, "towe"), (12, 2, "tower")]
    first = {episode_rng(*stream).random() for stream in streams}
    assert len(first) == len(streams)
