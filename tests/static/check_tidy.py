#!/usr/bin/env python3
"""Runs clang-tidy 14 with the project's .clang-tidy on source files that include every
header except bridge/.

Exits with 77 (skipped) if that version is not installed, since others have other checks."""

import re
import shutil
import subprocess
import sys

from house import Report, arguments

VERSION = 14
FINDING = re.compile(r"^(?P<file>[^:\n]+):(?P<line>\d+):\d+: (?:warning|error): (?P<what>.*)$",
                     re.M)


def program():
    for name in (f"clang-tidy-{VERSION}", "clang-tidy"):
        path = shutil.which(name)
        if path:
            text = subprocess.run([path, "--version"], capture_output=True, text=True).stdout
            match = re.search(r"version (\d+)", text)
            if match and int(match.group(1)) == VERSION:
                return path
    return None


def main():
    options = arguments(
        __doc__,
        units={"default": "tidy.cpp",
               "help": "source files, relative to tests/static, separated by ,"},
        system={"default": "/usr/include/eigen3",
                "help": "directories of system headers, separated by ;"},
    )
    report = Report("tidy")
    tidy = program()
    if tidy is None:
        print(f"tidy: skipped, clang-tidy {VERSION} is not installed (Debian 12: clang-tidy)")
        sys.exit(77)
    flags = ["-std=c++20", "-I", str(options.root / "include"), "-I", str(options.root / "tests")]
    for directory in filter(None, options.system.split(";")):
        flags += ["-isystem", directory]
    units = options.units.split(",")
    for unit in units:
        path = options.root / "tests" / "static" / unit
        command = [tidy, "--quiet", "--config-file=" + str(options.root / ".clang-tidy"), str(path)]
        run = subprocess.run(command + ["--"] + flags, capture_output=True, text=True)
        found = set()
        for match in FINDING.finditer(run.stdout):
            found.add((match.group("file"), int(match.group("line")), match.group("what")))
        for file, line, what in sorted(found):
            report.add(file.replace(str(options.root) + "/", ""), line, what)
        if run.returncode != 0 and not found:
            report.add(path.relative_to(options.root), 0,
                       "clang-tidy failed:\n" + run.stderr[-2000:])
    report.finish(f"{', '.join(units)}: nothing found")


if __name__ == "__main__":
    main()
