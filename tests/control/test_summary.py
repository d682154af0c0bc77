"""The report: what it finds, what it concludes from it, and a page that shows it in any browser without a network."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from PIL import Image

from jenga_control.summary.departures import departures
from jenga_control.summary.figures import report_figures
from jenga_control.summary.findings import CONTRADICTED, MISSING, OPEN, REPLICATES, findings
from jenga_control.summary.page import report_page
from jenga_control.summary.paper_tables import extraction_table, of_counts, selection_table
from jenga_control.summary.results import KINDS, read_results
from jenga_data.errors import JengaError

PINK = (255, 20, 147)


def proportion(hits: int, n: int) -> dict[str, Any]:
    return of_counts(hits, n)


def selection_report(low: float = -0.05, high: float = 0.01, n: int = 400) -> dict[str, Any]:
    """Two graph networks and a rule; poses change the accuracy by a value between `low` and `high`."""

    def row(kind: str, hits: int, information: str, **more: Any) -> dict[str, Any]:
        scores = {"accuracy": proportion(hits, n), "auroc": 0.8, "auroc_ci95": [0.7, 0.9], "brier": 0.2, "ece": 0.05}
        return {"kind": kind, "information": information, **scores, **more}

    gain = {"difference": 0.1, "ci95": [0.05, 0.15], "p_value": 0.001, "n": n}
    model = {"minus_best_baseline": gain, "best_baseline": "rule"}
    return {
        "dataset": "pulls@1.0.0", "n": n, "towers": 90, "failures": 0.4, "learning_curve": {}, "best": "gcn",
        "majority": proportion(round(0.6 * n), n), "ceiling": None,
        "rows": {
            "majority": row("baseline", round(0.6 * n), "none"),
            "rule": row("baseline", round(0.65 * n), "G_s"),
            "gcn": row("model", round(0.75 * n), "G_s", graph="G_s", **model),
            "gcn_poses": row("model", round(0.73 * n), "G_sp", graph="G_sp", **model),
        },
        "poses": [{"with": "gcn_poses", "without": "gcn", "difference": (low + high) / 2, "ci95": [low, high],
                   "p_value": 0.3, "n": n, "sentence": "Poses make no difference that these pulls can show."}],
    }  # fmt: skip


def extraction(low: float = 0.02, high: float = 0.2, n: int = 100, hz: float = 31.0) -> dict[str, Any]:
    def way(hits: int, **more: Any) -> dict[str, Any]:
        causes = {"push_dragged_layer": 20, "collapsed": n - hits - 20}
        return {
            "success": proportion(hits, n),
            "causes": causes,
            "median_disturbance_mm": 3.2,
            "control_hz": hz,
            **more,
        }

    paired = {"difference": (low + high) / 2, "ci95": [low, high], "p_value": 0.01, "n": n}
    clean = {"success_without_dragging": proportion(n // 2, n)}
    baselines = {"naive": way(n // 2, paired=paired, **clean), "straight": way(n // 4, paired=paired, **clean)}
    return {"objective": "full", "dynamics": "learned", **way(n * 6 // 10), **clean, "baselines": baselines}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "runs").mkdir()
    write(tmp_path, "some-name", selection_report())
    write(tmp_path, "another", extraction())
    speed = {"value": 0.4, "unit": "s", "reference": 2.0, "ratio": 0.2, "n": 1, "limit": 1.0, "met": True}
    write(tmp_path, "bench-replay", {"write": speed, "frames": 1875})
    return tmp_path


def write(folder: Path, name: str, data: Any) -> None:
    (folder / "runs" / f"{name}.json").write_text(json.dumps(data))


def verdicts(folder: Path) -> dict[str, str]:
    return {finding.claim: finding.verdict for finding in findings(read_results([folder]))}


def test_results_are_known_by_their_keys_and_the_rest_is_passed_over(folder: Path) -> None:
    write(folder, "list", [1, 2])
    write(folder, "other", {"success": 1})
    (folder / "runs" / "half.json").write_text('{"success":')
    results = read_results([folder])
    assert {r.kind for r in results.found} == {"selection_report", "extraction", "bench"}
    assert {p.name for p in results.passed_over} == {"list.json", "other.json", "half.json"}
    with pytest.raises(JengaError, match=r"nowhere does not exist; name folders with the JSON files"):
        read_results([folder / "nowhere"])


def test_of_two_results_of_a_kind_the_larger_counts(folder: Path) -> None:
    write(folder, "a-smaller", extraction(n=40))
    best = read_results([folder]).best("extraction")
    assert best is not None
    assert best.path.name == "another.json"


POSES, OBJECTIVES = "Poses do not help selection", "The full objective beats O_a alone"


@pytest.mark.parametrize(
    ("low", "high", "n", "verdict"),
    [
        (-0.05, 0.01, 400, REPLICATES),
        (-0.05, 0.06, 400, OPEN),
        (0.01, 0.06, 400, CONTRADICTED),
        (-0.05, 0.01, 20, OPEN),
    ],
)
def test_that_poses_do_not_help_needs_an_interval_that_says_so(folder: Path, low, high, n, verdict) -> None:
    write(folder, "some-name", selection_report(low, high, n))
    assert verdicts(folder)[POSES] == verdict


@pytest.mark.parametrize(
    ("low", "high", "n", "verdict"),
    [(0.02, 0.2, 100, REPLICATES), (-0.02, 0.2, 100, OPEN), (-0.2, -0.02, 100, CONTRADICTED), (0.02, 0.2, 25, OPEN)],
)
def test_that_the_full_objective_wins_needs_a_paired_interval_above_zero(folder: Path, low, high, n, verdict) -> None:
    write(folder, "another", extraction(low, high, n))
    assert verdicts(folder)[OBJECTIVES] == verdict


def test_a_finding_without_its_result_names_the_command(tmp_path: Path) -> None:
    for finding in findings(read_results([tmp_path])):
        assert finding.verdict == MISSING
        assert finding.here == f"not measured: run `{finding.command}`"
        assert finding.command.startswith("jenga ")


def test_the_paper_stands_beside_ours(folder: Path) -> None:
    selection = {row[0]: row for row in selection_table(read_results([folder])).rows()}
    ours = "0.75 [0.71, 0.79] (n = 400)"
    assert selection["G_s, pose not encoded"][1:] == ("0.74 [0.69, 0.78] (n = 400)", ours, "`gcn`")
    assert selection["majority"][1] == "–"
    extracted = {row[0]: row for row in extraction_table(read_results([folder])).rows()}
    assert extracted["O_a + O_d"][1:3] == ("0.65 [0.55, 0.74] (n = 100)", "0.60 [0.50, 0.69] (n = 100)")
    empty = extraction_table(read_results([]))
    assert all("not measured: run `jenga eval extraction" in row[2] for row in empty.rows())


def test_a_report_of_several_evaluations_serves_as_well(folder: Path) -> None:
    told = extraction()
    rows = {"full": told, **told["baselines"], "hindsight": told}
    ways = {name: {k: v for k, v in row.items() if k != "baselines"} for name, row in rows.items()}
    (folder / "runs" / "another.json").unlink()
    write(folder, "extraction", {"ways": ways, "best_straight": "straight", "any": {}, "towers": 100})
    results = read_results([folder])
    lines = {row[0]: row for row in extraction_table(results).rows()}
    assert lines["O_a + O_d"][2] == "0.60 [0.50, 0.69] (n = 100)"
    assert lines["hindsight"][3].startswith("ceiling")
    assert verdicts(folder)[OBJECTIVES] == OPEN  # it holds no paired difference of the two
    assert "jenga report extraction" in Path(report_page(folder, results)["page"]).read_text()


def test_departures_quote_the_settings_that_run() -> None:
    said = {departure.what: departure for departure in departures()}
    assert "at most 2 N" in said["pull of the selection data"].here
    assert said["friction"].here.startswith("0.30, tuned")
    assert len(said) == len(departures()) >= 20
    assert all(d.paper and d.here and d.why for d in departures())


def test_a_page_of_nothing_says_what_to_run_and_refers_to_nothing(tmp_path: Path) -> None:
    told = report_page(tmp_path, read_results([]), report_figures(tmp_path / "figures"))
    html = Path(told["page"]).read_text()
    for command in (
        "report selection",
        "eval dynamics",
        "eval extraction",
        "report touch",
        "calibrate movable",
        "bench",
    ):
        assert f"jenga {command}" in html
    assert "no extraction logs were given" in html
    assert all(verdict == MISSING for verdict in told["findings"].values())


def test_a_page_holds_everything_it_shows(folder: Path) -> None:
    html = Path(report_page(folder, read_results([folder]), with_picture(folder))["page"]).read_text()
    references = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert references
    assert all(reference.startswith(("data:image/png;base64,", "#")) for reference in references)
    assert "url(" not in html
    for shown in ("0.75 [0.71, 0.79] (n = 400)", "push_dragged_layer 20", "0.40 s", "kept (1.00)", "31.0"):
        assert shown in html


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_result_costs_its_section_and_not_the_page(folder: Path, kind: str) -> None:
    write(folder, "damaged", dict.fromkeys(KINDS[kind], "nonsense") | {"n": 10**9})
    html = Path(report_page(folder, read_results([folder]))["page"]).read_text()
    assert "What replicates" in html
    assert "How this page was made" in html


def with_picture(folder: Path) -> dict[str, Any]:
    """What `report_figures` returns, with a picture of one colour that nothing else on the page has."""
    path = folder / "pink.png"
    Image.new("RGB", (600, 200), PINK).save(path)
    picture = {
        "name": "rounds",
        "title": "Towers",
        "path": str(path),
        "shows": ["k1"],
        "rule": "the first",
        "missing": "",
    }
    return {"figures": [picture]}


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium (Debian: apt-get install chromium)")
def test_a_browser_shows_words_tables_and_pictures_and_nothing_beyond_the_edge(folder: Path) -> None:
    page = report_page(folder, read_results([folder]), with_picture(folder))["page"]
    shot = folder / "page.png"
    program = [
        "chromium",
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--window-size=1200,9000",
    ]
    program += ["--disable-background-networking", f"--user-data-dir={folder / 'profile'}", f"--screenshot={shot}"]
    subprocess.run([*program, Path(page).as_uri()], check=True, capture_output=True, timeout=240)
    pixels = (255 * matplotlib.image.imread(shot)[..., :3]).round()
    pink = np.asarray((np.abs(pixels - PINK) < 3).all(axis=-1))
    assert pink.sum() > 100_000  # the embedded picture, at its own size
    drawn = np.asarray((pixels < 150).all(axis=-1))
    assert drawn[:400].sum() > 3000  # title and key figures
    assert drawn[500:].any(axis=1).sum() > 800  # rows of pixels with letters: tables all the way down
    assert not drawn[:, -10:].any()
