import json

import numpy as np
import pytest

from jenga_data.errors import JengaError
from jenga_data.report import make_folder, markdown_table, number, to_json, with_interval, write_report
from jenga_data.statistics import Proportion, proportion_over_towers


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.7432, "0.74"),
        (0.0, "0.00"),
        (12.345, "12.35"),
        (0.01234, "0.0123"),
        (-0.00001234, "-1.23e-05"),
        (12345, "12,345"),
        (True, "yes"),
        ("full", "full"),
        (float("nan"), "–"),
    ],
)
def test_a_number_is_written_in_one_way(value, text):
    assert number(value) == text


def test_a_proportion_shows_its_interval_and_n():
    hits = np.arange(400) < 296
    assert number(Proportion.of(hits).as_dict()) == "0.74 [0.69, 0.78] (n = 400)"
    assert number(Proportion.of(hits[:0]).as_dict()) == "– (n = 0)"


def test_the_wider_interval_is_the_one_that_is_shown():
    all_fail = proportion_over_towers(np.zeros(8, bool), np.arange(8) // 2)
    assert all_fail["ci95_towers"] == [0, 0]
    assert number(all_fail) == "0.00 [0.00, 0.32] (n = 8)"

    every_row_of_a_tower_alike = np.repeat([True, False, True, True], 100)
    shown = proportion_over_towers(every_row_of_a_tower_alike, np.repeat(np.arange(4), 100))
    low, high = shown["ci95_towers"]
    assert number(shown) == f"0.75 [{low:.2f}, {high:.2f}] (n = 400)"
    assert high - low > 0.3


def test_a_table_has_a_cell_for_every_column():
    table = markdown_table(("a|b", "n"), [("x", 1), ("y", None)])
    assert table == "| a/b | n |\n| --- | ---: |\n| x | 1 |\n| y | – |\n"
    with pytest.raises(ValueError, match="2 cells"):
        markdown_table(("a", "b"), [("x",)])


def test_values_without_an_interval_stand_alone():
    assert with_interval(0.5, None) == "0.50"
    assert with_interval(None, [0.1, 0.2]) == "–"
    assert with_interval(0.5, [0.4, 0.6]) == "0.50 [0.40, 0.60]"


def test_reports_are_written_whole(tmp_path):
    report = {"accuracy": Proportion.of(np.array([True, False])).as_dict(), "auroc": float("nan")}
    json_path, table_path = write_report(tmp_path / "out", "selection", report, "| a |\n")
    assert json.loads(json_path.read_text()) == {**report, "auroc": None}
    assert table_path.read_text() == "| a |\n"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["selection.json", "selection.md"]
    assert to_json(report).endswith("}\n")


def test_a_report_that_cannot_be_written_leaves_the_old_one(tmp_path):
    write_report(tmp_path, "selection", {"n": 1}, "")
    with pytest.raises(TypeError):
        write_report(tmp_path, "selection", {"n": object()}, "")
    assert json.loads((tmp_path / "selection.json").read_text()) == {"n": 1}


def test_a_folder_that_cannot_be_made_is_refused_with_the_way_out(tmp_path):
    make_folder(tmp_path / "new" / "out")
    make_folder(tmp_path / "new" / "out")  # there already is as good
    (tmp_path / "file").touch()
    with pytest.raises(JengaError, match=r"cannot write to .*file/out: .*; choose another --out"):
        make_folder(tmp_path / "file" / "out")
