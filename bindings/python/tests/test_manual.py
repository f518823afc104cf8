"""The page of the manual: its programs run and print what it shows."""

import contextlib
import io
import re
from pathlib import Path

PAGE = (Path(__file__).parents[3] / "docs/python.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_programs_print_what_the_page_shows() -> None:
    programs, shown = blocks("python"), blocks("text")
    assert len(programs) == len(shown) == 2
    for program, expected in zip(programs, shown, strict=True):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(program, "docs/python.md", "exec"), {})
        assert said.getvalue() == expected


def test_the_build_is_that_of_the_tests() -> None:
    build, install = blocks("sh")[0].splitlines()
    script = (Path(__file__).parents[1] / "test.sh").read_text(encoding="utf-8")
    assert build.replace(" --release", "").removesuffix(" --out wheels") in script
    assert install == "pip install wheels/kband-*.whl"
