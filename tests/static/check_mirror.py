#!/usr/bin/env python3
"""Checks that tests mirror headers: include/clothctl/FOLDER/NAME.hpp has tests/FOLDER/NAME.cpp, or at least a test in
tests/FOLDER (for concepts also tests/archetypes and tests/laws) that includes it by name, or that
tested_with.txt names for it."""

from house import Report, arguments, headers, includes


def main():
    options = arguments(__doc__)
    report = Report("test mirror")
    covered = {}  # header: the test that tested_with.txt names
    listing = options.root / "tests" / "static" / "tested_with.txt"
    for line in listing.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            name, test = line.split()
            covered[name] = test
            if not (options.root / "include" / "clothctl" / name).exists():
                report.add(listing.relative_to(options.root), 0, f"{name} does not exist")
            if not (options.root / "tests" / test).exists():
                report.add(listing.relative_to(options.root), 0, f"tests/{test} does not exist")
    checked = 0
    included = {}  # by folder: the headers that its tests name
    for header in headers(options.root):
        if len(header.parts) != 2 or header.parts[0] == "bridge":
            continue  # entry headers hold no code; adapters are tested where their library is
        checked += 1
        if header.as_posix() in covered:
            continue
        folder = header.parts[0]
        if folder not in included:
            included[folder] = set()
            places = [folder] + (["archetypes", "laws"] if folder == "concepts" else [])
            for test in (t for place in places for t in (options.root / "tests" / place).glob("*.[ch]pp")):
                if test.parent.name == folder:
                    included[folder].add(f"clothctl/{folder}/{test.stem}.hpp")
                included[folder].update(target for _, _, target in includes(test.read_text(encoding="utf-8")))
        if "clothctl/" + header.as_posix() not in included[folder]:
            report.add("include/clothctl/" + header.as_posix(), 0, f"has no tests/{header.with_suffix('.cpp').as_posix()}")
    report.finish(f"{checked} headers, each with its test")


if __name__ == "__main__":
    main()
