#!/usr/bin/env python3
"""Checks that tests mirror headers: include/clothctl/FOLDER/NAME.hpp has tests/FOLDER/NAME.cpp, and includes it there."""

from house import Report, arguments, headers, includes


def main():
    options = arguments(__doc__)
    report = Report("test mirror")
    checked = 0
    for header in headers(options.root):
        if len(header.parts) != 2 or header.parts[0] == "bridge":
            continue  # entry headers hold no code; adapters are tested where their library is
        checked += 1
        name = "clothctl/" + header.as_posix()
        test = options.root / "tests" / header.with_suffix(".cpp")
        if not test.exists():
            report.add("include/" + name, 0, f"has no tests/{header.with_suffix('.cpp').as_posix()}")
        elif name not in {target for _, _, target in includes(test.read_text(encoding="utf-8"))}:
            report.add(test.relative_to(options.root), 0, f"does not include {name}")
    report.finish(f"{checked} headers, each with its test")


if __name__ == "__main__":
    main()
