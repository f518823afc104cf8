#!/usr/bin/env python3
"""Keeps what the searches by coverage found: one file of few small inputs for each target.

    tests/fuzz/keep.py                          after tests/fuzz/run.sh
    tests/fuzz/keep.py --unpack TARGET FOLDER   the kept inputs as files, for a search to begin with

The first command selects inputs of target/fuzz/corpus that add to the branches reached, the
smallest first. It writes up to 50 000 bytes for each target to tests/fuzz/found/TARGET.

A file is its inputs one after another, each behind its length in two bytes (little-endian).
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOUND = ROOT / "tests/fuzz/found"
MOST = 50_000
TABLE = """# What searches by coverage found

Written by `tests/fuzz/keep.py`, from what `tests/fuzz/run.sh` left. Branches are those of a build without optimisation across crates.

| target | inputs kept | bytes | branches by the seeds | with the kept ones | with all that were found | found |
|---|---|---|---|---|---|---|
"""


def unpacked(name):
    data = (FOUND / name).read_bytes() if (FOUND / name).is_file() else b""
    while data:
        length = int.from_bytes(data[:2], "little")
        yield data[2 : 2 + length]
        data = data[2 + length :]


def unpack(name, folder):
    for number, content in enumerate(unpacked(name)):
        (pathlib.Path(folder) / f"found_{number:04}").write_bytes(content)


def branches(program, name, *folders):
    """Number of branches that these inputs reach."""
    said = subprocess.run(
        [program, "-runs=0", *folders],
        env=dict(os.environ, KBAND_FUZZ=name),
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        check=True,
    ).stderr.decode(errors="replace")
    return max((int(count) for count in re.findall(r" cov: (\d+)", said)), default=0)


def keep(program, corpus, name):
    """Keeps the inputs found for one target."""
    seeds = [
        ROOT / "tests/fuzz/corpus" / name,
        *([ROOT / "tests/scenes"] if name == "scene" else []),
    ]
    with tempfile.TemporaryDirectory() as folder:
        merged, kept = pathlib.Path(folder) / "merged", pathlib.Path(folder) / "kept"
        merged.mkdir()
        kept.mkdir()
        subprocess.run(
            [program, "-merge=1", "-max_len=4096", merged, corpus / name, *seeds],
            check=True,
            env=dict(os.environ, KBAND_FUZZ=name),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        known = {file.read_bytes() for seed in seeds for file in seed.iterdir()}
        contents = {file.read_bytes() for file in merged.iterdir()} - known
        packed, number = b"", 0
        for content in sorted(contents, key=lambda content: (len(content), content)):
            if len(packed) + 2 + len(content) > MOST:
                break
            packed += len(content).to_bytes(2, "little") + content
            number += 1
        FOUND.mkdir(exist_ok=True)
        (FOUND / name).write_bytes(packed)
        unpack(name, kept)
        reached = [
            branches(program, name, *folders)
            for folders in (seeds, [kept, *seeds], [corpus / name, *seeds])
        ]
    everything = sum(1 for _ in (corpus / name).iterdir())
    row = f"| {name} | {number} | {len(packed)} | {reached[0]} | {reached[1]} | {reached[2]} | {everything} |"
    print(row, flush=True)
    return row


def main():
    asked = sys.argv[1:]
    if asked[:1] == ["--unpack"] and len(asked) == 3:
        unpack(*asked[1:])
        return
    folder = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "fuzz"
    programs = sorted(folder.glob("*/release/fuzz"))
    if asked or not programs:
        sys.exit(__doc__ if asked else f"no program in {folder}: tests/fuzz/run.sh builds it")
    rows = [
        keep(programs[0], folder / "corpus", corpus.name)
        for corpus in sorted((folder / "corpus").iterdir())
    ]
    (FOUND / "README.md").write_text(TABLE + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
