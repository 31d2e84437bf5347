#!/usr/bin/env python3
"""Checks that the README's first program equals examples/quickstart.cpp, which the examples compile
and the ctest test `programs` runs, and that it has under 40 lines.

The program is the first ```cpp block of README.md with a `main`."""

import re

from house import Report, arguments


def main():
    options = arguments(__doc__)
    report = Report("quickstart")
    readme = options.root / "README.md"
    source = options.root / "examples" / "quickstart.cpp"
    for path in (readme, source):
        if not path.exists():
            report.add(path.relative_to(options.root), 0, "does not exist")
    if report.findings:
        report.finish("")
    blocks = re.findall(r"^```(?:cpp|c\+\+)\n(.*?)^```", readme.read_text(encoding="utf-8"),
                        re.M | re.S)
    programs = [block for block in blocks if re.search(r"\bint main\s*\(", block)]
    if not programs:
        report.add("README.md", 0, "shows no program with a main")
        report.finish("")
    program = programs[0]
    lines = program.strip().count("\n") + 1
    if lines >= 40:
        report.add("README.md", 0, f"the program has {lines} lines; it must stay under 40")
    if program.strip() != source.read_text(encoding="utf-8").strip():
        report.add("README.md", 0, "the program differs from examples/quickstart.cpp")
    report.finish(f"the program of the README, {lines} lines")


if __name__ == "__main__":
    main()
