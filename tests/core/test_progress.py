import io

import pytest

from jenga_data.progress import Bar, progress


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def run(total: float | None = 3) -> None:
    with progress("growing towers", total) as bar:
        assert isinstance(bar, Bar)
        for _ in range(3):
            bar.advance(1, "2 stuck")


def test_nothing_is_drawn_where_stderr_is_no_terminal(capsys):
    run()
    assert capsys.readouterr() == ("", "")


def test_people_see_what_is_done_and_how_much_of_it(monkeypatch, capsys):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    run()
    drawn = terminal.getvalue()
    assert "growing towers" in drawn
    assert "3/3" in drawn
    assert "2 stuck" in drawn
    assert capsys.readouterr().out == ""


def interrupted() -> None:
    with progress("growing towers", 3) as bar:
        bar.advance()
        raise KeyboardInterrupt


def test_what_goes_wrong_behind_a_bar_comes_out():
    with pytest.raises(KeyboardInterrupt):
        interrupted()


def test_a_number_of_steps_that_nobody_knows_is_no_problem(monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    run(None)
