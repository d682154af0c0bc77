"""What the report says of rollouts that evaluations logged, whatever they pulled with."""

import pytest
from closed_loops import CHEAP, MadeUpPulls, result

from jenga_control.extraction.evaluate import Switches, evaluate_extraction
from jenga_control.extraction.figures import causes_figure
from jenga_control.extraction.report import report_extraction
from jenga_control.extraction.touch import TouchConfig
from jenga_data.errors import JengaError
from jenga_data.outcome import Outcome

OUT, STUCK, DRAGGED = (
    result(Outcome.EXTRACTED),
    result(Outcome.STUCK, "out_of_time"),
    result(Outcome.EXTRACTED, moved=0.04, dragged=True),
)
RESULTS = {
    "naive": [OUT, OUT, STUCK, OUT],
    "straight-0.05": [STUCK, OUT, STUCK, STUCK],
    "straight-0.5": [OUT, OUT, STUCK, DRAGGED],
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Four towers pulled in three ways, and the first two of them again with a switch in another folder."""
    base = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jenga_control.extraction.evaluate.Trunk", MadeUpPulls(RESULTS))
        evaluate_extraction(None, base / "plain", tuple(RESULTS), 4, workers=1, config=CHEAP)
        switches = Switches(touch=TouchConfig())
        evaluate_extraction(None, base / "touch", ("naive",), 2, workers=1, config=CHEAP, switches=switches)
    return [base / "plain", base / "touch"]


@pytest.fixture(scope="module")
def report(folders, tmp_path_factory):
    return report_extraction(folders, tmp_path_factory.mktemp("out"))


def test_every_way_has_its_rate_over_all_towers(report):
    rates = {name: (row["success"]["rate"], row["success"]["n"]) for name, row in report["ways"].items()}
    assert rates == {"naive": (0.75, 4), "straight-0.05": (0.25, 4), "straight-0.5": (0.75, 4), "naive +touch": (1, 2)}
    assert report["ways"]["straight-0.5"]["success_without_dragging"]["rate"] == 0.5
    assert report["ways"]["straight-0.05"]["causes"] == {"out_of_time": 3}
    assert report["towers"] == 4


def test_ways_are_compared_with_the_best_straight_pull_on_common_towers(report):
    assert report["best_straight"] == "straight-0.5"
    assert "above_best_straight" not in report["ways"]["straight-0.5"]
    naive, touched = (report["ways"][name]["above_best_straight"] for name in ("naive", "naive +touch"))
    assert (naive["n"], naive["difference"]) == (4, 0)
    assert naive["without_dragging"]["difference"] == 0.25
    assert touched["n"] == 2


def test_a_straight_pulls_speed_is_what_it_was_told_and_anothers_what_it_did(report):
    ways = report["ways"]
    assert (ways["straight-0.05"]["speed"], ways["straight-0.5"]["speed"]) == (0.05, 0.5)
    # Three decisions that start at 8 mm a step, 0.25 m/s, and are pulled on by half a sigma of 4 mm each.
    assert 0.25 < ways["naive"]["speed"] < 0.5


def test_the_ceiling_of_all_ways_together_is_told(report):
    assert report["any"]["success"] == {"rate": 1.0, "n": 2, "ci95": pytest.approx([0.342, 1.0], abs=1e-3)}


def test_no_two_fates_look_alike(report):
    row = report["ways"]["naive"] | {"causes": {f"cause {k}": 1 for k in range(12)}}
    (axes,) = causes_figure({"naive": row}).axes
    looks = {(patch.get_facecolor(), patch.get_hatch()) for patch in axes.patches}
    assert len(looks) == len(axes.patches) == 13


def test_it_is_written_as_tables_and_figures(report):
    written = [path.rsplit("/", 1)[1] for path in report["written"]]
    figures = [f"extraction-{name}.png" for name in ("speed", "causes", "rounds")]
    assert written == ["extraction.json", "extraction.md", *figures]
    assert "| **straight-0.5** | 0.75" in report["text"]
    assert "out_of_time" in report["text"]


def test_rounds_are_grouped(report):
    groups = report["ways"]["naive"]["by_round"]
    assert {name: group["n"] for name, group in groups.items()} == {"1-5": 4}


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "logs").mkdir()
    with pytest.raises(JengaError, match="holds no rollouts of `jenga eval extraction`"):
        report_extraction([tmp_path / "logs"], tmp_path / "out")
    with pytest.raises(JengaError, match="no folder of an evaluation was given"):
        report_extraction([], tmp_path / "out")
