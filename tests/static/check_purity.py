#!/usr/bin/env python3
"""Checks what headers must not do.

Core headers (all except io/ and bridge/) must not throw, print, read clocks or draw random numbers.
No header may have a mutable global, written as a `static` or `inline` variable. Nothing may be
marked as unfinished."""

import re

from house import Report, arguments, headers, read, strip_comments

FORBIDDEN = [
    (r"\bthrow\b", "throws"),
    (r"\btry\s*\{|\bcatch\s*\(", "catches exceptions"),
    (r"\bdynamic_cast\b|\btypeid\b", "needs run-time type information"),
    (r"\bstd::(cout|cerr|clog)\b|\b(f|v|vf)?printf\s*\(|\b(f)?puts\s*\(", "prints"),
    (r"\b(system_clock|steady_clock|high_resolution_clock)\b|\bclock\s*\(\s*\)", "reads a clock"),
    (r"\bstd::rand\b|\brandom_device\b|\bsrand\b|\bsetRandom\b|::Random\s*\(",
     "draws random numbers of its own"),
    (r"\bstd::(thread|jthread|async)\b", "starts threads"),
    (r"==\s*(std::)?numeric_limits<\w+>::(infinity|quiet_NaN)"
     r"|\bstd::isn?(an|inf|finite)\b|\bstd::isfinite\b",
     "tests for NaN or infinity without clothctl::is_finite"),
]
GLOBAL = re.compile(
    r"^(inline|static|thread_local)\s+(?!constexpr\b|const\b|consteval\b)[\w:<>, ]+\s\w+\s*"
    r"(=[^=;()]*|\{[^}]*\})?;", re.M)
UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX)\b|not implemented|placeholder", re.I)


def main():
    options = arguments(__doc__)
    report = Report("purity")
    checked = headers(options.root)
    for header in checked:
        shown = "include/clothctl/" + header.as_posix()
        text = read(options.root, header)
        for number, line in enumerate(text.split("\n"), 1):
            if UNFINISHED.search(line):
                report.add(shown, number, "is marked as unfinished")
        if header.parts[0] in ("io", "bridge", "io.hpp"):
            continue
        code = strip_comments(text, keep_strings=False)
        for number, line in enumerate(code.split("\n"), 1):
            for pattern, what in FORBIDDEN:
                if re.search(pattern, line):
                    report.add(shown, number, f"{what}: {line.strip()}")
        for match in GLOBAL.finditer(code):
            report.add(shown, code.count("\n", 0, match.start()) + 1,
                       f"holds a mutable global: {match.group(0).strip()}")
    for folder in ("examples", "bench"):
        for path in sorted((options.root / folder).rglob("*.[ch]pp")):
            for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
                if UNFINISHED.search(line):
                    report.add(path.relative_to(options.root), number, "is marked as unfinished")
    report.finish(f"{len(checked)} headers keep to the rules of a step")


if __name__ == "__main__":
    main()
