"""Random mutants, for run.py.

`cargo mutants --list --json` gives the places of its operators. Four operators are added: a
constant or a number is doubled, `<` and `<=` (`>` and `>=`) are exchanged, and a statement is left
out. A drawn mutant is a copy of the whole function body with one change. So any operator can stand
behind a run-time switch.
"""

import json
import random
import re
import subprocess
import sys

FOLDERS = (
    "shared/src/",
    "shared/control/src/",
    "shared/bus/src/",
    "shared/plant/src/",
    "firmware/src/",
    "host/scene/src/",
    "host/src/simulate/",
    "host/src/verbs/simulate",
)
CODE = re.compile(r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])'", re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])(?:\d[\d_]*\.\d+(?:e-?\d+)?|[1-9]\d*)(?:_?[fiu]\d+)?(?![\w.(])")
CONSTANT = re.compile(r"(?<![\w:.])[A-Z][A-Z0-9_]{2,}(?![\w:!(<])")
COMPARISON = re.compile(r" (<=|>=|<|>) ")
STATEMENT = re.compile(
    r"(?<=[;{}]\n) +(?:[\w.*\[\]]+ [-+*/|&^]?= [^;{}\n]*|[\w.:]+\([^;{}\n]*\));\n"
)
SWAPPED = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}


def line_starts(text):
    """Offset of the start of each line in the text."""
    return [0, *(found.end() for found in re.finditer("\n", text))]


def offset(starts, place):
    """Offset of a line and a column, both from 1, in the text; the column counts characters."""
    return starts[place["line"] - 1] + place["column"] - 1


def blank(text):
    """The text with its comments and strings as spaces: the same offsets, code alone."""
    return CODE.sub(lambda found: re.sub(r"[^\n]", " ", found.group()), text)


def body_of(code, start, end):
    """Offsets of a function's body; None if a run-time switch is impossible there."""
    head = re.compile(r"\bfn\b").search(code, start, end)
    if not head or re.search(r"\bconst\s+(?:unsafe\s+)?$", code[start : head.start()]):
        return None
    depth = 0
    for at in range(head.end(), end):
        if code[at] in "([":
            depth += 1
        elif code[at] in ")]":
            depth -= 1
        elif code[at] == "{" and depth == 0:
            if (
                "impl " in code[head.start() : at].split("->")[-1]
                and "->" in code[head.start() : at]
            ):
                return None
            return at + 1, code.rindex("}", at, end)
    return None


def listed(root):
    """The mutants listed by cargo-mutants."""
    command = [
        "cargo",
        "mutants",
        "--list",
        "--json",
        "--no-config",
        "--colors=never",
        *(
            f"--package={name}"
            for name in (
                "kband",
                "kband-control",
                "kband-bus",
                "kband-plant",
                "kband-firmware",
                "kband-scene",
                "kband-host",
            )
        ),
    ]
    ran = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    if ran.returncode:
        sys.exit("cargo mutants cannot list: cargo install --locked cargo-mutants")
    return [
        each
        for each in json.loads(ran.stdout)
        if each["file"].startswith(FOLDERS) and each.get("function")
    ]


def added(text, code, body):
    """Changes of this body by the added operators: start, end and new text."""
    start, end = body
    for pattern in (NUMBER, CONSTANT):
        for found in pattern.finditer(code, start, end):
            same = text[found.start() : found.end()]
            if re.fullmatch(r"[0._]+(?:_?f\d+)?", same):
                continue
            yield found.start(), found.end(), f"({same} + {same})"
    for found in COMPARISON.finditer(code, start, end):
        yield found.start(1), found.end(1), SWAPPED[found.group(1)]
    for found in STATEMENT.finditer(code, start, end):
        yield found.start(), found.end() - 1, ""


def all_of(root):
    """Every mutant that can be drawn: file, body, and start, end and text of its change."""
    texts, functions, found = {}, {}, set()
    for each in listed(root):
        path = each["file"]
        if path not in texts:
            text = (root / path).read_text()
            texts[path] = text, blank(text), line_starts(text)
        text, code, starts = texts[path]
        span = each["function"]["span"]
        place = path, offset(starts, span["start"]), offset(starts, span["end"])
        if place not in functions:
            functions[place] = body_of(code, *place[1:])
        body = functions[place]
        if body is None:
            continue
        start, end = offset(starts, each["span"]["start"]), offset(starts, each["span"]["end"])
        replacement = each["replacement"]
        if each["genre"] == "FnValue":
            (start, end) = body
        if body[0] <= start <= end <= body[1]:
            found.add((path, body, start, end, replacement))
    for (path, *_), body in functions.items():
        if body is not None:
            found.update((path, body, *change) for change in added(*texts[path][:2], body))
    return sorted(found), {path: text for path, (text, *_) in texts.items()}


def draw(root, count, seed):
    """`count` mutants: number, path, body, start, end and text of the change, label."""
    pool, texts = all_of(root)
    print(f"mutants: {len(pool)} can be drawn; {count} of seed {seed}", flush=True)
    random.Random(seed).shuffle(pool)
    chosen, bodies = [], {}
    for path, body, start, end, becomes in pool:
        if len(chosen) == count:
            break
        # A body inside another one cannot have its own switch.
        near = bodies.setdefault(path, set())
        if any(other != body and other[0] < body[1] and body[0] < other[1] for other in near):
            continue
        near.add(body)
        text = texts[path]
        line = text.count("\n", 0, start) + 1
        was = " ".join(text[start:end].split())
        shown = f"{path}:{line} [{was[:60]} -> {becomes[:60] or 'nothing'}]"
        chosen.append((len(chosen) + 1, path, body, start, end, becomes, shown))
    return chosen


def mutated(text, found, module):
    """The text with each mutant behind the switch, and the mutants of each range of lines."""
    lines, bodies = [], {}
    for mutant in found:
        bodies.setdefault(mutant[2], []).append(mutant)
    result, at = "", 0
    for (start, end), mutants in sorted(bodies.items()):
        result += text[at:start]
        for number, _, _, begin, finish, becomes, _ in mutants:
            first = result.count("\n") + 1
            result += f"if {module}::mutation::is({number}) {{ {text[start:begin]}{becomes}{text[finish:end]} }} else "
            lines.append((first, result.count("\n") + 1, [number]))
        first = result.count("\n") + 1
        result += f"{{ {text[start:end]} }}"
        lines.append((first, result.count("\n") + 1, [mutant[0] for mutant in mutants]))
        at = end
    return result + text[at:], lines
