"""Shared by the static checks: finding headers, their includes and code, and reporting."""

import argparse
import re
import sys
from pathlib import Path

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')


class Report:
    """Collects findings. `finish` prints them and exits with 1 if there are any."""

    def __init__(self, name):
        self.name = name
        self.findings = []

    def add(self, path, line, message):
        place = f"{path}:{line}" if line else str(path)
        self.findings.append(f"{place}: {message}")

    def finish(self, summary):
        for finding in self.findings:
            print(finding)
        if self.findings:
            print(f"{self.name}: {len(self.findings)} finding(s)")
            sys.exit(1)
        print(f"{self.name}: {summary}")


def arguments(description, **extra):
    """Parses --root and the options in `extra`, which maps names to add_argument keywords."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[2],
                        help="project root")
    for name, keywords in extra.items():
        parser.add_argument("--" + name.replace("_", "-"), **keywords)
    options = parser.parse_args()
    options.root = options.root.resolve()
    return options


def headers(root):
    """Returns all headers as sorted paths relative to include/clothctl."""
    base = root / "include" / "clothctl"
    found = sorted(p.relative_to(base) for p in base.rglob("*.hpp"))
    if not found:
        print(f"no headers under {base}")
        sys.exit(1)
    return found


def read(root, header):
    return (root / "include" / "clothctl" / header).read_text(encoding="utf-8")


def includes(text):
    """Yields (line number, '<' or '"', target) of every include outside block comments."""
    for number, line in enumerate(strip_comments(text).split("\n"), 1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1), match.group(2)


def strip_comments(text, keep_strings=True):
    """Removes comments and, on request, the text of literals. Keeps the number of lines."""
    out = []
    i, n = 0, len(text)
    while i < n:
        two = text[i : i + 2]
        if two == "//":
            while i < n and text[i] != "\n":
                i += 1
        elif two == "/*":
            end = text.find("*/", i + 2)
            end = n if end < 0 else end + 2
            out.append("\n" * text.count("\n", i, end))
            i = end
        elif text[i] == '"' and text[max(0, i - 1)] == "R":
            match = re.compile(r'"([^()\\\s]{0,16})\(').match(text, i)
            end = text.find(")" + match.group(1) + '"', i) if match else -1
            end = n if end < 0 else end + len(match.group(1)) + 2
            out.append(text[i:end] if keep_strings else '""' + "\n" * text.count("\n", i, end))
            i = end
        elif text[i] == '"' or (text[i] == "'"
                                and not (i and (text[i - 1].isalnum() or text[i - 1] == "_"))):
            quote, j = text[i], i + 1
            while j < n and text[j] != quote and text[j] != "\n":
                j += 2 if text[j] == "\\" else 1
            j = min(n, j + 1)
            out.append(text[i:j] if keep_strings else quote + quote)
            i = j
        else:
            out.append(text[i])
            i += 1
    return "".join(out)
