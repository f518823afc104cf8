"""Results of runs as CSV files."""

import csv
import os

from feeder import COLUMNS


def write(path: str, rows: list[dict]) -> None:
    """Adds rows to a file; its first row names the columns."""
    fresh = not os.path.exists(path)
    with open(path, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerows({name: shown(row.get(name)) for name in COLUMNS} for row in rows)


def shown(value: object) -> object:
    """A number with five digits."""
    return f"{value:.5g}" if isinstance(value, float) else value


def read(path: str) -> list[dict]:
    """Rows of a file, numbers as such."""
    with open(path, newline="", encoding="utf-8") as file:
        return [
            {name: number(value) for name, value in row.items()} for row in csv.DictReader(file)
        ]


def number(text: str) -> object:
    """A number where the text is one."""
    try:
        return float(text)
    except ValueError:
        return text
