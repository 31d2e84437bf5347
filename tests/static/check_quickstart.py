#!/usr/bin/env python3
"""Checks that the programs that the docs print equal those of examples/, which are compiled and run
by the ctest test `programs`: README.md shows quickstart.cpp, in under 40 lines, and where they
are, docs/world.md drape.cpp, in under 60, and docs/hands.md hand_holds_cloth.cpp, in under 100.

The program of a page is its first ```cpp block with a `main`."""

import re

from house import Report, arguments

SHOWN = (("README.md", "quickstart.cpp", 40), ("docs/world.md", "drape.cpp", 60),
         ("docs/hands.md", "hand_holds_cloth.cpp", 100))


def compare(report, root, page, program, most):
    """Compares the program of a page with its source; returns the number of lines."""
    source = root / "examples" / program
    for path in (root / page, source):
        if not path.exists():
            report.add(path.relative_to(root), 0, "does not exist")
            return 0
    blocks = re.findall(r"^```(?:cpp|c\+\+)\n(.*?)^```", (root / page).read_text(encoding="utf-8"),
                        re.M | re.S)
    programs = [block for block in blocks if re.search(r"\bint main\s*\(", block)]
    if not programs:
        report.add(page, 0, "shows no program with a main")
        return 0
    lines = programs[0].strip().count("\n") + 1
    if lines >= most:
        report.add(page, 0, f"the program has {lines} lines; it must stay under {most}")
    if programs[0].strip() != source.read_text(encoding="utf-8").strip():
        report.add(page, 0, f"the program differs from examples/{program}")
    return lines


def main():
    options = arguments(__doc__)
    report = Report("quickstart")
    lines = [compare(report, options.root, *shown) for shown in SHOWN
             if shown[0] == "README.md" or (options.root / shown[0]).exists()]
    report.finish(f"programs in the docs, {' and '.join(map(str, lines))} lines")


if __name__ == "__main__":
    main()
