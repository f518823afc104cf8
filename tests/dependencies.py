#!/usr/bin/env python3
"""Checks licences, duplicates and sources of all dependencies against tests/deny.toml, offline.

It reads the keys of cargo-deny that the file uses. Exit status 1, with one line per finding.
"""

import collections
import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[1]


class Licence:
    """Whether the allowed licences satisfy an SPDX expression."""

    def __init__(self, expression, allowed):
        # An exception (WITH) permits more than its licence, which decides here.
        plain = re.sub(r"\sWITH\s\S+", "", expression).replace("/", " OR ")
        self.words = re.findall(r"[()]|[^\s()]+", plain)
        self.allowed = allowed

    def any(self):
        met = self.all()
        while self.words[:1] == ["OR"]:
            self.words.pop(0)
            met |= self.all()
        return met

    def all(self):
        met = self.term()
        while self.words[:1] == ["AND"]:
            self.words.pop(0)
            met &= self.term()
        return met

    def term(self):
        word = self.words.pop(0)
        if word != "(":
            return word in self.allowed
        met = self.any()
        self.words.pop(0)
        return met


def findings(packages, rules):
    """One line for each package that violates the rules."""
    exceptions = {each["crate"]: each["allow"] for each in rules["licenses"].get("exceptions", [])}
    registries = {f"registry+{url}" for url in rules["sources"]["allow-registry"]}
    versions = collections.defaultdict(list)
    for package in packages:
        name = f"{package['name']}@{package['version'].partition('+')[0]}"
        versions[package["name"]].append(name)
        if package["source"] is None:
            continue
        if package["source"] not in registries:
            yield f"{name}: source {package['source']}; allowed: {', '.join(registries)}"
        licence = package["license"] or "none"
        allowed = rules["licenses"]["allow"] + exceptions.get(package["name"], [])
        if not Licence(licence, allowed).any():
            yield f"{name}: licence {licence} is not in [licenses] allow"
    skipped = {skip["crate"] for skip in rules["bans"]["skip"]}
    for names in versions.values():
        extra = [name for name in names if name not in skipped]
        if len(extra) > 1:
            yield f"{' and '.join(extra)}: two versions; update, or give the reason in [bans] skip"
    doubled = {name for names in versions.values() if len(names) > 1 for name in names}
    for name in sorted(exceptions.keys() - versions.keys()):
        yield f"{name}: there is no such package; remove it from [licenses] exceptions"
    for name in sorted(skipped - doubled):
        yield f"{name}: it has no second version; remove it from [bans] skip"


def main():
    command = ["cargo", "metadata", "--locked", "--format-version=1"]
    metadata = json.loads(
        subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
    )
    rules = tomllib.loads((ROOT / "tests/deny.toml").read_text())
    found = list(findings(metadata["packages"], rules))
    print(*found, sep="\n", end="\n" if found else "")
    print(f"dependencies: {len(metadata['packages'])} packages, {len(found)} findings")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
