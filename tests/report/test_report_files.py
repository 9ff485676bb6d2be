"""A report's folder: all digits in its tables, one page that needs no other file, a digest, whole or not at all."""

import csv
import hashlib
import json
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

from flexmbd.errors import ExportError
from flexmbd.report import (
    Line,
    Listing,
    Paragraph,
    Report,
    ReportPicture,
    ReportSection,
    ReportTable,
    diagram,
    refuse_folder,
    write_report,
)
from flexmbd.report.contents import number_text

ROWS = ((1.0 / 3.0, "a_b & <c>"), (-2.5e-17, "FAIL"), (float("nan"), "100 %"), (np.pi * 1e9, 'x, "y"'))
TABLE = ReportTable("errors", "Errors & such_1 < 2", ("h [m]", "what"), ROWS)
LINES = [Line("one", [1, 2, 4], [1.0, 0.2, 0.05]), Line("two", [1, 2, 4], [1.0, 0.3, 0.1], panel=1, is_joined=False)]


def report(*more):
    picture = diagram("curves", "Curves", LINES, x="n", y="error", titles=("left", "right"))
    contents = [Paragraph("1 < 2 & so on"), TABLE, picture, Listing("a  b\n c <d>"), *more]
    return Report("A <form>", "FAIL", "In short.", [ReportSection("Findings", contents)], {"form.py": "abc"})


class Page(HTMLParser):
    """Text, tags that are open, and what is loaded from elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.open, self.text, self.loaded = [], "", []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.loaded += [found[key] for key in ("src",) if key in found] + ([found] if tag in ("link", "script") else [])
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_a_report(tmp_path):
    page = write_report(report(), tmp_path / "report")
    assert page == tmp_path / "report" / "index.html"
    found = Page(page.read_text())
    assert found.open == []
    assert [one.partition(",")[0] for one in found.loaded] == ["data:image/svg+xml;base64"]
    for text in ("A <form>", "FAIL", "1 < 2 & so on", "a  b\n c <d>", "a_b & <c>", "0.3333", "form.py: abc"):
        assert text in found.text
    names = {str(path.relative_to(tmp_path / "report")) for path in (tmp_path / "report").rglob("*") if path.is_file()}
    assert names == {
        "index.html", "digest.json", "tables/errors.csv", "tables/errors.tex", "figures/curves.svg",
        "figures/curves.pdf",
    }  # fmt: skip


def test_tables_keep_all_digits(tmp_path):
    write_report(report(), tmp_path / "report")
    with open(tmp_path / "report/tables/errors.csv", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["h [m]", "what"]
    assert [text for _, text in rows] == [text for _, text in ROWS]
    np.testing.assert_array_equal([float(one or "nan") for one, _ in rows], [one for one, _ in ROWS])


def test_latex_has_no_letter_that_it_would_take_for_a_command():
    text = TABLE.latex()
    assert r"\caption{Errors \& such\_1 \textless{} 2.}" in text
    assert r"0.3333 & a\_b \& \textless{}c\textgreater{} \\" in text
    assert r"$-2.5 \times 10^{-17}$ & FAIL \\" in text
    assert r"- & 100 \% \\" in text


@pytest.mark.parametrize(
    ("value", "told"),
    [(1018.3, "1018"), (10182.7, "10180"), (-113300.0, "-113300"), (2.1e11, "2.1e+11"), (1e-5, "1e-05")],
)
def test_numbers_below_a_million_have_no_exponent(value, told):
    assert number_text(value) == told


def test_a_long_table_goes_over_pages_and_long_text_over_lines():
    short = ReportTable("short", "Short", ("n", "what"), tuple((k, "x" * 41) for k in range(40)))
    assert r"\begin{tabular}{rp{0.5\linewidth}}" in short.latex()
    long = ReportTable("long", "Long", ("n", "what"), (*short.rows, (40, "y"))).latex()
    assert r"\begin{longtable}{rp{0.5\linewidth}}" in long
    assert long.count(r"n & what \\") == 2  # on the first page, and on each further one
    assert "{table}" not in long
    assert long.count(r"\begin{") == long.count(r"\end{") == 1


def test_axes_have_the_values_of_few_points_and_a_decade_at_least():
    lines = [Line("one", [4, 6, 8, 10], [1.0, 1.01, 1.02, 1.03], panel=k) for k in range(3)]
    figure = Figure()
    diagram("d", "D", lines, x="n", y="error", titles=("a", "b", "c")).draw(figure)
    figure.canvas.draw()
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 3
    for axes in shown:
        assert list(axes.get_xticks()) == [4.0, 6.0, 8.0, 10.0]
        assert list(axes.get_xticks(minor=True)) == []
        low, high = axes.get_ylim()
        assert high / low == pytest.approx(10.0)
        assert low < 1.0 < 1.03 < high
    for axes in shown[1:]:  # below these there is none
        assert [label.get_text() for label in axes.get_xticklabels()] == ["4", "6", "8", "10"]


def test_the_digest_is_that_of_the_files(tmp_path):
    write_report(report(), tmp_path / "report")
    digest = json.loads((tmp_path / "report/digest.json").read_text())
    assert digest["sha256 of what was looked at"] == {"form.py": "abc"}
    text = "tables/errors.csv\n" + (tmp_path / "report/tables/errors.csv").read_text()
    assert digest["sha256 of what was found"]["tables/*.csv"] == hashlib.sha256(text.encode()).hexdigest()
    assert digest["versions"]["numpy"] == np.__version__


def test_two_reports_of_the_same_are_the_same_to_the_byte(tmp_path):
    for name in ("one", "two"):
        write_report(report(), tmp_path / name)
    for path in (tmp_path / "one").rglob("*.*"):
        assert path.read_bytes() == (tmp_path / "two" / path.relative_to(tmp_path / "one")).read_bytes()


@pytest.mark.parametrize("use", [refuse_folder, lambda folder: write_report(report(), folder)])
def test_folders_that_cannot_be_taken(tmp_path, use):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for folder, message in (
        (tmp_path / "full", "full is not empty; give a folder"),
        (tmp_path / "file", "file is a file; give a folder"),
        (tmp_path / "none/report", "none/report: No such file or directory; give a folder"),
        (tmp_path / "file/report", "Not a directory"),
    ):
        with pytest.raises(ExportError, match=message):
            use(folder)
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")} == {"full", "full/mine.txt", "file"}


def test_an_empty_folder_is_taken_and_one_that_may_be_is_left_as_it_is(tmp_path):
    (tmp_path / "report").mkdir()
    refuse_folder(tmp_path / "report")
    refuse_folder(tmp_path / "other")
    assert [path.name for path in tmp_path.iterdir()] == ["report"]
    before = (tmp_path / "report").stat().st_ino
    assert write_report(report(), tmp_path / "report").is_file()
    assert (tmp_path / "report").stat().st_ino == before  # who stands in it sees the files
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"index.html", "digest.json", "tables", "figures"}


def test_a_link_to_an_empty_folder(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "far")
    write_report(report(), tmp_path / "link")
    assert (tmp_path / "far/index.html").is_file()


def test_a_report_that_fails_leaves_nothing(tmp_path):
    def fail(figure):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_report(report(ReportPicture("other", "Another", fail)), tmp_path / "report")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["Errors", "a b", "../a", ""])
def test_names_that_are_none_for_files(name):
    with pytest.raises(ValueError, match="no name for files"):
        ReportTable(name, "", (), ())
