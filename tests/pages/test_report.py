"""The page of a design: complete, self-contained, true, and legible in a real browser."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import obsdesign
from obsdesign.cli.commands import cli
from obsdesign.document import digest
from obsdesign.pages.curves import curve_of
from obsdesign.pages.report import write_report
from tests.systems.designs import designed
from tests.verification.luenberger.test_error_bound import spring

ROOT = Path(__file__).parents[2]
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
ONE_OF_EACH = (
    "degue_4_1", "sampled_data", "medina_spline", "mazenc_4", "luteinizing_hormone", "ahn_1",
)  # fmt: skip


class Page(HTMLParser):
    """Text, images and everything that would reach for the network."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.images: list[str] = []
        self.reaches: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href") and not (value or "").startswith("data:"):
                self.reaches.append(f"{tag} {name}={value}")
            if tag == "img" and name == "src":
                self.images.append(value or "")
        if tag == "script":
            self.reaches.append("script")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.mark.parametrize("example", ONE_OF_EACH)
def test_a_page_tells_everything_of_its_design(example: str, tmp_path: Path) -> None:
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / f"{example}.toml"))
    source, out = tmp_path / "design.json", tmp_path / "report.html"
    design.save(source)
    assert write_report(str(source), str(out)).verdict == "proved"
    page = Page(out.read_text("utf-8"))
    assert page.open == []
    assert page.reaches == []
    # an estimate, and the curve of the kind; of observer (14) also the bounds of its error
    assert len(page.images) == 2 + (design.gains.get("method") == "approximate")
    for claim in design.claims:
        assert " ".join(claim.statement.split()) in page.text
        assert claim.source in page.text
    for guarantee in design.guarantees:
        assert " ".join(guarantee.statement.split()) in page.text
    assert json.loads(source.read_text("utf-8"))["digest"] in page.text
    assert "Kalman filter" in page.text  # a simulation knows the true state
    for name, value in design.provenance["versions"].items():
        assert f"{name} {value}" in page.text


@pytest.mark.parametrize("strategy", ["full", "quadratic"])
def test_every_strategy_of_impulses_has_its_curve(strategy: str, tmp_path: Path) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "gantry_crane.toml").to_dict()
    body["observer"] = {"kind": "impulsive", "strategy": strategy}
    design = designed(body)
    curve = curve_of(design)
    assert curve is not None
    (values,) = curve.series.values()
    assert np.isfinite(values).all()
    inside = (curve.x >= curve.proved[0]) & (curve.x <= curve.proved[1])
    # what is proved keeps its level: from below, or from above
    beyond = values[inside] - curve.level
    assert (beyond <= 1e-9).all() if strategy == "quadratic" else (beyond >= -1e-9).all()
    design.save(tmp_path / "design.json")
    assert write_report(str(tmp_path / "design.json"), str(tmp_path / "out.html"))


@pytest.mark.parametrize(("dwell", "words"), [(None, ()), ([2.0, 6.0], ("dwell times [2, 6]",))])
def test_the_plant_of_a_page_is_that_of_the_design(
    dwell: list[float] | None, words: tuple[str, ...], tmp_path: Path
) -> None:
    body = spring((2.0, -1.0)) | ({"jump": {"dwell_time": dwell}} if dwell else {})
    design = designed(body)
    source, output = tmp_path / "design.json", tmp_path / "page.html"
    design.save(source)
    write_report(str(source), str(output))
    text = " ".join(Page(output.read_text("utf-8")).words)
    assert "1 parameter (stiffness)" in text
    # twice: with the box of the state for the bound of the error, and without it
    assert text.count("Assumed: stiffness in [0.8, 1.2]") == 2
    assert all(word in text for word in words)
    assert dwell or "system with jumps" not in text


def test_text_of_a_design_is_never_markup(tmp_path: Path) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml").to_dict()
    body["name"] = "<script>alert('x')</script> & sons"
    source, out = tmp_path / "design.json", tmp_path / "report.html"
    designed(body).save(source)
    write_report(str(source), str(out))
    text = out.read_text("utf-8")
    assert "<script" not in text
    assert html.escape("<script>", quote=False) in text
    assert "& sons" in Page(text).text


