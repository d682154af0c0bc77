"""`jenga calibrate`, from made-up results: the keys that scripts rely on, numbers, files, and what is refused."""

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from made_up import BLOCKS, replace_cases

import cli
from jenga_data.calibrate.ceiling import ceiling_report
from jenga_data.calibrate.contacts import SETTINGS
from jenga_data.calibrate.run import Run, quantiles
from jenga_data.collect.config import SelectionConfig

VERBS = ("movable", "contacts", "ceiling", "speed", "rounds", "turntable", "sleep")


@pytest.fixture(autouse=True)
def _made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    replace_cases(monkeypatch)


@pytest.fixture
def jenga(tmp_path, monkeypatch, capsys):
    """Runs `jenga calibrate VERB ... --workers 1` into a folder; gives exit code, stdout and stderr."""

    def run(*args: object) -> tuple[int, str, str]:
        into = () if "--help" in args else ("--workers", "1", "--out", tmp_path / "out")
        monkeypatch.setattr(sys, "argv", ["jenga", "calibrate", *map(str, (*args, *into))])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return int(stop.value.code or 0), *capsys.readouterr()

    return run


@pytest.fixture
def said(jenga):
    """The object that a verb prints with --json."""

    def run(*args: object) -> dict[str, Any]:
        code, out, err = jenga(*args, "--json")
        assert (code, err) == (0, "")
        assert out.count("\n") == 1
        return json.loads(out)

    return run


@pytest.fixture
def refused(jenga, tmp_path):
    """The one line with which a verb refuses, before it makes a folder."""

    def run(*args: object) -> str:
        code, out, err = jenga(*args)
        assert (code, out) == (2, "")
        assert err.startswith("jenga: ")
        assert err.count("\n") == 1
        assert not (tmp_path / "out").exists()
        return err

    return run


def share(hits: int, n: int) -> dict[str, Any]:
    """A proportion as it must stand in JSON, with Wilson's interval from its formula."""
    z, p = 1.959963984540054, hits / n
    middle, half = p + z * z / (2 * n), z * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    ends = [(middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)]
    return {"rate": pytest.approx(p), "n": n, "ci95": pytest.approx(ends, abs=1e-9)}


def proportion(found: dict[str, Any]) -> dict[str, Any]:
    """Without what is said of the towers."""
    return {name: found[name] for name in ("rate", "n", "ci95")}


