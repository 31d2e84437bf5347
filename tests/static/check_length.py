#!/usr/bin/env python3
"""Checks how long headers, functions, programs and folders are.

1. No header has over 500 lines, unless long_headers.txt gives a reason.
2. No function (signature to closing brace) has over 60 lines.
3. No program examples/*.cpp has over 150 lines.
4. No folder has over 12 doors (headers outside its detail/), and qp/ not over 6.

Comments and blank lines count in programs only. Prints the median length of headers and the share
of those up to 300 lines (aims: 120 lines, 90 %).
"""

import statistics

from check_docs import Scanner, skip_group
from house import Report, arguments, headers, read, strip_comments

LIMIT, AIM_MEDIAN, AIM_NINE_IN_TEN = 500, 120, 300
FUNCTION_LIMIT, PROGRAM_LIMIT = 60, 150
DOORS, DOORS_OF = 12, {"qp": 6}


class FunctionLengths(Scanner):
    """Collects (lines of code, line number, first line) of every function body of a header."""

    def __init__(self, shown, text):
        super().__init__(shown, text, None, everything=True)
        self.functions = []
        self.scan(0, len(self.code), "namespace", True, "", False)

    def require(self, start, end, what):
        """Ignores comments."""

    def judge(self, start, end, what, public, owner, in_house):
        if what != "function":
            return
        body = self.code[start : skip_group(self.code, end)]
        length = sum(1 for line in body.split("\n") if line.strip())
        heads = [line.strip() for line in body.split("\n") if line.strip()]
        head = next((h for h in heads if not h.startswith(("template", "requires"))), heads[0])
        self.functions.append((length, self.line(start), head.rstrip("{ ")))


def check_headers(options, report):
    """Checks lengths of headers; returns them by name."""
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
            message = f"{length} lines of code, over {LIMIT}, and no reason in long_headers.txt"
            report.add("include/clothctl/" + name, 0, message)
    for name in reasons:
        if lengths.get(name, 0) <= LIMIT:
            report.add(listing, 0, f"{name} is listed but needs no reason")
    return lengths


def check_functions(options, report):
    """Checks lengths of functions; returns the longest (length, place) and the number."""
    longest, count = (0, ""), 0
    for header in headers(options.root):
        shown = "include/clothctl/" + header.as_posix()
        for length, line, head in FunctionLengths(shown, read(options.root, header)).functions:
            count += 1
            longest = max(longest, (length, f"{shown}:{line}"))
            if length > FUNCTION_LIMIT:
                message = f"function of {length} lines of code, over {FUNCTION_LIMIT}: {head}"
                report.add(shown, line, message)
    return longest, count


def check_folders(options, report):
    """Checks the number of doors of each folder; returns it by folder."""
    doors = {}
    for header in headers(options.root):
        if len(header.parts) == 2:
            doors[header.parts[0]] = doors.get(header.parts[0], 0) + 1
    for folder, count in sorted(doors.items()):
        most = DOORS_OF.get(folder, DOORS)
        if count > most:
            message = f"{count} doors, over {most}; what users never include goes to detail/"
            report.add("include/clothctl/" + folder, 0, message)
    return doors


def check_programs(options, report):
    for path in sorted((options.root / "examples").glob("*.cpp")):
        length = path.read_text(encoding="utf-8").count("\n")
        if length > PROGRAM_LIMIT:
            message = f"program of {length} lines, over {PROGRAM_LIMIT}"
            report.add(path.relative_to(options.root), 0, message)


def main():
    options = arguments(__doc__)
    report = Report("length")
    lengths = check_headers(options, report)
    function, functions = check_functions(options, report)
    doors = check_folders(options, report)
    check_programs(options, report)
    values = sorted(lengths.values())
    short = 100 * sum(v <= AIM_NINE_IN_TEN for v in values) // len(values)
    longest = max(lengths, key=lengths.get)
    print(f"headers: median {statistics.median(values):g} (aim {AIM_MEDIAN}), {short} % up to "
          f"{AIM_NINE_IN_TEN} (aim 90 %)")
    for name in sorted((n for n in lengths if lengths[n] > AIM_NINE_IN_TEN), key=lengths.get,
                       reverse=True):
        print(f"  over {AIM_NINE_IN_TEN}: {name} {lengths[name]}")
    print(f"functions: {functions}, longest {function[0]} lines ({function[1]})")
    print("doors: " + ", ".join(f"{folder} {count}" for folder, count in sorted(doors.items())))
    report.finish(f"{len(values)} headers, longest {longest} with {lengths[longest]} lines")


if __name__ == "__main__":
    main()