def test_a_false_design_gets_no_page(academic_design: Path, tmp_path: Path) -> None:
    body = json.loads(academic_design.read_text("utf-8"))
    body["gains"]["L"][1][0] = -3.0  # A - L C is no longer stable
    source, out = tmp_path / "false.json", tmp_path / "report.html"
    body["digest"] = digest(body)
    source.write_text(json.dumps(body))
    done = CliRunner().invoke(cli, ["report", str(source), "-o", str(out)], standalone_mode=False)
    assert done.return_value == 1
    assert "nothing written" in done.output
    assert not out.exists()


def test_an_open_claim_is_shouted(tmp_path: Path) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "sampled_data.toml").to_dict()
    body["observer"]["memory"] = 0  # a common P does not reach so far
    design = designed(body, allow_undecided=True)
    source, out = tmp_path / "design.json", tmp_path / "report.html"
    design.save(source)
    done = CliRunner().invoke(cli, ["report", str(source), "-o", str(out)], standalone_mode=False)
    assert done.return_value == 3
    assert 'class="verdict undecided"' in out.read_text("utf-8")


def test_data_is_used_and_starts_as_told(academic_design: Path, tmp_path: Path) -> None:
    data, out = tmp_path / "data.csv", tmp_path / "report.html"
    data.write_text("t,y1,jump\n0,1,0\n0.5,0.7,0\n1,0.5,0\n")
    base = ["report", str(academic_design), "--data", str(data), "-o", str(out)]
    done = CliRunner().invoke(cli, [*base, "--initial", "0,2,0,2"], standalone_mode=False)
    assert done.return_value == 0
    text = Page(out.read_text("utf-8")).text
    assert "3 rows of data.csv: 3 ok." in text
    assert "Kalman filter" not in text  # nobody knows the truth here
    out.unlink()
    done = CliRunner().invoke(cli, base, standalone_mode=False)
    assert "--initial" in str(done.exception)  # bounds have no default
    assert not out.exists()


@pytest.mark.parametrize("example", ["degue_4_1", "degue_4_3", "sampled_data"])
def test_growth_is_below_one_on_what_is_proved(example: str) -> None:
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / f"{example}.toml"))
    curve = curve_of(design)
    assert curve is not None
    assert curve.proved is not None
    inside = (curve.x >= curve.proved[0]) & (curve.x <= curve.proved[1])
    assert inside.sum() > 10
    for values in curve.series.values():
        assert (values[inside] < 1).all()
    assert max(values.max() for values in curve.series.values()) > 1  # and not far beyond it
    # what a common P says bounds what constant dwell times do
    if len(curve.series) == 2:
        constant, worst = curve.series.values()
        assert (constant <= worst * (1 + 1e-9)).all()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here: the page is not seen in a browser")
@pytest.mark.parametrize("width", [390, 1100])
def test_a_browser_shows_it_without_sideways_scrolling(width: int, tmp_path: Path) -> None:
    source, out = tmp_path / "design.json", tmp_path / "report.html"
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "gantry_crane.toml"))
    design.save(source)
    write_report(str(source), str(out))
    # a frame as wide as a phone: a browser window cannot be so narrow
    asks = (
        "onload=\"const d=this.contentDocument,i=[...d.images];document.title=['scroll',"
        "d.documentElement.scrollWidth,'images',i.filter(x=>x.naturalWidth>100).length].join(' ')\""
    )
    frame = tmp_path / "frame.html"
    frame.write_text(f'<title></title><iframe src="report.html" width="{width}" {asks}></iframe>')
    done = subprocess.run(
        [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
         "--allow-file-access-from-files", "--virtual-time-budget=5000", frame.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    sizes = re.search(r"<title>scroll (\d+) images (\d+)</title>", done.stdout)
    assert sizes, done.stdout[:500]
    assert int(sizes[1]) <= width
    assert int(sizes[2]) == 2
