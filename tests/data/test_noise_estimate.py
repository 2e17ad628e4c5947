"""Noise of a record: found whatever units and offsets, not found where the signal is rough."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lmi.arithmetic.arrays import Matrix
from obsdesign.cli.commands import cli
from obsdesign.data.csv_text import table_text
from obsdesign.data.noise_estimate import NoiseEstimate, estimate_noise
from obsdesign.errors import InputError

T = np.round(0.05 * np.arange(600), 10)
SIGNAL = np.sin(T) + 0.3 * np.cos(2.3 * T)


def noise_of(folder: Path, y: Matrix, t: Matrix = T, **columns: Matrix) -> NoiseEstimate:
    path = folder / "data.csv"
    path.write_text(table_text({"t": t, "y1": y, **columns}))
    return estimate_noise(str(path))[0]


@pytest.mark.parametrize("std", [1e-3, 0.02, 0.1])
def test_gaussian_noise(std: float, tmp_path: Path) -> None:
    drawn = np.random.default_rng(1).standard_normal(len(T)) * std
    found = noise_of(tmp_path, SIGNAL + drawn)
    assert found.std == pytest.approx(std, rel=0.15)
    assert np.abs(drawn).max() * 0.8 < found.bound < 6 * std
    assert found.is_smooth
    assert found.cv == found.resolution == 0.0


def test_a_bound_of_uniform_noise_is_not_too_small(tmp_path: Path) -> None:
    for seed in range(5):
        drawn = np.random.default_rng(seed).uniform(-0.05, 0.05, len(T))
        assert 0.045 < noise_of(tmp_path, SIGNAL + drawn).bound < 0.12


def test_laws_of_units_time_and_offset(tmp_path: Path) -> None:
    y = SIGNAL + 0.02 * np.random.default_rng(3).standard_normal(len(T))
    own = noise_of(tmp_path, y)
    for scale, offset, pace in ((1e3, 0.0, 1.0), (1.0, 50.0, 1.0), (1.0, 0.0, 60.0)):
        other = noise_of(tmp_path, scale * y + offset, pace * T)
        assert other.std == pytest.approx(scale * own.std, rel=1e-6)
        assert other.bound == pytest.approx(scale * own.bound, rel=1e-6)


def test_jumps_that_are_marked_are_no_noise(tmp_path: Path) -> None:
    drawn = 0.01 * np.random.default_rng(4).standard_normal(len(T))
    jump = (np.arange(len(T)) % 100 == 50).astype(int)
    y = SIGNAL + drawn + 2.0 * np.concatenate([[0], np.cumsum(jump)[:-1]])
    marked, silent = noise_of(tmp_path, y, jump=jump), noise_of(tmp_path, y)
    assert marked.bound < 0.06 < 0.5 < silent.bound


def test_gaps_and_irregular_samples(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    keep = rng.random(len(T)) > 0.3
    keep[200:260] = False
    drawn = 0.02 * rng.standard_normal(len(T))
    y = np.where(keep, SIGNAL + drawn, np.nan)
    assert noise_of(tmp_path, y).std == pytest.approx(0.02, rel=0.25)


def test_noise_that_grows_with_the_signal(tmp_path: Path) -> None:
    level = 5 + 4.9 * np.sin(0.3 * T)
    drawn = 0.03 * level * np.random.default_rng(6).standard_normal(len(T))
    found = noise_of(tmp_path, level + drawn)
    assert found.cv == pytest.approx(0.03, rel=0.2)


def test_a_quantised_signal_has_at_least_half_a_step(tmp_path: Path) -> None:
    found = noise_of(tmp_path, np.round(0.2 * SIGNAL / 0.05) * 0.05)
    assert found.resolution == pytest.approx(0.05)
    assert found.bound >= 0.025


def test_a_signal_that_is_too_fast_is_said(tmp_path: Path) -> None:
    assert not noise_of(tmp_path, np.sin(0.05 * 2 * np.pi * np.arange(len(T)) * 2.2)).is_smooth


def test_the_command_says_what_to_write_and_what_it_rests_on(tmp_path: Path) -> None:
    y = SIGNAL + 0.02 * np.random.default_rng(7).standard_normal(len(T))
    path = tmp_path / "data.csv"
    path.write_text(table_text({"t": T, "gauge": y}))
    words = ["noise", str(path), "--rename", "gauge=y1"]
    shown = CliRunner().invoke(cli, words, standalone_mode=False).output
    assert "[output]\nnoise_bound = [0." in shown
    assert "Estimated from this record" in shown
    answer = CliRunner().invoke(cli, [*words, "--json"], standalone_mode=False).output
    (entry,) = json.loads(answer)["result"]
    assert entry["std"] == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,z\n0,1\n", "columns t and y1, ... are required; it has t, z."),
        ("t,y1\n0,1\n1,2\n", "at least 20 samples with 3 neighbours on each side are required"),
        ("t,y1\n0,a\n", "column 'y1' must hold numbers"),
    ],
)
def test_records_without_what_is_needed_are_refused(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        estimate_noise(str(path))
    assert message in str(refused.value)
