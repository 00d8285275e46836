"""Line of each key of a TOML document: tomllib reads values and forgets lines.

The scanner reads any text, valid TOML or not, in one pass. What it cannot read it leaves to tomllib, which
says what is wrong. It also guards tomllib against what costs it the square of the length or the interpreter's
stack, long dotted keys and nesting, and everything behind it against thousands of small values.
"""

from __future__ import annotations

import contextlib
import re
from bisect import bisect_left

from mission.common.problems import Path

MAX_DEPTH = 8  # a mission needs 5: forest.trees[0].base_enu_m[0]
MAX_ENTRIES = 5_000  # a mission with all the trees it may have; keeps hostile files below about 65 ms

# Atomic groups where possessive ones would be shorter: those of what may backtrack itself match too little before
# Python 3.11.5, and Debian 12 has 3.11.2.
_BLANK_PATTERN = r"(?>(?:[ \t\r\n]++|#[^\n]*+)*)"  # with comments and newlines
_BLANK = re.compile(_BLANK_PATTERN)
_END_OF_LINE = re.compile(r"[ \t]*+(?>(?:#[^\n]*+)?)(?:\r?\n|\Z)" + _BLANK_PATTERN)
_KEY_PART = re.compile(
    r"""[ \t]*+ (?: ([A-Za-z0-9_-]++) | "((?>(?:[^"\\\n]++|\\[^\n])*))" | '([^'\n]*+)' ) [ \t]*+ (\.?+)""",
    re.VERBOSE,
)
_EQUALS = re.compile(r"=[ \t]*+")
_COMMA = re.compile(f"{_BLANK_PATTERN}(,?+){_BLANK_PATTERN}")
# A multi-line string may end in one or two quotes of its own before the three that close it. Numbers,
# booleans and dates come last: they are what is left (the parts of a date may have a space between them).
_ATOM = re.compile(
    r'''
    """ (?> (?: [^"\\]++ | \\[\s\S] | "{1,2}+(?!") )* ) """ "{0,2}+
    | \'\'\' (?> (?: [^']++ | '{1,2}+(?!') )* ) \'\'\' '{0,2}+
    | " (?> (?: [^"\\\n]++ | \\[^\n] )* ) "
    | ' [^'\n]*+ '
    | [^,\[\]{}"'\#\n]++
    ''',
    re.VERBOSE,
)
_ESCAPE = re.compile(r"\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|(.))")
_SHORT_ESCAPES = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", '"': '"', "\\": "\\"}


class TooMuchError(Exception):
    """At `line` the document is nested beyond MAX_DEPTH or holds more than MAX_ENTRIES."""

    def __init__(self, line: int, message: str) -> None:
        self.line = line
        super().__init__(message)


class _NotTomlError(Exception):
    """The scanner cannot read on."""


def locate(text: str) -> dict[Path, int]:
    """The line (from 1) of every table, key and array item in `text`, up to the first thing that is not TOML.

    A table stands at its header or where it is first mentioned, a key at its name, an item at its start.
    TooMuchError beyond MAX_DEPTH or MAX_ENTRIES.
    """
    scanner = _Scanner(text)
    with contextlib.suppress(_NotTomlError):
        scanner.document()
    return scanner.lines


class _Scanner:
    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self._text = text
        self._pos = 0
        self._newlines = [match.start() for match in re.finditer("\n", text)]
        self._last_items: dict[Path, int] = {}  # of each array of tables, the index of its latest table
        self._entries = 0

    def document(self) -> None:
        table: Path = ()
        self._expect(_BLANK)
        while self._pos < len(self._text):
            line = self._line()
            if self._accept("[["):
                table = self._open_item(self._key(), line)
                self._require("]]")
            elif self._accept("["):
                table = self._mention((), self._key(), line)
                self.lines[table] = line  # more to the point than an earlier mention, as in [a.b] before [a]
                self._require("]")
            else:
                self._pair(table)
            self._expect(_END_OF_LINE)

    # What stands where

    def _open_item(self, parts: list[str], line: int) -> Path:
        array: Path = (*self._mention((), parts[:-1], line), parts[-1])
        self.lines.setdefault(array, line)
        self._last_items[array] = self._last_items.get(array, -1) + 1
        item = (*array, self._last_items[array])
        self._record(item, line)
        return item

    def _mention(self, path: Path, parts: list[str], line: int) -> Path:
        """The path of the dotted key `parts` in the table `path`: an array of tables means its latest."""
        for part in parts:
            path = (*path, part)
            if path in self._last_items:
                path = (*path, self._last_items[path])
            if path not in self.lines:
                self._record(path, line)
        return path

    def _record(self, path: Path, line: int) -> None:
        self.lines[path] = line
        self._entries += 1
        if len(path) > MAX_DEPTH:
            raise TooMuchError(line, f"nested too deep: at most {MAX_DEPTH} levels")
        if self._entries > MAX_ENTRIES:
            raise TooMuchError(line, f"holds too many values: at most {MAX_ENTRIES}")

    def _pair(self, table: Path) -> None:
        line = self._line()
        path = self._mention(table, self._key(), line)
        self._expect(_EQUALS)
        self._value(path)

    def _value(self, path: Path) -> None:
        if self._accept("["):
            self._items(path)
        elif self._accept("{"):
            self._pairs(path)
        else:
            self._expect(_ATOM)

    def _items(self, path: Path) -> None:
        index = 0
        self._expect(_BLANK)
        while not self._accept("]"):
            item = (*path, index)
            self._record(item, self._line())
            self._value(item)
            if not self._expect(_COMMA)[1]:
                self._require("]")
                return
            index += 1

    def _pairs(self, path: Path) -> None:
        self._expect(_BLANK)
        while not self._accept("}"):
            self._pair(path)
            if not self._expect(_COMMA)[1]:
                self._require("}")
                return

    def _key(self) -> list[str]:
        parts: list[str] = []
        while True:
            bare, basic, literal, dot = self._expect(_KEY_PART).groups()
            parts.append(bare or literal or (_ESCAPE.sub(_unescaped, basic) if basic else ""))
            if not dot:
                return parts
            if len(parts) >= MAX_DEPTH:
                raise TooMuchError(self._line(), f"nested too deep: at most {MAX_DEPTH} levels")

    # Reading

    def _line(self) -> int:
        return bisect_left(self._newlines, self._pos) + 1

    def _accept(self, literal: str) -> bool:
        found = self._text.startswith(literal, self._pos)
        if found:
            self._pos += len(literal)
        return found

    def _require(self, literal: str) -> None:
        if not self._accept(literal):
            raise _NotTomlError

    def _expect(self, pattern: re.Pattern[str]) -> re.Match[str]:
        match = pattern.match(self._text, self._pos)
        if match is None:
            raise _NotTomlError
        self._pos = match.end()
        return match


def _unescaped(match: re.Match[str]) -> str:
    digits = match[1] or match[2]
    if digits is None:
        return _SHORT_ESCAPES.get(match[3], match[0])
    code = int(digits, 16)
    return chr(code) if code <= 0x10FFFF else match[0]
