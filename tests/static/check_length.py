#!/usr/bin/env python3
"""Checks how long headers are, counted without comments and blank lines.

No header is over 500 lines unless long_headers.txt gives a reason; prints the median and the share up to 300 lines (aims of the
design: median 120, nine in ten up to 300).
"""

import statistics

from house import Report, arguments, headers, read, strip_comments

LIMIT, AIM_MEDIAN, AIM_NINE_IN_TEN = 500, 120, 300


def main():
    options = arguments(__doc__)
    report = Report("header length")
    reasons = {}
    listing = options.root / "tests" / "static" / "long_headers.txt"
    for line in listing.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            path, _, reason = line.partition(" ")
            reasons[path] = reason.strip()
    lengths = {}
    for header in headers(options.root):
        code = strip_comments(read(options.root, header))
        lengths[header.as_posix()] = sum(1 for line in code.split("\n") if line.strip())
    for name, length in lengths.items():
        if length > LIMIT and not reasons.get(name):
            report.add("include/clothctl/" + name, 0, f"{length} lines of code, over {LIMIT}, and no reason in long_headers.txt")
    for name in reasons:
        if lengths.get(name, 0) <= LIMIT:
            report.add(listing, 0, f"{name} is listed but needs no reason")
    values = sorted(lengths.values())
    short = 100 * sum(v <= AIM_NINE_IN_TEN for v in values) // len(values)
    longest = max(lengths, key=lengths.get)
    print(f"median {statistics.median(values):g} (aim {AIM_MEDIAN}), {short} % up to {AIM_NINE_IN_TEN} (aim 90 %)")
    for name in sorted((n for n in lengths if lengths[n] > AIM_NINE_IN_TEN), key=lengths.get, reverse=True):
        print(f"  over {AIM_NINE_IN_TEN}: {name} {lengths[name]}")
    report.finish(f"{len(values)} headers, longest {longest} with {lengths[longest]} lines")


if __name__ == "__main__":
    main()
