"""A command line that asks for what there is not: one line says what was found, what is allowed, what to run."""

import shlex

import pytest
from jenga_runs import jenga, run_apart

import cli
from jenga_data.collect.config import ExtractionConfig, recipe
from jenga_data.collect.workers import CollectSummary


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("stack",), "unknown verb 'stack'; allowed: demo, collect, convert"),
        (("collect", "stack"), "unknown verb 'stack' of jenga collect; allowed: selection, extraction"),
        (("train", "--preset", "fast"), "unknown verb '--preset' of jenga train; allowed: selection, dynamics"),
        (("log", "info", "a", "b"), "unrecognized options: b; see jenga log info --help"),
        (("log", "info"), "missing from jenga log info: PATH; see jenga log info --help"),
        (("convert",), "missing from jenga convert: --name STR --version STR --out PATH; see jenga convert --help"),
        (("demo", "--seed", "5.5"), "error parsing --seed: invalid literal for int() with base 10: '5.5'; see"),
        (("demo", "--seed"), "missing value for argument '--seed'. Expected 1 values; see jenga demo --help"),
        (("convert", "--name", "x", "--version", "0.1.0", "--out", "x"), "no folder of logs was given"),
        (("bench", "sim", "--towers", "0"), "towers is 0 and workers is 2; both must be at least 1"),
        (("bench", "sim", "--seed", "900000"), "seed is 900000; allowed: 0 to 899999"),
        (("bench", "log", "--towers", "0"), "towers is 0; allowed: 1 or more"),
        (("bench", "log", "--seed", "900000"), "seed is 900000; allowed: 0 to 899999"),
    ],
)
def test_wrong_usage(args, says):
    assert jenga(*args).line().startswith(f"jenga: {says}")


def test_an_unknown_option_is_named_with_what_was_meant():
    line = jenga("collect", "selection", "--episode", 3, "--episodes", 3, "--out", "x").line()
    assert "unrecognized options: --episode, 3; perhaps you meant: " in line
    assert "--episodes {None}|INT" in line
    both = jenga("collect", "selection", "--bogus").line()
    assert "missing from jenga collect selection: --out PATH; unrecognized options: --bogus" in both


def test_an_unknown_choice_is_told_the_allowed_ones():
    line = jenga("eval", "extraction", "--out", "x", "--objective", "greedy").line()
    assert all(name in line for name in ("'greedy'", "full", "naive", "straight-SPEED", "hindsight"))


def test_wrong_usage_is_one_line_in_a_terminal_of_colours(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "40")
    line = run_apart("eval", "extraction", "--out", "x", "--dynamics", "greedy").line()
    assert line.startswith("jenga: invalid choice 'greedy' for argument '--dynamics'. Expected one of ('learned',")


def test_an_extraction_has_one_body(tmp_path):
    both = ("--robot", "--gripper", "--episodes", 1, "--out", tmp_path / "out")
    line = jenga("collect", "extraction", *both).line()
    assert line == "jenga: --robot and --gripper exclude each other; allowed: one of them"
    assert not (tmp_path / "out").exists()
    other = jenga("collect", "extraction", "--body", "hand", *both[2:]).line()
    assert other.startswith("jenga: body is 'hand'; allowed: robot, gripper")


@pytest.mark.parametrize(
    ("options", "body"),
    [
        ((), "robot"),
        (("--robot",), "robot"),
        (("--body", "robot"), "robot"),
        (("--gripper",), "gripper"),
        (("--body", "gripper"), "gripper"),
        (("--body", "robot", "--gripper"), "gripper"),
    ],
)
def test_short_options_make_the_recipe_of_the_long_one(options, body, tmp_path, monkeypatch):
    recipes = []

    def collect(config, seed, numbers, workers, out, timeout) -> CollectSummary:
        recipes.append(recipe(config))
        return CollectSummary(len(numbers), {}, {}, 0, 0.0, str(out))

    monkeypatch.setattr("jenga_data.collect.workers.collect", collect)
    ran = jenga("collect", "extraction", *options, "--episodes", 1, "--out", tmp_path / "out")
    assert (ran.code, ran.err) == (0, "")
    assert recipes == [recipe(ExtractionConfig(body=body))]


@pytest.mark.parametrize("rounds", ["3-", "-3", "a", "1-2-3", "", "1.5", "²"])
def test_rounds_are_one_or_a_range(rounds, tmp_path):
    out = tmp_path / "out"
    line = jenga("collect", "selection", "--episodes", 1, "--out", out, f"--rounds={rounds}").line()
    assert f"--rounds is {rounds!r}; allowed: one round or a range, such as 7 or 1-15" in line
    assert not out.exists()


@pytest.mark.parametrize("rounds", ["0", "5-3", "1-16"])
def test_rounds_are_those_of_the_paper(rounds, tmp_path):
    out = tmp_path / "out"
    line = jenga("collect", "selection", "--episodes", 1, "--out", out, "--rounds", rounds).line()
    assert "allowed: first <= last, both from 1 to 15" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--seed", 900_000), "seed is 900000; allowed: 0 to 899999"),
        (("--seed", -1), "seed is -1; allowed: 0 to 899999"),
        (("--episodes", 0), "--episodes is 0; allowed: 1 and more"),
        (("--numbers", "1-3"), "which episodes? allowed: one of --episodes N, --numbers 5,7,10-20 and --of DATASET"),
        (("--of", "none@1.0.0"), "which episodes? allowed: one of"),
        (("--workers", 0), "both must be at least 1"),
        (("--speed", 0), "must be positive"),
        (("--physics.timestep-ns", 3), "allowed: a divisor of 4000000"),
    ],
)
def test_a_collection_that_is_none(options, says, tmp_path):
    out = tmp_path / "out"
    assert says in jenga("collect", "selection", "--episodes", 1, "--out", out, *options).line()
    assert not out.exists()


def test_what_a_demo_says_to_try_next_is_understood():
    """Three command lines, whatever its folder is called; nothing of them is run."""
    from jenga_control.demo import closing_words

    folder = "a folder & more"
    words = closing_words(
        {
            "out": folder,
            "seconds": 1.0,
            "index": f"{folder}/index.html",
            "episode": f"{folder}/a.mcap",
            "checkpoints": {"selection": f"{folder}/s", "dynamics": f"{folder}/d"},
            "datasets": {"selection": f"{folder}/data", "dynamics": f"{folder}/data"},
        }
    )
    lines = [shlex.split(line) for line in words.splitlines() if line.startswith("  jenga ")]
    assert len(lines) == 3
    for _, name, *args in lines:
        verb = cli.VERBS[name][1](args)
        verb, args = (verb[args[0]], args[1:]) if isinstance(verb, dict) else (verb, args)
        assert callable(cli._parse(verb, name, args))
