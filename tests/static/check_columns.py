#!/usr/bin/env python3
"""Checks that no line is over 100 columns, counted in code points.

Covers include/, examples/, docs/, README.md, CONTRIBUTING.md and CHANGELOG.md. Rows of tables are
exempt, because Markdown cannot wrap them. (scripts/format wraps the code of tests/ and bench/.)
"""

from house import Report, arguments

LIMIT = 100
FOLDERS = ("include", "examples", "docs")
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
SUFFIXES = {".hpp", ".cpp", ".md", ".txt"}


def candidates(root):
    """Yields every text file that the check covers."""
    yield from (root / page for page in PAGES if (root / page).exists())
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and path.suffix in SUFFIXES:
                yield path


def main():
    options = arguments(__doc__)
    report = Report("columns")
    files = 0
    for path in candidates(options.root):
        files += 1
        for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
            if line.lstrip().startswith("|"):
                continue
            if len(line) > LIMIT:
                message = f"{len(line)} columns, over {LIMIT}"
                report.add(path.relative_to(options.root), number, message)
    report.finish(f"{files} files, no line over {LIMIT}")


if __name__ == "__main__":
    main()
