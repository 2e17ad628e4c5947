"""A ball that really bounces, watched by the interval observer of degue_4_2.toml.

The ball falls from 5 m under gravity and a force that stays within 0.5 m/s^2 of its mean; an impact
keeps 0.8 of the speed, give or take 0.5 m/s. Impacts happen where the height is zero: the instants
are computed, not scheduled. They pile up at the Zeno time, so the record ends before it, when a
flight gets shorter than two samples.

    python examples/bouncing_ball.py [FOLDER]        writes ball.csv, ball_est.csv, ball.png
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

import obsdesign
from obsdesign.data.csv_text import table_text
from obsdesign.pages.plotting.estimate import plot_estimate
from obsdesign.runtime import from_design

PROBLEM = Path(__file__).parent / "degue_4_2.toml"
SAMPLE, HEIGHT = 0.02, 5.0
MEAN, FORCE, KICK, KEPT = -9.81, 0.5, 0.5, 0.8


def flight(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """(t, height, velocity, impact): the state after the row's impact, until flights get short.

    Between rows the force is constant, so that the path is a parabola and its zero is exact.
    """
    t, p, v, since, rows = 0.0, HEIGHT, 0.0, 0.0, [(0.0, HEIGHT, 0.0, 0)]
    k = 0
    while True:
        a = MEAN + FORCE * rng.uniform(-1, 1)
        room = (k + 1) * SAMPLE - t
        end = p + v * room + a * room**2 / 2
        if end > 0:
            k += 1
            p, v, t = end, v + a * room, round(k * SAMPLE, 6)
            rows.append((t, p, v, 0))
            continue
        fall = (-v - math.sqrt(v**2 - 2 * a * p)) / a  # the root ahead: a < 0
        speed = v + a * fall
        t += fall
        if t - since < 2 * SAMPLE and since > 0:
            break
        p, v, since = 0.0, max(-KEPT * speed + KICK * rng.uniform(-1, 1), 0.0), t
        if v < abs(a) * SAMPLE:
            break
        rows.append((t, 0.0, v, 1))
        if t >= (k + 1) * SAMPLE:
            k += 1
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def main(folder: str = ".") -> None:
    """Simulate, run the proved observer, write the data and the picture."""
    t, p, v, impact = flight(np.random.default_rng(4))
    design = obsdesign.design(obsdesign.load_problem(PROBLEM))
    # before an impact the height that was measured is zero, after it is the same: p is continuous
    batch = from_design(design).run_batch(
        t, p[:, None], jump=impact, lower=[HEIGHT - 0.5, -1.0], upper=[HEIGHT + 0.5, 1.0]
    )
    inside = np.all((batch.lower[:, 0] <= p) & (p <= batch.upper[:, 0]))
    inside &= np.all((batch.lower[:, 1] <= v) & (v <= batch.upper[:, 1]))
    home = Path(folder)
    data, estimate = home / "ball.csv", home / "ball_est.csv"
    data.write_text(table_text({"t": t, "y1": p, "jump": impact, "x1": p, "x2": v}))
    bounds = {
        f"x{i + 1}_{end}": values[:, i]
        for i in range(2)
        for end, values in (("lo", batch.lower), ("hi", batch.upper))
    }
    text = table_text({"t": t, **bounds}).splitlines()
    status = ["status", *batch.status]
    lines = [f"{line},{word}" for line, word in zip(text, status, strict=True)]
    estimate.write_text("\n".join(lines) + "\n")
    plot_estimate(str(estimate), str(data), str(home / "ball.png"))
    width = (batch.upper - batch.lower)[-1]
    assert set(batch.status) == {"ok"}
    print(f"{int(impact.sum())} impacts until {t[-1]:.3f} s; inside the bounds: {bool(inside)}; "
          f"last widths {width[0]:.3f} m, {width[1]:.3f} m/s")  # fmt: skip


if __name__ == "__main__":
    main(*sys.argv[1:])
