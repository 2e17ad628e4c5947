"""What the page shows, and the page itself in a browser where there is one."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from obsdesign import load_problem
from obsdesign.explore.answer import answer, beside, brackets
from obsdesign.explore.settings import save, with_values
from obsdesign.problem.problem import load_for_kind

PNG = b"\x89PNG"


def test_numbers_and_a_picture_of_a_proved_problem() -> None:
    shown = answer(load_problem("examples/degue_4_2.toml"))
    assert "PROVED" in shown.html
    assert "guaranteed" in shown.html
    assert shown.picture is not None
    assert shown.picture.startswith(PNG)


def test_a_refuted_problem_says_so_and_has_no_picture() -> None:
    problem = load_problem("examples/degue_4_1.toml")
    shown = answer(with_values(problem, {"jump.dwell_time[0]": 0.5}))
    assert "REFUTED" in shown.html
    assert "dwell_stability is refuted" in shown.html
    assert shown.picture is None


def test_a_refusal_is_a_line() -> None:
    problem = load_problem("examples/degue_4_1.toml")
    without = {**problem.to_dict(), "output": {"C": [[0.0, 1.0]]}}
    shown = answer(type(problem).from_dict(without))
    assert "refused: " in shown.html
    assert "noise_bound" in shown.html


def test_brackets_are_inequalities() -> None:
    text = brackets(load_problem("examples/degue_4_1.toml"))
    assert "refuted &lt; limit ≤" in text
    assert "shortest dwell" in text
    assert brackets(load_problem("examples/quarter_car.toml")).count("<tr>") == 0


def test_names_of_a_problem_are_text() -> None:
    problem = load_problem("examples/degue_4_2.toml")
    named = {**problem.to_dict(), "names": {"states": ["<b>height</b>", "speed"]}}
    assert "<b>" not in answer(type(problem).from_dict(named)).html


def test_sliders_stand_beside_what_they_lead_to() -> None:
    assert '<div class="beside"><div>a</div><div>b</div></div>' in beside("a", "b")


@contextmanager
def page(problem: str) -> Iterator[str]:
    """The address of the page of a problem."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "obsdesign",
        "explore",
        problem,
        "--headless",
        "--port",
        str(port),
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                          start_new_session=True) as running:  # fmt: skip
        address = f"http://127.0.0.1:{port}"
        try:
            for _ in range(600):
                try:
                    urllib.request.urlopen(address, timeout=5).close()
                    break
                except OSError:
                    time.sleep(0.1)
            yield address
        finally:
            os.killpg(running.pid, 15)


def test_a_slider_changes_the_answer_in_a_browser() -> None:
    browser = shutil.which("chromium")
    playwright = pytest.importorskip("playwright.sync_api")
    if browser is None:
        pytest.skip("chromium is not installed")
    with page("examples/degue_4_1.toml") as address, playwright.sync_playwright() as driver:
        shown = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"]).new_page()
        shown.goto(address)
        shown.wait_for_selector("text=PROVED", timeout=60_000)
        slider = shown.locator("[role=slider]").first
        slider.focus()
        for _ in range(5):  # the shortest dwell time, .7, falls below the limit of .6934
            slider.press("ArrowLeft")
        shown.wait_for_selector("text=dwell_stability is refuted", timeout=60_000)
        assert "shortest dwell" in shown.content()


def test_every_cell_of_the_page_runs() -> None:
    command = [
        sys.executable,
        "obsdesign/explore/page.py",
        "--",
        "--problem",
        "examples/degue_4_2.toml",
    ]
    subprocess.run(command, check=True, capture_output=True)


def test_a_problem_is_read_before_a_page_is_opened() -> None:
    command = [sys.executable, "-m", "obsdesign", "explore", "absent.toml"]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 2
    assert outcome.stderr.startswith("obsdesign: absent.toml")


def test_another_kind_is_explored_and_saved(tmp_path: Path) -> None:
    source, target = "examples/degue_4_2.toml", str(tmp_path / "saved.toml")
    problem = load_for_kind(source, "set_membership")[0]
    save(problem, {"output.noise_bound[0]": 0.1}, source, target)
    assert load_problem(target).kind == "set_membership"
    command = [
        sys.executable,
        "obsdesign/explore/page.py",
        "--",
        "--problem",
        source,
        "--kind",
        "luenberger",
    ]
    subprocess.run(command, check=True, capture_output=True)
