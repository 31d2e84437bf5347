#!/usr/bin/env python3
"""Checks that include/clothctl/FOLDER/NAME.hpp and FOLDER/detail/NAME.hpp each have a test file
tests/FOLDER/NAME.cpp that includes them."""

from house import Report, arguments, headers, includes


def main():
    options = arguments(__doc__)
    report = Report("test mirror")
    checked = 0
    for header in headers(options.root):
        if len(header.parts) == 1 or header.parts[0] == "bridge":
            continue  # entry headers have no code; adapters may lack their library
        checked += 1
        name = "clothctl/" + header.as_posix()
        mirror = "/".join(part for part in header.with_suffix(".cpp").parts if part != "detail")
        test = options.root / "tests" / mirror
        if not test.exists():
            report.add("include/" + name, 0, f"has no tests/{mirror}")
        elif name not in {target for _, _, target in includes(test.read_text(encoding="utf-8"))}:
            report.add(test.relative_to(options.root), 0, f"does not include {name}")
    report.finish(f"{checked} headers, each with its test")


if __name__ == "__main__":
    main()
