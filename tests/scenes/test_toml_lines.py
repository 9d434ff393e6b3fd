from __future__ import annotations

import tomllib

import pytest

from scenes.language.toml import key_lines, line_of

TEXT = '''\
# a comment with [brackets] and key = 1
title = "x" # [not.a.header]

[run]
duration_s = 10.0
"quoted key" = 1
note = """
[gait]
period_s = 3
quote: "" and \\""" not the end
"""
raw = \'\'\'
[worm]
\'\'\'
list = [
  1, # ] in a comment
  "]", [2,
  3],
]
inline = { a = 1, b = { c = "}" } }
after.dotted . 'key' = true
[ worm . "head part" ]
mass_kg = 1
[[obstacle]]
radius_m = 1
[obstacle.shape]
kind = "disc"
[[obstacle]]

radius_m = 2
[obstacle.shape]
kind = "box"
[[obstacle.hole]]
x = 1
[[obstacle.hole]]
x = 2
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("title",), 2),
        (("run",), 4),
        (("run", "duration_s"), 5),
        (("run", "quoted key"), 6),
        (("run", "note"), 7),
        (("run", "raw"), 12),
        (("run", "list"), 15),
        (("run", "list", 1), 15),
        (("run", "inline", "b", "c"), 20),
        (("run", "after", "dotted", "key"), 21),
        (("worm",), 22),
        (("worm", "head part", "mass_kg"), 23),
        (("obstacle",), 24),
        (("obstacle", 0), 24),
        (("obstacle", 0, "radius_m"), 25),
        (("obstacle", 0, "shape", "kind"), 27),
        (("obstacle", 1), 28),
        (("obstacle", 1, "radius_m"), 30),
        (("obstacle", 1, "shape", "kind"), 32),
        (("obstacle", 1, "hole", 1, "x"), 36),
        (("run", "missing_key"), 4),
        (("nothing", "like", "it"), 1),
    ],
)
def test_each_key_is_found_where_it_stands(path: tuple[str | int, ...], line: int) -> None:
    tomllib.loads(TEXT)  # the scanner trusts the syntax
    assert line_of(key_lines(TEXT), path) == line


def test_text_inside_strings_is_no_key() -> None:
    lines = key_lines(TEXT)
    assert ("gait",) not in lines
    assert ("run", "note", "period_s") not in lines


def test_windows_line_ends_count_once() -> None:
    lines = key_lines("a = 1\r\n\r\n[b]\r\nc = 2\r\n")
    assert lines == {("a",): 1, ("b",): 3, ("b", "c"): 4}


def test_a_header_counts_more_than_a_longer_one_before_it() -> None:
    assert key_lines("[a.b]\nx = 1\n[a]\ny = 2\n")[("a",)] == 3


def test_strings_may_end_in_quotes() -> None:
    assert key_lines("a = \"\"\"x\"\"\"\"\"\nb = '''y'''''\nc = 1\n")[("c",)] == 3
