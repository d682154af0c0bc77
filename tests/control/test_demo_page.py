"""The page of a demo shows every number that it was given, and refers to nothing that is not there."""

import shlex
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from jenga_control.demo_page import DemoResults, write_demo_page
from jenga_data.agreement import Agreement
from jenga_data.collect.workers import CollectSummary
from jenga_data.dataset.manifest import Counts, File, Manifest, Provenance, Splits
from jenga_data.errors import JengaError

PNG = bytes.fromhex("89504e470d0a1a0a")
PICTURES = ("robot", "towers", "film", "curves", "selection")


class Page(HTMLParser):
    """Tables as rows of texts by their caption, all addresses, and all text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.links: list[str] = []
        self.text = ""
        self._rows: list[list[str]] = []
        self._caption = ""
        self._in = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if name in ("src", "href") and value]
        if tag == "table":
            self._rows, self._caption = [], ""
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._rows[-1].append("")
        if tag in ("td", "th", "caption"):
            self._in = tag

    def handle_endtag(self, tag: str) -> None:
        if tag == "table":
            self.tables[self._caption] = self._rows
        if tag == self._in:
            self._in = ""

    def handle_data(self, data: str) -> None:
        self.text += data
        if self._in == "caption":
            self._caption += data
        elif self._in:
            self._rows[-1][-1] += data

    def table(self, caption: str) -> list[list[str]]:
        """The rows below the head of the table whose caption starts so."""
        (found,) = (rows for name, rows in self.tables.items() if name.startswith(caption))
        return found[1:]


def rate(value: float, n: int) -> dict:
    return {"rate": value, "n": n, "ci95": [max(0, value - 0.25), min(1, value + 0.25)]}


def pulled(objective: str, value: float, n: int, disturbance: float | None, hz: float | None) -> dict:
    return {
        "objective": objective,
        "success": rate(value, n),
        "median_disturbance_mm": disturbance,
        "control_hz": hz,
    }


def manifest(name: str, kind: str, rows: int, digest: str) -> Manifest:
    return Manifest(
        name=name,
        version="0.1.0",
        format_version="1.0.0",
        kind=kind,
        description="",
        blocks=54,
        features=[],
        files=[File("data/a.parquet", 1, rows, "0" * 64), File("episodes.parquet", 1, 3, "1" * 64)],
        splits=Splits("", [], [], []),
        statistics={},
        labels=[],
        counts=Counts(rows, 3, 3, 0, 0, {}, {}, {}),
        provenance=Provenance([], {}, [], {}, {}),
        parents=[],
        licence="",
        citation=[],
        sources=[],
        hash=digest * 64,
    )


@pytest.fixture
def results(tmp_path: Path) -> DemoResults:
    """A demo that never ran: everything it would leave, as empty as it may be."""
    out = tmp_path / "demo & more"
    for name in ("logs/closed-loop/full", "datasets", "checkpoints/selection", "checkpoints/dynamics", "tables"):
        (out / name).mkdir(parents=True)
    (out / "pictures").mkdir()
    for name in PICTURES:
        (out / "pictures" / f"{name}.png").write_bytes(PNG)
    (out / "logs" / "robot.mcap").write_bytes(bytes(10))
    (out / "robot.rrd").write_bytes(bytes(30))
    episode, replay = out / "logs" / "closed-loop" / "full" / "abc.mcap", out / "replay.rrd"
    episode.write_bytes(bytes(10))
    replay.write_bytes(bytes(20))
    counts = {"invalid": 0, "collapsed": 3, "extracted": 5, "stuck": 4}
    return DemoResults(
        out=out,
        collected={
            "selection": CollectSummary(12, counts, {}, 0, 60.0, str(out / "logs" / "selection")),
            "extraction": CollectSummary(
                6, {**counts, "collapsed": 1, "extracted": 5, "stuck": 0}, {"slipped": 1}, 0, 80.0, str(out / "logs")
            ),
        },
        manifests={
            "selection": manifest("demo-selection", "selection", 12, "a"),
            "dynamics": manifest("demo-dynamics", "dynamics", 301, "b"),
        },
        selection={
            "accuracy": rate(0.75, 2),
            "baselines": {"majority": {"accuracy": rate(0.5, 2)}, "rule": {"accuracy": rate(1.0, 2)}},
        },
        dynamics={
            "one_step": {"skill_others": 0.625, "skill_target": 0.875},
            "rollout_5": {"skill_others": -0.25, "skill_target": None},
        },
        extraction=pulled("full", 1.0, 2, 1.5, 31.0)
        | {
            "baselines": {
                "naive": pulled("naive", 0.5, 2, None, 900.0),
                "straight": pulled("straight", 0.0, 2, 9, None),
            }
        },
        agreement=Agreement(both=900, edge_only=100, contact_only=300),
        episode=episode,
        replay=replay,
        robot=out / "logs" / "robot.mcap",
        robot_replay=out / "robot.rrd",
        pictures={name: out / "pictures" / f"{name}.png" for name in PICTURES},
        checkpoints=(out / "checkpoints" / "selection", out / "checkpoints" / "dynamics"),
        trained=(Path("trained/selection"), Path("trained/dynamics")),
        seconds=123.4,
    )


def shown(results: DemoResults) -> Page:
    index = write_demo_page(results)
    assert index == results.out / "index.html"
    return Page(index.read_text(encoding="utf-8"))


def test_ways_to_pull_stand_side_by_side(results):
    rows = shown(results).table("The same towers and targets")
    assert rows == [
        ["full", "1.00 [0.75, 1.00]", "2", "1.50", "31.00"],
        ["naive", "0.50 [0.25, 0.75]", "2", "–", "900.00"],
        ["straight", "0.00 [0.00, 0.25]", "2", "9", "–"],
    ]


def test_rollouts_by_how_they_ended(results):
    page = shown(results)
    (head,) = (rows[0] for caption, rows in page.tables.items() if caption.startswith("How the collected"))
    assert head == ["Kind of rollout", "Rollouts", "collapsed", "extracted", "invalid", "stuck"]
    assert page.table("How the collected") == [
        ["selection", "12", "3", "5", "0", "4"],
        ["extraction", "6", "1", "5", "0", "0"],
    ]


def test_both_datasets(results):
    assert shown(results).table("What the converter made") == [
        ["demo-selection@0.1.0", "selection", "12", "2", "a" * 12],
        ["demo-dynamics@0.1.0", "dynamics", "301", "2", "b" * 12],
    ]


def test_models_next_to_their_baselines(results):
    page = shown(results)
    assert page.table("Against rules") == [
        ["graph network", "0.75 [0.50, 1.00]", "2"],
        ["majority", "0.50 [0.25, 0.75]", "2"],
        ["rule", "1.00 [0.75, 1.00]", "2"],
    ]
    assert page.table("1 - MSE") == [["one step", "0.62", "0.88"], ["rollout 5", "-0.25", "–"]]


def test_how_well_edges_agree_with_contacts(results):
    text = shown(results).text
    assert "0.75 of the simulator's 1,200 contacts" in text
    assert "0.90 of the edges touch" in text


def test_key_figures(results):
    text = shown(results).text
    for figure in ("18rollouts logged", "313graphs in", "100 %blocks extracted", "123 sfor all of it"):
        assert figure in text
    nothing = replace(results, extraction=results.extraction | {"success": {"rate": None, "n": 0, "ci95": [0, 1]}})
    assert "n = 0" in shown(nothing).text


def test_everything_it_refers_to_is_there(results):
    folder = results.out.resolve()
    files = [link for link in shown(results).links if not link.startswith("#")]
    for link in files:
        path = (results.out / unquote(link)).resolve()
        assert path.exists(), link
        assert path.is_relative_to(folder), link
    linked = {(results.out / unquote(link)).resolve() for link in files}
    assert linked >= {(results.out / "pictures" / f"{name}.png").resolve() for name in PICTURES}
    assert linked >= {(results.out / name).resolve() for name in ("logs", "datasets", "checkpoints", "tables")}
    assert results.replay.resolve() in linked


def test_it_shows_the_commands_that_open_the_pulls(results):
    commands = [line for line in shown(results).text.splitlines() if line.startswith("jenga replay")]
    assert [shlex.split(command.removesuffix("Copy")) for command in commands] == [
        ["jenga", "replay", str(results.robot), "--model", "trained/selection", "trained/dynamics"],
        ["jenga", "replay", str(results.episode), "--model", str(results.checkpoints[1])],
    ]


def test_the_folder_can_be_moved(results, tmp_path):
    links = shown(results).links
    moved = results.out.rename(tmp_path / "elsewhere")
    assert all((moved / unquote(link)).exists() for link in links if not link.startswith("#"))


@pytest.mark.parametrize("missing", ["pictures/film.png", "replay.rrd"])
def test_a_page_with_something_missing_is_not_written(results, missing):
    (results.out / missing).unlink()
    with pytest.raises(JengaError, match="which does not exist"):
        write_demo_page(results)
    assert not (results.out / "index.html").exists()


def test_nothing_else_is_left_in_the_folder(results):
    before = set(results.out.rglob("*"))
    write_demo_page(results)
    assert set(results.out.rglob("*")) - before == {results.out / "index.html"}