def rows_of(markdown: str) -> dict[str, list[str]]:
    """The rows of every table, by their first cell; of two such rows the first."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.splitlines() if "|" in line]
    return {row[0]: row[1:] for row in reversed(cells)}


# --- every verb ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", VERBS)
def test_help_names_the_verb_and_explains_every_option(jenga, verb):
    code, out, err = jenga(verb, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"usage: jenga calibrate {verb} ")
    for option in ("--towers", "--seed", "--workers", "--out", "--json"):
        assert option in out


@pytest.mark.parametrize("verb", VERBS)
def test_json_markdown_and_a_picture_are_written(said, verb, tmp_path):
    printed = said(verb, "--towers", 2)
    files = [tmp_path / "out" / f"{verb}.{ending}" for ending in ("json", "md", "png")]
    assert printed.pop("written") == [str(file) for file in files]
    assert json.loads(files[0].read_text()) == printed
    assert printed["towers"] == 2
    assert printed["seed"] == 800_000
    assert files[1].read_text().endswith(f"\n![{verb}]({verb}.png)\n")
    picture = np.array(matplotlib.image.imread(files[2]))[..., :3]
    inked = np.asarray((picture < 0.9).any(axis=2))
    assert inked.shape[1] > 900
    halves = (inked[:, : inked.shape[1] // 2], inked[:, inked.shape[1] // 2 :])
    assert 0.005 < inked.mean() < 0.6
    assert all(half.any() for half in halves)


@pytest.mark.parametrize("verb", VERBS)
def test_people_read_the_tables_and_the_same_command_goes_on(jenga, said, verb, tmp_path):
    code, out, err = jenga(verb, "--towers", 2)
    assert (code, err) == (0, "")
    report = (tmp_path / "out" / f"{verb}.md").read_text()
    tables = report.removesuffix(f"\n![{verb}]({verb}.png)\n")
    written = [str(tmp_path / "out" / f"{verb}.{ending}") for ending in ("json", "md", "png")]
    assert out == f"{tables}\nwritten: {', '.join(written)}\n"
    assert "nan" not in out
    kept = (tmp_path / "out" / f"{verb}.jsonl").read_bytes()
    assert said(verb, "--towers", 2).pop("written") == written
    assert (tmp_path / "out" / f"{verb}.jsonl").read_bytes() == kept
    assert (tmp_path / "out" / f"{verb}.md").read_text() == report


@pytest.mark.parametrize("verb", VERBS)
def test_no_towers_seeds_or_workers_that_are_none_are_refused(refused, verb):
    for towers in (0, -3):
        assert f"towers is {towers}; allowed: 1 or more" in refused(verb, "--towers", towers)
    for seed in (-1, 900_000):
        assert f"seed is {seed}; allowed: 0 to 899999" in refused(verb, "--seed", seed)


@pytest.mark.parametrize("verb", VERBS)
def test_no_workers_are_refused(tmp_path, monkeypatch, capsys, verb):
    monkeypatch.setattr(sys, "argv", ["jenga", "calibrate", verb, "--workers", "0", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert (stop.value.code, capsys.readouterr().err) == (2, "jenga: workers is 0; allowed: 1 or more\n")


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (("movable", "--force-limit", -1), "force-limit is -1.0; allowed: a positive number [N]"),
        (("movable", "--force-limit", "nan"), "force-limit is nan; allowed: a positive number [N]"),
        (("movable", "--friction", 0), "physics.friction and physics.impratio must be positive"),
        (("movable", "--friction", "nan"), "physics.friction and physics.impratio must be positive"),
        (("contacts", "--settings", "soft"), f"unknown setting 'soft'; allowed: {', '.join(SETTINGS)}"),
        (("contacts", "--few", 0), "few is 0; allowed: 1 or more"),
        (("ceiling", "--targets", 0), "targets is 0, repeats is 10, repeated is 100; allowed: 1 or more, 2 or more"),
        (("ceiling", "--repeats", 1), "targets is 3, repeats is 1, repeated is 100; allowed: 1 or more, 2 or more"),
        (("ceiling", "--repeated", -1), "repeated is -1; allowed: 1 or more, 2 or more, 0 or more"),
        (("speed", "--speeds", 0.1, -0.2), "speeds are 0.1, -0.2; allowed: one or more, all positive [m/s]"),
        (("speed", "--speeds", "nan"), "speeds are nan; allowed: one or more, all positive [m/s]"),
        (("speed", "--speeds", "inf"), "speeds are inf; allowed: one or more, all positive [m/s]"),
        (("turntable", "--round", 0), "rounds 0-0; allowed: first <= last, both from 1 to 15"),
        (("turntable", "--round", 16), "rounds 16-16; allowed: first <= last, both from 1 to 15"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(refused, args, line):
    assert line in refused(*args)


# --- the numbers ---------------------------------------------------------------------------------------------------


def test_movable(said, tmp_path):
    found = said("movable", "--towers", 4, "--force-limit", 2.0, "--friction", 0.3)
    assert proportion(found["movable"]) == share(8, 4 * BLOCKS)
    assert proportion(found["middle"]) == share(8, 8)
    assert proportion(found["side"]) == share(0, 16)
    assert found["never_broke_away"] == share(12, 24)
    assert found["movable"]["towers"] == 4
    assert (found["force_limit_n"], found["friction"]) == (2.0, 0.3)
    assert found["ends"] == {"dragged": 4, "movable": 8, "stuck": 12}
    force = found["breakaway_n"]
    assert (force["smallest"], force["median"], force["largest"]) == pytest.approx((0.2, 0.4, 0.6))
    rows = rows_of((tmp_path / "out" / "movable.md").read_text())
    assert rows["movable"] == ["0.33 [0.18, 0.53] (n = 24)", "0.47"]
    assert rows["stuck"] == ["12"]
    assert {"middle", "side", "dragged", "stuck", *force} <= rows.keys()


def test_contacts(said, tmp_path):
    found = said("contacts", "--towers", 5, "--few", 3, "--settings", *SETTINGS)
    assert found["fallen"] == share(0, 5)
    assert found["drift_mm_per_s"] == pytest.approx({"median": 0.03, "worst": 0.05})
    assert found["sag_mm"] == 0.05
    assert found["realtime_factor"] == 4.0
    assert list(found["settings"]) == list(SETTINGS) == list(found["physics"])
    for name, setting in found["settings"].items():
        loose = SETTINGS[name].impratio == 1.0
        rested = 5 if name == "chosen" else 3
        assert setting["fallen"] == share(rested if loose else 0, rested)
        assert setting["played_stand"] == share(3 if loose else 6, 6)
        assert setting["played_quick_and_full_agree"] == share(6, 6)
        assert proportion(setting["failure"]) == share(3 if loose else 0, 3 if loose else 6)
        assert setting["same_label"] == share(0, 3) if loose else share(6, 6)
        assert setting["failure_minus_chosen"].startswith("1.00" if loose else "0.00")
        assert setting["pull_seconds"] == 0.25
        assert (setting["realtime_factor"] is None) == loose
        assert (setting["drift_mm_per_s"]["median"] is None) == loose
    rows = rows_of((tmp_path / "out" / "contacts.md").read_text())
    assert set(SETTINGS) <= rows.keys()


def test_contacts_under_which_nothing_stands(said, monkeypatch):
    fallen = {"fell": True, "drift": None, "realtime_factor": None}
    monkeypatch.setattr("jenga_data.calibrate.contacts.rest", lambda physics, seed, number: fallen)
    monkeypatch.setattr("jenga_data.calibrate.contacts.pulls", lambda config, seed, number, repeats: {"stood": False})
    found = said("contacts", "--towers", 2, "--settings", "chosen")
    assert found["fallen"] == share(2, 2)
    assert found["drift_mm_per_s"] == {"median": None, "worst": None}
    assert found["realtime_factor"] is None
    assert found["settings"]["chosen"]["failure"]["rate"] is None


def test_contacts_of_some_settings_always_have_the_chosen_one(said):
    for asked in (("impratio 1",), ("chosen", "impratio 1"), ("impratio 1", "impratio 1")):
        assert list(said("contacts", "--towers", 1, "--settings", *asked)["settings"]) == ["chosen", "impratio 1"]


def test_few_towers_compare_no_settings_and_many_compare_all(said):
    assert list(said("contacts", "--towers", 19)["settings"]) == ["chosen"]
    found = said("contacts", "--towers", 24)["settings"]
    assert list(found) == list(SETTINGS)
    assert [one["fallen"]["n"] for one in found.values()] == [24] + [3] * (len(SETTINGS) - 1)


def test_as_many_pulls_are_repeated_as_half_the_towers(said):
    assert "repeated" not in said("ceiling", "--towers", 1)
    assert said("ceiling", "--towers", 6)["repeated"]["pulls"] == 3


def test_ceiling(said, tmp_path):
    found = said("ceiling", "--towers", 6, "--targets", 3, "--repeats", 4, "--repeated", 6)
    assert proportion(found["agreement"]) == share(12, 18)
    assert found["accuracy_bounds"] == pytest.approx([2 / 3, (1 + (1 / 3) ** 0.5) / 2])
    assert proportion(found["strict_agreement"]) == share(12, 18)
    assert proportion(found["failure"]) == share(12, 18)
    assert proportion(found["strict_failure"]) == share(18, 18)
    assert found["outcomes"] == {"collapsed": 6, "extracted": 6, "stuck": 6}
    assert (found["episodes"], found["invalid"]) == (2 * 3 * 4 + 4 * 3 * 2, 0)
    assert found["by_round"].keys() == {"1", "2", "3"}
    assert all(proportion(group["failure"]) == share(4, 6) for group in found["by_round"].values())
    assert proportion(found["by_slot"]["middle"]["failure"]) == share(6, 6)
    assert proportion(found["by_slot"]["side"]["agreement"]) == share(6, 12)
    repeated = found["repeated"]
    assert (repeated["pulls"], repeated["repeats"]) == (6, 4)
    # Two in three pulls are certain; in the third, 2 of 4 fail: 2 of 6 pairs agree, and most of the others are wrong.
    assert repeated["agreement"]["mean"] == pytest.approx((1 + 1 + 1 / 3) / 3)
    assert repeated["lower"]["mean"] == pytest.approx(2 / 3)
    assert repeated["upper"]["mean"] == pytest.approx((1 + 1 + 0.5) / 3)
    rows = rows_of((tmp_path / "out" / "ceiling.md").read_text())
    expected = {"two pulls agree (failure or not)", "failure rate", "1", "2", "3", "middle", "side"}
    assert {*expected, "collapsed", "extracted", "stuck"} <= rows.keys()


def test_a_ceiling_of_two_pulls_each_has_no_repeats(said):
    assert "repeated" not in said("ceiling", "--towers", 2, "--repeats", 2)
    assert "repeated" not in said("ceiling", "--towers", 2, "--repeated", 0)


def test_a_ceiling_of_one_slot_has_no_rate_for_the_other(said):
    found = said("ceiling", "--towers", 2, "--targets", 1)
    assert found["by_slot"]["middle"]["failure"]["rate"] is None
    assert found["by_slot"]["middle"]["failure"]["n"] == 0


def test_speed(said, tmp_path):
    found = said("speed", "--towers", 4, "--speeds", 0.4, 0.05, 0.4)
    assert list(found["speeds"]) == ["0.05", "0.4"]
    slow, fast = found["speeds"].values()
    assert proportion(slow["failure"]) == share(0, 4)
    assert proportion(fast["failure"]) == proportion(fast["strict_failure"]) == share(2, 4)
    assert fast["outcomes"] == {"collapsed": 2, "extracted": 2}
    rows = rows_of((tmp_path / "out" / "speed.md").read_text())
    assert rows["0.05"][2:] == ["0", "0"]
    assert rows["0.4"][2:] == ["0", "2"]


def test_sleep(said, tmp_path):
    found = said("sleep", "--towers", 5)
    assert found["asleep_as_awake"] == found["repeats_exactly"] == share(5, 5)
    assert found["nudged_as_awake"] == share(4, 5)
    assert found["difference"]["difference"] == pytest.approx(0.2)
    assert found["outcomes"]["nudged"] == {"collapsed": 1, "stuck": 4}
    assert len(rows_of((tmp_path / "out" / "sleep.md").read_text())) == 2 + 3


def test_rounds(said, tmp_path):
    found = said("rounds", "--towers", 3)
    assert list(found["rounds"]) == [str(r) for r in range(1, 16)]
    first, tenth, last = (found["rounds"][r] for r in ("1", "10", "15"))
    assert first == {"stood": share(3, 3), "mean_tries": 1.0, "most_tries": 1, "first_try": {"stands": 3}}
    assert tenth == {"stood": share(3, 3), "mean_tries": 3.0, "most_tries": 3, "first_try": {"falls": 3}}
    assert last == {"stood": share(0, 3), "mean_tries": None, "most_tries": 0, "first_try": {"falls": 3}}
    assert found["rejected"] == 6 * 3 * 2
    assert found["bias"]["height_spread_mm"]["accepted"].startswith("7.50 [")  # the mean of rounds 1 to 14
    assert found["bias"]["height_spread_mm"]["rejected"].startswith("12.50 [")  # of 10 to 15
    rows = rows_of((tmp_path / "out" / "rounds.md").read_text())
    assert {*found["rounds"], *found["bias"]} <= rows.keys()
    assert rows["15"][1] == "–"


def test_rounds_in_which_nothing_stands(said, monkeypatch):
    nothing = {"tries": 0, "first": "cannot be grown", "rejected": [], "accepted": None}
    monkeypatch.setattr(
        "jenga_data.calibrate.rounds.tries_of_round", lambda round_number, **_: {"round": round_number} | nothing
    )
    found = said("rounds", "--towers", 2)
    assert all(one["first_try"] == {"cannot be grown": 2} for one in found["rounds"].values())
    assert found["bias"] == {}


def test_turntable(said, tmp_path):
    found = said("turntable", "--towers", 4, "--round", 7)
    assert found["rested"] == share(3, 4)
    assert found["fallen"] == share(0, 3)
    assert found["round"] == 7
    assert found["after_mm"]["median"] == pytest.approx(0.2)
    assert found["after_mm"]["largest"] == pytest.approx(0.3)
    assert found["unturned_mm"]["smallest"] == 0.0
    assert found["friction"]["smallest"] == pytest.approx(0.05)  # the tower at the brink is left out
    assert len(rows_of((tmp_path / "out" / "turntable.md").read_text())) == 2 + 4


def test_one_tower_of_which_nothing_can_be_told(said):
    """Neither the friction of a tower at the brink, nor movement that there was none of."""
    found = said("turntable", "--towers", 1)
    assert set(found["friction"].values()) == {None}


# --- parts ---------------------------------------------------------------------------------------------------------


def test_quantiles_of_nothing_are_none():
    assert set(quantiles(np.zeros(0)).values()) == {None}
    assert quantiles(np.arange(101.0)) == pytest.approx(
        {"smallest": 0, "5 %": 5, "median": 50, "95 %": 95, "largest": 100}
    )


def test_a_store_that_was_cut_gives_the_same_report(tmp_path):
    run = Run(towers=4, seed=0, workers=1, out=Path(tmp_path))
    first = ceiling_report(run, SelectionConfig(), 3, 4, 3)
    store = tmp_path / "ceiling.jsonl"
    store.write_bytes(store.read_bytes()[:-30])
    assert ceiling_report(run, SelectionConfig(), 3, 4, 3) == first
