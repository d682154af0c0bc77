"""A page escapes what it is given, refers to nothing that is not there, and needs no network."""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from jenga_control.page import Code, Figure, Files, KeyFigure, KeyFigures, Page, Section, Table, write_page
from jenga_data.errors import JengaError

EVIL = "<script>alert('x')</script> & \"more\""
PNG = bytes.fromhex("89504e470d0a1a0a")


class Tags(HTMLParser):
    """Every element with its attributes, and all text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in {"meta", "img"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def render(folder: Path, *blocks) -> Tags:
    write_page(folder / "index.html", Page("Title", "Subtitle", [Section("One", blocks)]))
    tags = Tags((folder / "index.html").read_text(encoding="utf-8"))
    assert tags.open == []
    return tags


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pictures & more").mkdir()
    (tmp_path / "pictures & more" / "a tower.png").write_bytes(PNG)
    (tmp_path / "log.mcap").write_bytes(bytes(1_234_567))
    return tmp_path


def everything(folder: Path) -> Page:
    picture = folder / "pictures & more" / "a tower.png"
    blocks = [
        EVIL,
        KeyFigures([KeyFigure(EVIL, EVIL, EVIL)]),
        Table([EVIL, "n"], [[EVIL, 400]], EVIL),
        Figure(picture, EVIL, EVIL),
        Figure(picture, EVIL, embed=True),
        Files([(folder / "log.mcap", EVIL)], EVIL),
        Code(EVIL, EVIL),
    ]
    return Page(
        EVIL,
        EVIL,
        [Section(EVIL, blocks), Section("Two", ["x"]), Section("Two", ["y"])],
        [KeyFigure(EVIL, EVIL)],
        [EVIL],
    )


def test_whatever_a_page_is_given_is_shown_as_text(folder: Path) -> None:
    write_page(folder / "index.html", everything(folder))
    tags = Tags((folder / "index.html").read_text(encoding="utf-8"))
    assert len(tags.all("script")) == 1
    assert tags.text.count(EVIL) == 20  # wherever a page takes text, its title in two places
    assert all(image["alt"] == EVIL for image in tags.all("img"))


def test_every_reference_is_in_the_folder_or_in_the_page(folder: Path) -> None:
    write_page(folder / "index.html", everything(folder))
    html = (folder / "index.html").read_text(encoding="utf-8")
    tags = Tags(html)
    ids = [attributes["id"] for _, attributes in tags.elements if "id" in attributes]
    assert len(ids) == len(set(ids)) == 3
    references = [a[name] for _, a in tags.elements for name in ("src", "href") if name in a]
    assert len(references) == 7
    for reference in references:
        assert reference is not None
        if reference.startswith("#"):
            assert reference[1:] in ids
        elif not reference.startswith("data:image/png;base64,"):
            assert (folder / unquote(reference)).is_file()
    for forbidden in ("http:", "https:", "//", "@import", "url("):
        assert forbidden not in html.replace("data:image/png;base64,", "")


def test_a_moved_folder_still_works(folder: Path) -> None:
    tags = render(folder, Figure(folder / "pictures & more" / "a tower.png", "a tower"))
    (image,) = tags.all("img")
    assert image["src"] == "pictures%20%26%20more/a%20tower.png"


def test_columns_of_numbers_are_flush_right_and_others_are_not(folder: Path) -> None:
    rows = [["GCN", 0.7412, "0.70 to 0.78", 400, None], ["majority", 0.67, "-0.1 to 0.2", 12345, "2.5 min"]]
    tags = render(folder, Table(["model", "accuracy", "interval", "n", "time"], rows))
    assert [cell.get("class") for cell in tags.all("th")] == [None, *["number"] * 4]
    for shown in ("0.741", "0.670", "12345", "–"):
        assert shown in tags.text


def test_backticks_are_code_and_nothing_else_is(folder: Path) -> None:
    tags = render(folder, "call `jenga demo` <b>now</b>")
    assert len(tags.all("code")) == 1
    assert not tags.all("b")


def test_sizes_are_those_of_the_files(folder: Path) -> None:
    tags = render(folder, Files([(folder / "log.mcap", "a log"), (folder / "pictures & more", "pictures")]))
    assert "1.2 MB" in tags.text
    assert "1 files, 8 B" in tags.text


def test_what_is_missing_is_one_clear_line_and_leaves_no_page(folder: Path) -> None:
    for block in (
        Figure(folder / "no.png", ""),
        Figure(folder / "no.png", "", embed=True),
        Files([(folder / "no", "")]),
    ):
        with pytest.raises(JengaError, match=r"the page refers to .*no.*, which does not exist"):
            render(folder, block)
    assert not (folder / "index.html").exists()


def test_only_pictures_can_be_embedded(folder: Path) -> None:
    with pytest.raises(JengaError, match=r"log.mcap is no picture for a page; allowed: .png"):
        render(folder, Figure(folder / "log.mcap", "", embed=True))


def test_a_page_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(JengaError, match=r"cannot write .*No such file"):
        write_page(tmp_path / "missing" / "index.html", Page("t", "", []))


def test_a_row_that_does_not_fit_the_head_is_refused() -> None:
    with pytest.raises(ValueError, match="a row of 1 cells under a head of 2"):
        Table(["a", "b"], [["x"]])
