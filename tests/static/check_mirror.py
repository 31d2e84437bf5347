#!/usr/bin/env python3
"""Checks that tests mirror headers: include/clothctl/FOLDER/NAME.hpp has tests/FOLDER/NAME.cpp, or at least a test in
tests/FOLDER that includes it by name."""

from house import Report, arguments, headers, includes


def main():
    options = arguments(__doc__)
    report = Report("test mirror")
    checked = 0
    included = {}  # by folder: the headers that its tests name
    for header in headers(options.root):
        if len(header.parts) != 2 or header.parts[0] == "bridge":
            continue  # entry headers hold no code; adapters are tested where their library is
        checked += 1
        folder = header.parts[0]
        if folder not in included:
            included[folder] = set()
            for test in (options.root / "tests" / folder).glob("*.cpp"):
                included[folder].add(f"clothctl/{folder}/{test.stem}.hpp")
                included[folder].update(target for _, _, target in includes(test.read_text(encoding="utf-8")))
        if "clothctl/" + header.as_posix() not in included[folder]:
            report.add("include/clothctl/" + header.as_posix(), 0, f"has no tests/{header.with_suffix('.cpp').as_posix()}")
    report.finish(f"{checked} headers, each with its test")


if __name__ == "__main__":
    main()
