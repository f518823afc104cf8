"""Writes the tables of validation/results/README.md from the results.

python3 table.py RESULTS PAGE
"""

import math
import pathlib
import re
import sys
from collections import Counter

import kband
import numpy as np
import rows
from feeder import mean
from results import read

GEAR = "| row | runs | share: predicted | own plant | engine | estimated | error, rms |"
GEAR += " speed | closed form | R | s | contact | READY | ends |"
TUMBLING = "| row | runs | share: engine | estimated | k | speed in mm/s | R | s | READY | ends |"
FRICTION = "| row | runs | k | R | speed in the engine | own plant | theory |"
LOAD = "| row | runs | mass in g | weighed | own plant | flow in g/s | estimated | own plant |"
LOAD += " amplitude | its rms | as measured | READY | ends |"


def column(found: list[dict], name: str) -> np.ndarray:
    """Finite numbers of a column."""
    values = [
        row[name] for row in found if isinstance(row[name], float) and math.isfinite(row[name])
    ]
    return np.array(values)


def shown(values: np.ndarray, digits: int) -> str:
    """Mean of a column with its standard error, where there are several runs."""
    if len(values) == 0:
        return "-"
    text = f"{values.mean():.{digits}f}"
    if len(values) > 2 and digits == 3:
        text += f" ({values.std(ddof=1) / math.sqrt(len(values)):.3f})"
    return text


def percent(value: float) -> str:
    """A ratio less one in percent."""
    return "-" if math.isnan(value) else f"{100.0 * (value - 1.0):+.1f} %"


def ratio(found: list[dict], above: str, below: str) -> float:
    """Ratio of the means of two columns."""
    a, b = column(found, above), column(found, below)
    return float(a.mean() / b.mean()) if len(a) and len(b) else math.nan


def ends(found: list[dict]) -> str:
    """States or faults in which the runs end."""
    counts = Counter(row["state"] for row in found)
    return ", ".join(f"{count} {state}" for state, count in counts.most_common())


def gear_row(name: str, found: list[dict], own: list[dict]) -> str:
    errors = [row["estimated_share"] - row["engine_share"] for row in found]
    errors = [error for error in errors if isinstance(error, float) and math.isfinite(error)]
    error = (
        "-" if not errors else f"{np.mean(errors):+.3f}, {np.sqrt(np.mean(np.square(errors))):.3f}"
    )
    share = column(found, "engine_share")
    predicted = column(found, "predicted_share")
    predicted = predicted[predicted > 0.0]
    cells = [
        name,
        str(len(found)),
        shown(predicted, 2),
        shown(column(own, "engine_share"), 2),
        shown(share, 3),
        shown(column(found, "estimated_share"), 2),
        error,
        shown(column(found, "speed"), 1),
        shown(column(found, "lock_speed"), 1) if len(share) and share.mean() > 0.9 else "-",
        shown(column(found, "restitution"), 2),
        shown(column(found, "scatter"), 2),
        f"{100.0 * column(found, 'contact').mean():.1f} %"
        if len(column(found, "contact"))
        else "-",
        shown(column(found, "ready"), 2),
        ends(found),
    ]
    return "| " + " | ".join(cells) + " |"


ROLLED_OFF = -1000.0
"""Mean speed in mm/s below which a part has rolled off the track and falls."""


def tumbling_row(name: str, found: list[dict], own: list[dict]) -> str:
    speed = column(found, "speed")
    cells = [
        name,
        str(len(found)),
        shown(column(found, "engine_share"), 2),
        shown(column(found, "estimated_share"), 2),
        shown(column(found, "k"), 2),
        "rolled off" if speed.mean() < ROLLED_OFF else shown(speed, 1),
        shown(column(found, "restitution"), 2),
        shown(column(found, "scatter"), 2),
        shown(column(found, "ready"), 2),
        ends(found),
    ]
    return "| " + " | ".join(cells) + " |"


def friction_row(name: str, found: list[dict], own: list[dict]) -> str:
    run = next(run for _, run in rows.settings("f") if run.name == name)
    _, e, degrees = run.target["tones"]
    k, restitution = column(found, "k").mean(), run.restitution
    theory = kband.transport(
        k, restitution, friction=run.friction, tones=[(e, math.radians(degrees))]
    )
    cells = [
        name,
        str(len(found)),
        f"{k:.3f}",
        f"{restitution:g}",
        f"{column(found, 'speed').mean():.1f} mm/s",
        f"{column(own, 'speed').mean():.1f}",
        f"{1e3 * float(theory.speed):.1f}",
    ]
    return "| " + " | ".join(cells) + " |"


def load_row(name: str, found: list[dict], own: list[dict]) -> str:
    held = [row for row in found if row["state"] == "holding"]
    cells = [
        name,
        str(len(found)),
        shown(column(found, "mass"), 2),
        percent(ratio(found, "estimated_mass", "mass")),
        percent(ratio(own, "estimated_mass", "mass")),
        shown(column(held, "flow"), 2),
        percent(ratio(found, "estimated_flow", "flow")),
        percent(ratio(own, "estimated_flow", "flow")),
        percent(mean(column(held, "amplitude"))),
        f"{100.0 * mean(column(held, 'amplitude_rms')):.2f} %" if held else "-",
        percent(mean(column(held, "estimated_amplitude"))),
        shown(column(found, "ready"), 2),
        ends(found),
    ]
    return "| " + " | ".join(cells) + " |"


def table(row: str, found: list[dict]) -> str:
    """The table of a row of the validation."""
    make, head = {
        "c": (tumbling_row, TUMBLING),
        "f": (friction_row, FRICTION),
        "e": (load_row, LOAD),
    }.get(row, (gear_row, GEAR))
    names = dict.fromkeys((one["engine"], one["row"]) for one in found if one["engine"] != "kband")
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for engine, name in names:
        own = [one for one in found if one["engine"] == "kband" and one["row"] == name]
        own = list({one["seed"]: one for one in own}.values())
        there = [one for one in found if one["engine"] == engine and one["row"] == name]
        line = make(name, there, own)
        lines.append(
            line.replace(f"| {row}: ", "| " + (f"{engine}: " if engine != "YADE" else ""), 1)
        )
    return "\n".join(lines)


def main() -> None:
    results, page = (pathlib.Path(name) for name in sys.argv[1:3])
    text = page.read_text(encoding="utf-8")
    for row in rows.ROWS:
        path = results / f"{row}.csv"
        if path.exists():
            begin, end = f"<!-- engines: {row} -->", f"<!-- end: {row} -->"
            text = re.sub(
                f"{begin}.*?{end}",
                lambda _: f"{begin}\n{table(row, read(str(path)))}\n{end}",
                text,
                flags=re.DOTALL,
            )
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
